"""When a failure was decided: the run repeated from earlier and earlier, with small differences.

The run goes forward once for each round of questions, and is forked at the times that are asked
about: there robots stand millimetres away, and the stack goes on as it is, with one layer
exchanged, or without one robot. Times are halved until it is known when most copies begin to fail
(see :mod:`mrta_falsify.core.inevitability`).

Copies are thrifty: two alike settle on which side a time lies while times are halved. The times
next to the turn get more, until the interval of their chance leaves one half out. If the stack as
it is fails from the start, it fails later, too, and is not asked again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mrta_falsify.analysis.explain.case import Case
from mrta_falsify.analysis.explain.changes import SUSPECTS, Change
from mrta_falsify.analysis.explain.layers import last_rows
from mrta_falsify.analysis.explain.rows import Failure, curing, experiment_of, fate_of
from mrta_falsify.core.claims import leading_claim
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import Explanation
from mrta_falsify.core.inevitability import (
    EVEN,
    ChanceCurve,
    Inevitability,
    Replaced,
    RewoundTo,
    Turn,
    decision,
    decisive,
    turn_of,
)
from mrta_falsify.lab import Edit, Experiment, Lab, Vote
from mrta_falsify.process.child import can_fork
from mrta_falsify.specs.causes import cause_begins
from mrta_falsify.trial import Job
from simulator_interface.episode import Episode

REWINDS = 80  # copies, unless the caller says otherwise
ALIKE = 2  # copies that settle on which side a time lies, for now
FEW, MANY = 6, 12  # copies whose interval is looked at, at least and at most
FINEST = 0.5  # s, or a hundredth of the run if that is more: times are not halved further
COARSER = 4.0  # times that, beside a shipped layer in place of another: the others say less
FOR_A_CHANGE = 24  # copies set aside for the curve of a change
STACK = "the stack as it is"


class Rewinding:
    """The run repeated from earlier and earlier: when was the failure decided, and by what?"""

    least = 0  #: its runs are counted apart

    def applies(self, case: Case) -> bool:
        """See :class:`.case.Question`."""
        return case.rewinds >= FEW

    def ask(self, case: Case, found: Explanation, runs: int) -> Explanation:
        """See :class:`.case.Question`."""
        del runs
        rows = last_rows(found.rows)
        cured = {row.change for row in curing(rows)} if rows else set()
        since = rows[0].at if rows else 0.0
        branches = branches_of(case.job, case.failure, case.changes, cured, since)
        told = rewind(case.job, case.failure, branches, case.rewinds, case.lab)
        return dataclasses.replace(found, inevitability=told)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Branch:
    """What the copies of one curve do differently from the time they begin at."""

    replaced: Replaced
    name: str = ""  #: of the layer or robot
    text: str  #: in words
    config: StackConfig | None = None  #: None: the stack as it is
    robot: int | None = None  #: that is taken away
    restores: bool = False
    since: float = 0.0  #: the first time to ask about [s]


def branches_of(
    job: Job, failure: Failure, changes: Sequence[Change], cured: Collection[str], at: float
) -> list[Branch]:
    """Choose what to exchange: what has removed the failure, the shipped layer first.

    A shipped layer is tried whether or not it has removed the failure at ``at``, then from the
    start. Of two or more members of a deadlock each is taken away, last.

    Args:
        job: that fails.
        failure: its.
        changes: of layers.
        cured: texts of those that have removed the failure.
        at: since when [s].
    """
    wanted = [
        Branch(
            replaced="layer",
            name=change.layer,
            text=change.text,
            config=change.config,
            restores=change.restores,
            since=at if change.text in cured else 0.0,
        )
        for change in changes
        if change.text in cured or change.restores
    ]
    order = {name: number for number, name in enumerate(SUSPECTS)}  # a variant is no suspect
    wanted.sort(key=lambda branch: (not branch.restores, order.get(branch.name, len(order))))
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    members = leading_claim(failure.verdict.evidence).get("members", ())
    if len(members) < 2:
        members = ()  # without the one that is stuck, nobody is
    return [
        *wanted,
        *(
            Branch(replaced="robot", name=name, text=f"without {name}", robot=numbers[name])
            for name in members
            if name in numbers
        ),
    ]


def rewind(
    job: Job, failure: Failure, branches: Sequence[Branch], most: int, lab: Lab
) -> Inevitability | None:
    """Find out when a failure was decided, and by which layer.

    Args:
        job: that fails.
        failure: its.
        branches: what to exchange, the most telling first; the last ones go without if there are
            too few copies left.
        most: copies at most.
        lab: that runs them.

    Returns:
        None if there is nothing to rewind, or are no copies left for it.
    """
    if failure.found <= 0.0 or most < FEW:
        return None
    failure = dataclasses.replace(failure, situation=None)  # to get by is to avert it
    left_out, why_not = "", _why_not(job)
    if job.config.stack is not None and branches:
        branches = []
        left_out = "the layers of a foreign stack, which do not change in mid-run"
    counted = _Votes(job, failure, most, lab, _finest_of(branches, failure.found))
    waiting = list(branches) if not why_not else []
    if not why_not:
        counted.find_turn_of_stack()
    while waiting and counted.left >= FOR_A_CHANGE:
        room = counted.left // FOR_A_CHANGE
        counted.find_turns(waiting[:room])
        waiting = waiting[room:]
    curves = counted.curves()
    first = decisive(curves)
    return Inevitability(
        onset=min(cause_begins(failure.verdict), failure.found),
        found=failure.found,
        curves=curves,
        decided_at=decision(curves),
        by=first.name if first is not None else "",
        runs=most - counted.left,
        left_out=why_not or left_out or _without_room(waiting),
    )


def _why_not(job: Job) -> str:
    """Say why no copy of a run can go on with small differences; empty if it can."""
    if not can_fork():
        return "the whole run: no process can be copied with a window open"
    episode = Episode(job.world, job.config)
    try:
        if not episode.can_copy:
            return "the whole run: the stack cannot be copied while it runs"
        if not episode.can_nudge:
            name = job.config.engine.name
            return f"the whole run: the engine {name} cannot move robots a little"
    finally:
        episode.close()
    return ""


def _finest_of(branches: Sequence[Branch], found: float) -> Callable[[Branch], float]:
    """Choose how closely the turn of a branch is looked for [s]."""
    finest = max(FINEST, found / 100.0)
    restores = any(branch.restores for branch in branches)

    def finest_of(branch: Branch) -> float:
        says_less = restores and branch.replaced != "nothing" and not branch.restores
        return finest * (COARSER if says_less else 1.0)

    return finest_of


def _without_room(branches: Sequence[Branch]) -> str:
    names = dict.fromkeys(branch.text for branch in branches)
    return f"{', '.join(names)}: no runs were left (--rewinds)" if names else ""


class _Question(NamedTuple):
    """What is asked: how often a branch fails from a time on."""

    branch: Branch
    time: float  #: [s]
    settled: bool = False  #: whether to go on until the interval leaves one half out


class _Votes:
    """What copies have told, by branch and time."""

    def __init__(
        self, job: Job, failure: Failure, most: int, lab: Lab, finest: Callable[[Branch], float]
    ) -> None:
        self._job, self._failure, self._lab = job, failure, lab
        self._found = failure.found
        self.left = most  #: copies
        self._finest = finest
        self._stack = Branch(replaced="nothing", text=STACK)
        self._votes: dict[Branch, dict[float, Vote]] = {self._stack: {}}

    def find_turn_of_stack(self) -> None:
        """Ask about the stack as it is until its turn is known, or the copies are used up."""
        self._ask([_Question(self._stack, 0.0, settled=True)])
        self._find([self._stack])

    def find_turns(self, changed: Sequence[Branch]) -> None:
        """Ask about changes until their turns are known, or the copies are used up."""
        self._ask([_Question(branch, branch.since) for branch in changed])
        lost = [b for b in changed if b.since > 0.0 and self._turn(b).open_until is None]
        self._ask([_Question(branch, 0.0) for branch in lost])
        self._find(changed)
        helped = {self._turn(branch).open_until for branch in changed}
        unsure = [time for time in helped if time is not None and not self._fails_by(time)]
        self._ask([_Question(self._stack, time, settled=True) for time in unsure])

    def curves(self) -> tuple[ChanceCurve, ...]:
        """Say what is known of each branch."""
        return tuple(
            ChanceCurve(
                replaced=branch.replaced,
                name=branch.name,
                change=branch.text,
                restores=branch.restores,
                points=tuple(self._points(branch)),
                open_until=self._turn(branch).open_until,
                lost_from=self._turn(branch).lost_from,
            )
            for branch in self._votes
        )

    # --- what to ask ----------------------------------------------------------------------

    def _find(self, branches: Sequence[Branch]) -> None:
        """Halve the times around each turn, then make sure of those next to it."""
        waiting = [b for b in branches if self._turn(b).open_until is not None]
        while waiting and self.left > 0:
            questions = []
            for branch in list(waiting):
                half = self._half(branch)
                if half is not None:
                    questions.append(_Question(branch, half))
                    continue
                waiting.remove(branch)
                times = self._beside_the_turn(branch)
                questions += [_Question(branch, time, settled=True) for time in times]
            self._ask(questions)

    def _fails_by(self, time: float) -> bool:
        """Whether the stack as it is is known to fail from a time on or before."""
        points = self._points(self._stack)
        return any(p.time <= time and p.chance.low > EVEN for p in points)

    def _tick(self, time: float) -> float:
        rate = self._job.config.control_rate
        return round(time * rate) / rate

    def _points(self, branch: Branch) -> list[RewoundTo]:
        votes = sorted(self._votes.get(branch, {}).items())
        points = [RewoundTo(time=time, chance=vote.chance) for time, vote in votes]
        return [point for point in points if point.is_tried]

    def _turn(self, branch: Branch) -> Turn:
        return turn_of(self._points(branch), self._found)

    def _half(self, branch: Branch) -> float | None:
        """Choose the time to ask about next; None: the turn is known well enough."""
        turn = self._turn(branch)
        if turn.open_until is None or turn.lost_from - turn.open_until <= self._finest(branch):
            return None
        half = self._tick((turn.open_until + turn.lost_from) / 2.0)
        return None if half in self._votes[branch] else half

    def _beside_the_turn(self, branch: Branch) -> list[float]:
        turn = self._turn(branch)
        return [time for time in turn if time is not None and time < self._found]

    # --- asking ---------------------------------------------------------------------------

    def _ask(self, questions: Sequence[_Question]) -> None:
        """Run copies of each question until there are enough, or no more to be had."""
        waiting = list(questions)
        while waiting := [question for question in waiting if self._wants(question)]:
            queried = [(question, self._number(question)) for question in waiting][: self.left]
            if not queried:
                return
            self.left -= len(queried)
            results = self._lab.map([self._copy(*one) for one in queried])
            for (question, _), result in zip(queried, results, strict=True):
                gone = question.branch.name if question.branch.robot is not None else ""
                fate = fate_of(result, self._failure, since=question.time, without=gone)
                failed = {"fails": True, "passes": False}.get(fate)
                votes = self._votes.setdefault(question.branch, {})
                votes[question.time] = self._vote(question).add(failed=failed)

    def _vote(self, question: _Question) -> Vote:
        return self._votes.get(question.branch, {}).get(question.time, Vote(runs=0, failed=0))

    def _number(self, question: _Question) -> int:
        """Number of the next copy, from 1 on."""
        vote = self._vote(question)
        return vote.runs + vote.undecided + 1

    def _wants(self, question: _Question) -> bool:
        """Whether more copies are wanted."""
        vote = self._vote(question)
        if self._number(question) > MANY:
            return False
        if question.settled:
            if vote.runs < FEW:
                return vote.undecided <= ALIKE
            return vote.chance.low <= EVEN <= vote.chance.high
        is_alike = vote.runs >= ALIKE and vote.failed in (0, vote.runs)
        return not is_alike and vote.runs < FEW and vote.undecided < ALIKE

    def _copy(self, question: _Question, number: int) -> Experiment:
        branch = question.branch
        edit = Edit(
            at=question.time,
            stack=branch.config,
            without=() if branch.robot is None else (branch.robot,),
            nudge=number,
        )
        bare = experiment_of(self._job, self._failure, 0.0, None, 0)
        return dataclasses.replace(bare, edits=(edit,))
