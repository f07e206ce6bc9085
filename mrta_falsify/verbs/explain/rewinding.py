"""When a failure was decided: the run repeated from earlier and earlier, with small differences.

The run goes forward once for a few curves. A copy of it goes on to the times that are asked about,
and there copies of that one begin: nudged a little, each as the stack is, with one layer replaced,
or without one robot. The run follows as far as is known to be open. So times are halved, without
beginning anew, until it is known when most copies begin to fail (see
:mod:`mrta_falsify.core.inevitability`).

Copies are thrifty: two alike settle on which side a time lies while times are halved. The times
next to the turn get more, until the interval of their chance leaves one half out. If the stack as
it is fails from the start, it fails later, too, and is not asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NamedTuple

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.core import codec
from mrta_falsify.core.claims import leading_claim
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import Counterfactual
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
from mrta_falsify.core.probability import Probability
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.causes import cause_begins
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain.changes import SUSPECTS, Change
from mrta_falsify.verbs.explain.continuing import Failure, go_on, run_until
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.small_differences import FEW, MANY, Tally
from simulator_interface import forking
from simulator_interface.continuation import Running
from simulator_interface.watched_copy import CopyFailed

REWINDS = 80  # copies, unless the caller says otherwise
FINEST = 0.5  # s, or a hundredth of the run if that is more: times are not halved further
COARSER = 4.0  # times that, beside a shipped layer in place of another: the others say less
FOR_A_CHANGE = 24  # copies set aside for the curve of a change
STACK = "the stack as it is"


@dataclass(frozen=True, slots=True, kw_only=True)
class RewoundCopy:
    """What the continuation of a copy gave."""

    failed: bool
    answered: bool  #: False: it could not be judged


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


class CannotRewindError(Exception):
    """Why the run of a job cannot be repeated from within."""


def branches_of(
    job: Job,
    verdict: Verdict,
    changes: Sequence[Change],
    found: Sequence[Counterfactual],
    changed_at: float,
) -> list[Branch]:
    """Choose what to replace: what has removed the failure, the shipped layer first.

    A shipped layer is tried whether or not it has removed the failure at ``changed_at``, then from
    the start. Of the members of a deadlock each is taken away, last.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        changes: of layers.
        found: what became of the failure with each of them.
        changed_at: since when [s].
    """
    cured = {one.change for one in found if one.failure_gone}
    wanted = [
        Branch(
            replaced="layer",
            name=change.layer,
            text=change.text,
            config=change.config,
            restores=change.restores,
            since=changed_at if change.text in cured else 0.0,
        )
        for change in changes
        if change.text in cured or change.restores
    ]
    order = {name: number for number, name in enumerate(SUSPECTS)}  # a variant is no suspect
    wanted.sort(key=lambda branch: (not branch.restores, order.get(branch.name, len(order))))
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    members = leading_claim(verdict.evidence).get("members", ())
    return [
        *wanted,
        *(
            Branch(replaced="robot", name=name, text=f"without {name}", robot=numbers[name])
            for name in members
            if name in numbers
        ),
    ]


def rewind(
    job: Job,
    failure: Failure,
    branches: Sequence[Branch],
    count: RunCount,
    journal: RunJournal[RewoundCopy],
) -> Inevitability | None:
    """Find out when a failure was decided, and by which layer.

    Args:
        job: that fails.
        failure: its.
        branches: what to replace, the most telling first; the last ones go without if there are
            too few runs left.
        count: of all runs.
        journal: of finished copies.

    Returns:
        None if there is nothing to rewind, or are no runs left for it.
    """
    found = failure.found
    if found <= 0.0 or count.left < FEW:
        return None
    begun = count.done
    left_out = ""
    if job.config.stack is not None and branches:
        branches = []
        left_out = "the layers of a stack in a process of its own, which do not change in mid-run"
    told = _Told(job, failure, count, journal, _finest_of(branches, found))
    waiting = list(branches)
    try:
        told.find_turn_of_stack()
        while waiting and count.left >= FOR_A_CHANGE:
            room = count.left // FOR_A_CHANGE
            told.find_turns(waiting[:room])
            waiting = waiting[room:]
    except CannotRewindError as cannot:
        left_out = str(cannot)
    curves = told.curves()
    first = decisive(curves)
    return Inevitability(
        onset=min(cause_begins(failure.verdict), found),
        found=found,
        curves=curves,
        decided_at=decision(curves),
        by=first.name if first is not None else "",
        runs=count.done - begun,
        left_out=left_out or _without_room(waiting),
    )


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
    return f"{', '.join(names)}: the copies were used up (--rewinds)" if names else ""


class _Question(NamedTuple):
    """What is asked: how often a branch fails from a time on."""

    branch: Branch
    time: float  #: [s]
    settled: bool = False  #: whether to go on until the interval leaves one half out


class _Row(NamedTuple):
    """What a copy has told."""

    key: str
    copy: RewoundCopy


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """What the copies of one round have told."""

    keys: tuple[str, ...]
    copies: tuple[RewoundCopy, ...]


class _Told:
    """What copies have told, by branch and time."""

    def __init__(
        self,
        job: Job,
        failure: Failure,
        count: RunCount,
        journal: RunJournal[RewoundCopy],
        finest: Callable[[Branch], float],
    ) -> None:
        self._job, self._failure, self._found = job, failure, failure.found
        self._count, self._journal = count, journal
        self._finest = finest
        self._asked = codec.digest([job.world, job.config, job.specifications, failure.verdict])
        self._stack = Branch(replaced="nothing", text=STACK)
        self._chances: dict[Branch, dict[float, Probability]] = {self._stack: {}}
        self._counted: set[str] = set()  # copies

    def find_turn_of_stack(self) -> None:
        """Ask about the stack as it is until its turn is known, or the copies are used up.

        Raises:
            CannotRewindError: no copy of the run can go on with small differences.
        """
        with ExitStack() as stack:
            run = _Run(self._job, self._failure, stack)
            self._ask(run, 0.0, [_Question(self._stack, 0.0, settled=True)])
            self._find(run, [self._stack])

    def find_turns(self, changed: Sequence[Branch]) -> None:
        """Ask about changes until their turns are known, or the copies are used up."""
        with ExitStack() as stack:
            run = _Run(self._job, self._failure, stack)
            since = {branch: branch.since for branch in changed}
            self._ask(run, 0.0, [_Question(b, time) for b, time in since.items()])
            lost = [b for b in changed if b.since > 0.0 and self._turn(b).open_until is None]
            self._ask(run, 0.0, [_Question(b, 0.0) for b in lost])
            self._find(run, changed)
        helped = {self._turn(branch).open_until for branch in changed}
        unsure = [time for time in helped if time is not None and not self._fails_by(time)]
        with ExitStack() as stack:
            run = _Run(self._job, self._failure, stack)
            self._ask(run, 0.0, [_Question(self._stack, time, settled=True) for time in unsure])

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
            for branch in self._chances
        )

    # --- what to ask ----------------------------------------------------------------------

    def _find(self, run: _Run, branches: Sequence[Branch]) -> None:
        """Halve the times around each turn, then make sure of those next to it."""
        waiting = [b for b in branches if self._turn(b).open_until is not None]
        while waiting and self._count.left > 0:
            since = min(self._turn(b).open_until or 0.0 for b in waiting)
            questions = []
            for branch in list(waiting):
                half = self._half(branch)
                if half is not None:
                    questions.append(_Question(branch, half))
                    continue
                waiting.remove(branch)
                times = self._beside_the_turn(branch)
                questions += [_Question(branch, time, settled=True) for time in times]
            self._ask(run, since, questions)

    def _fails_by(self, time: float) -> bool:
        """Whether the stack as it is is known to fail from a time on or before."""
        points = self._points(self._stack)
        return any(p.time <= time and p.chance.low > EVEN for p in points)

    def _tick(self, time: float) -> float:
        rate = self._job.config.control_rate
        return round(time * rate) / rate

    def _points(self, branch: Branch) -> list[RewoundTo]:
        chances = sorted(self._chances.get(branch, {}).items())
        points = [RewoundTo(time=time, chance=chance) for time, chance in chances]
        return [point for point in points if point.is_tried]

    def _turn(self, branch: Branch) -> Turn:
        return turn_of(self._points(branch), self._found)

    def _half(self, branch: Branch) -> float | None:
        """Choose the time to ask about next; None: the turn is known well enough."""
        turn = self._turn(branch)
        if turn.open_until is None or turn.lost_from - turn.open_until <= self._finest(branch):
            return None
        half = self._tick((turn.open_until + turn.lost_from) / 2.0)
        return None if half in self._chances[branch] else half

    def _beside_the_turn(self, branch: Branch) -> list[float]:
        turn = self._turn(branch)
        return [time for time in turn if time is not None and time < self._found]

    # --- asking ---------------------------------------------------------------------------

    def _ask(self, run: _Run, since: float, questions: Sequence[_Question]) -> None:
        """Ask about times in one copy of the run, unless the journal knows.

        Args:
            run: which goes on to ``since`` if it is behind.
            since: time before which nothing will be asked any more [s].
            questions: in any order.
        """
        questions = sorted(questions, key=lambda question: question.time)
        is_known = True

        def known(question: _Question, number: int, key: str) -> RewoundCopy | None:
            nonlocal is_known
            copy = self._journal.answers.get(key)
            is_known = is_known and copy is not None
            return copy

        self._tallies(questions, known, self._spending())
        if not is_known:
            since = min(since, *(question.time for question in questions))
            told = run.in_a_copy(since, lambda running: self._rows(running, questions))
            for key, copy in zip(told.keys, told.copies, strict=True):
                self._journal.keep(key, copy)
        chances = self._tallies(questions, known, self._spend)
        for question, tally in zip(questions, chances, strict=True):
            self._chances.setdefault(question.branch, {})[question.time] = tally.chance

    def _rows(self, running: Running, questions: Sequence[_Question]) -> _Rows:
        """Run the copies that are missing; called in a copy of the process."""
        rows: list[_Row] = []

        def answered(question: _Question, number: int, key: str) -> RewoundCopy:
            nonlocal running
            copy = self._journal.answers.get(key)
            if copy is None:
                running = running.at(question.time)
                copy = self._run(running, question.branch, number)
                rows.append(_Row(key, copy))
            return copy

        self._tallies(questions, answered, self._spending())
        return _Rows(keys=tuple(r.key for r in rows), copies=tuple(r.copy for r in rows))

    def _tallies(
        self,
        questions: Sequence[_Question],
        answer: Callable[[_Question, int, str], RewoundCopy | None],
        spend: Callable[[str], bool],
    ) -> list[Tally]:
        """Count the copies of each question until there are enough, or no more to be had."""
        tallies = []
        for question in questions:
            tally = Tally()
            for number in range(1, MANY + 1):
                key = codec.digest([self._asked, question.branch, question.time, number])
                if not spend(key):
                    break
                copy = answer(question, number, key)
                if copy is None:
                    break
                tally.add(failed=copy.failed, answered=copy.answered)
                if tally.is_settled if question.settled else tally.is_enough:
                    break
            tallies.append(tally)
        return tallies

    def _spend(self, key: str) -> bool:
        """Count a copy, once; False: there are no runs left."""
        if key in self._counted:
            return True
        if self._count.left <= 0:
            return False
        if key in self._journal.answers:
            self._counted.add(key)
            self._count.add()
        return True

    def _spending(self) -> Callable[[str], bool]:
        """Count as :meth:`_spend` would, without doing so."""
        seen: set[str] = set()

        def spend(key: str) -> bool:
            if key not in self._counted:
                if key not in seen and len(seen) >= self._count.left:
                    return False
                seen.add(key)
            return True

        return spend

    def _run(self, running: Running, branch: Branch, number: int) -> RewoundCopy:
        def continued() -> RewoundCopy:
            return _continued(running, self._failure, branch, number)

        try:
            return running.in_a_copy(continued, RewoundCopy)
        except CopyFailed:  # the changed stack brought it down: that cures nothing
            return RewoundCopy(failed=True, answered=True)


class _Run:
    """The run of a job, which is begun when a copy of it is wanted and goes forward from there."""

    def __init__(self, job: Job, failure: Failure, stack: ExitStack) -> None:
        self._job, self._failure, self._stack = job, failure, stack
        self._running: Running | None = None
        self._time = 0.0  # that it has reached [s]

    def in_a_copy(self, since: float, ask: Callable[[Running], _Rows]) -> _Rows:
        """Ask in a copy of the run, which begins at ``since`` [s].

        Raises:
            CannotRewindError: no copy of the run can go on with small differences.
        """
        running = self.at(since)
        try:
            return running.in_a_copy(lambda: ask(running), _Rows)
        except CopyFailed as failed:
            raise CannotRewindError(f"the whole run: {failed.message}") from failed

    def at(self, time: float) -> Running:
        """Go on to a time [s], or begin anew if that has passed.

        Raises:
            CannotRewindError: no copy of the run can go on with small differences.
        """
        if self._running is None or time < self._time:
            self._stack.close()
            begun = run_until(self._job, self._failure, time)
            self._running = self._stack.enter_context(begun)
            self._check(self._running)
        self._running, self._time = self._running.at(time), time
        return self._running

    def _check(self, running: Running) -> None:
        if not forking.can_fork():
            raise CannotRewindError("the whole run: no process can be copied with a window open")
        if not running.episode.can_copy:
            raise CannotRewindError("the whole run: the stack cannot be copied while it runs")
        if not running.episode.can_nudge:
            name = self._job.config.engine.name
            raise CannotRewindError(f"the whole run: the engine {name} cannot move robots a little")


def _continued(running: Running, failure: Failure, branch: Branch, number: int) -> RewoundCopy:
    """Go on as a branch says; called in a copy of the process."""
    episode = running.episode

    def change() -> None:
        episode.nudge(number)
        if branch.config is not None:
            episode.swap(branch.config)
        if branch.robot is not None:
            episode.remove(branch.robot)

    ended = go_on(running, failure, change, without=branch.robot)
    # a robot that is gone fails at nothing
    others = [v for v in ended.failed if not v.who or set(v.who) - {branch.name}]
    return RewoundCopy(failed=bool(others), answered=not ended.unjudged or bool(others))
