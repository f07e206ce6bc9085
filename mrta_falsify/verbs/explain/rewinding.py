"""When a failure was decided: the run repeated from earlier and earlier, with small differences.

One pass of the run stops at each time that is asked about. There copies of it go on, nudged a
little, each as the stack is, with one layer replaced, or without one robot. The times are halved
until it is known when most copies begin to fail (see :mod:`mrta_falsify.core.inevitability`).

Copies are thrifty: three alike settle on which side a time lies while times are halved. The times
next to the turn get more, until the interval of their chance leaves one half out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from mrta_falsify.campaigns.journal import RunJournal
from mrta_falsify.campaigns.statistics import failure_probability
from mrta_falsify.core import codec
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
from mrta_falsify.core.wait_account import first_deadlock
from mrta_falsify.specs.causes import cause_begins
from mrta_falsify.trial import Job, judges_of
from mrta_falsify.verbs.explain.changed_runs import go_on
from mrta_falsify.verbs.explain.changes import SUSPECTS, Change
from mrta_falsify.verbs.explain.run_count import RunCount
from mrta_falsify.verbs.explain.whole_runs import AFTER
from simulator_interface import forking
from simulator_interface.continuation import Running, run_to
from simulator_interface.watched_copy import CopyFailed

REWINDS = 160  # copies, unless the caller says otherwise
FEW, MANY = 3, 12  # copies of a time: alike, they settle its side; at most
FINEST = 0.5  # s, or a hundredth of the run if that is more: times are not halved further
FOR_A_CHANGE = 40  # copies set aside for the curve of a change
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
    members = first_deadlock(verdict.evidence).get("members", ())
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
    verdict: Verdict,
    branches: Sequence[Branch],
    count: RunCount,
    journal: RunJournal[RewoundCopy],
) -> Inevitability | None:
    """Find out when a failure was decided, and by which layer.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        branches: what to replace, the most telling first; the last ones go without if there are
            too few runs left.
        count: of all runs.
        journal: of finished copies.

    Returns:
        None if there is nothing to rewind, or are no runs left for it.
    """
    found = verdict.violated_at if verdict.violated_at is not None else job.world.horizon
    if found <= 0.0 or count.left < FEW:
        return None
    begun = count.done
    left_out = ""
    if job.config.stack is not None and branches:
        branches = []
        left_out = "the layers of a stack in a process of its own, which do not change in mid-run"
    told = _Told(job, verdict, found, count, journal)
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
        onset=min(cause_begins(verdict), found),
        found=found,
        curves=curves,
        decided_at=decision(curves),
        by=first.name if first is not None else "",
        runs=count.done - begun,
        left_out=left_out or _without_room(waiting),
    )


def _without_room(branches: Sequence[Branch]) -> str:
    names = dict.fromkeys(branch.text for branch in branches)
    return f"{', '.join(names)}: the copies were used up (--rewinds)" if names else ""


class _Told:
    """What copies have told, by branch and time."""

    def __init__(
        self,
        job: Job,
        verdict: Verdict,
        found: float,
        count: RunCount,
        journal: RunJournal[RewoundCopy],
    ) -> None:
        self._job, self._verdict, self._found = job, verdict, found
        self._count, self._journal = count, journal
        self._finest = max(FINEST, found / 100.0)
        self._asked = [job.world, job.config, job.specifications, verdict]
        self._stack = Branch(replaced="nothing", text=STACK)
        self._chances: dict[Branch, dict[float, Probability]] = {self._stack: {}}
        self._counted: set[str] = set()  # copies

    def find_turn_of_stack(self) -> None:
        """Ask about the stack as it is until its turn is known, or the copies are used up.

        Raises:
            CannotRewindError: no copy of the run can go on with small differences.
        """
        half = self._tick(self._found / 2.0)
        self._ask([(self._stack, time) for time in (0.0, half)], settled=True)
        self._halve([self._stack])

    def find_turns(self, changed: Sequence[Branch]) -> None:
        """Ask about changes until their turns are known, or the copies are used up."""
        self._ask([(b, b.since) for b in changed])
        self._ask([(b, 0.0) for b in changed if b.since > 0.0 and self._turn(b).open_until is None])
        self._halve(changed)
        helped = {self._turn(branch).open_until for branch in changed}
        self._ask([(self._stack, time) for time in helped if time is not None])

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

    def _halve(self, branches: Sequence[Branch]) -> None:
        """Halve the times around each turn, then make sure of those next to it."""
        while halves := [(b, half) for b in branches if (half := self._half(b)) is not None]:
            if not self._ask(halves):
                return
        self._ask([(b, time) for b in branches for time in self._beside_the_turn(b)], settled=True)

    def _tick(self, time: float) -> float:
        rate = self._job.config.control_rate
        return round(time * rate) / rate

    def _points(self, branch: Branch) -> list[RewoundTo]:
        chances = sorted(self._chances[branch].items())
        points = [RewoundTo(time=time, chance=chance) for time, chance in chances]
        return [point for point in points if point.is_tried]

    def _turn(self, branch: Branch) -> Turn:
        return turn_of(self._points(branch), self._found)

    def _half(self, branch: Branch) -> float | None:
        """Choose the time to ask about next; None: the turn is known well enough."""
        turn = self._turn(branch)
        if turn.open_until is None or turn.lost_from - turn.open_until <= self._finest:
            return None
        half = self._tick((turn.open_until + turn.lost_from) / 2.0)
        return None if half in self._chances[branch] else half

    def _beside_the_turn(self, branch: Branch) -> list[float]:
        turn = self._turn(branch)
        if turn.open_until is None:
            return []
        return [time for time in turn if time is not None and time < self._found]

    def _ask(self, questions: Sequence[tuple[Branch, float]], *, settled: bool = False) -> bool:
        """Ask about times in one pass of the run; False: there are no runs left.

        Args:
            questions: what to replace, from when on [s].
            settled: whether to go on until the interval leaves one half out.
        """
        with ExitStack() as stack:
            run = _Run(self._job, stack)
            for branch, time in sorted(questions, key=lambda question: question[1]):
                self._chances.setdefault(branch, {})[time] = self._chance(
                    run, branch, time, settled=settled
                )
        return self._count.left > 0

    def _chance(self, run: _Run, branch: Branch, time: float, *, settled: bool) -> Probability:
        failed = passed = unknown = 0
        for copy in self._copies(run, branch, time):
            failed += copy.answered and copy.failed
            passed += copy.answered and not copy.failed
            unknown += not copy.answered
            if _is_enough(failed, passed, settled=settled) or unknown >= FEW:
                break
        return failure_probability(failed, failed + passed, undecided=unknown)

    def _copies(self, run: _Run, branch: Branch, time: float) -> Iterator[RewoundCopy]:
        """Run copies until the caller has enough; those in the journal are not run again."""
        for number in range(1, MANY + 1):
            key = codec.digest([self._asked, branch, time, number])
            is_new = key not in self._counted
            if is_new and self._count.left <= 0:
                return
            known = self._journal.answers.get(key)
            if known is None:
                known = self._journal.keep(key, self._run(run.at(time), branch, number))
            if is_new:
                self._counted.add(key)
                self._count.add()
            yield known

    def _run(self, running: Running, branch: Branch, number: int) -> RewoundCopy:
        def continued() -> RewoundCopy:
            return _continued(running, self._verdict, branch, number, self._found + AFTER)

        try:
            return running.in_a_copy(continued, RewoundCopy)
        except CopyFailed:  # the changed stack brought it down: that cures nothing
            return RewoundCopy(failed=True, answered=True)


def _is_enough(failed: int, passed: int, *, settled: bool) -> bool:
    """Whether copies say on which side of one half a chance lies."""
    if not settled:
        return failed + passed >= FEW and (not failed or not passed or failed + passed >= 2 * FEW)
    if failed + passed < 2 * FEW:
        return False
    chance = failure_probability(failed, failed + passed)
    return chance.low > EVEN or chance.high < EVEN


class _Run:
    """The run of a job, which is begun when a copy of it is wanted and goes forward from there."""

    def __init__(self, job: Job, stack: ExitStack) -> None:
        self._job, self._stack = job, stack
        self._running: Running | None = None

    def at(self, time: float) -> Running:
        """Go on to a time [s], not before the last one.

        Raises:
            CannotRewindError: no copy of the run can go on with small differences.
        """
        if self._running is None:
            job = self._job
            begun = run_to(job.world, job.config, judges_of(job), time)
            self._running = self._stack.enter_context(begun)
            self._check(self._running)
        self._running = self._running.at(time)
        return self._running

    def _check(self, running: Running) -> None:
        if not forking.can_fork():
            raise CannotRewindError("the whole run: no process can be copied with a window open")
        if not running.episode.can_copy:
            raise CannotRewindError("the whole run: the stack cannot be copied while it runs")
        if not running.episode.can_nudge:
            name = self._job.config.engine.name
            raise CannotRewindError(f"the whole run: the engine {name} cannot move robots a little")


def _continued(
    running: Running, verdict: Verdict, branch: Branch, number: int, until: float
) -> RewoundCopy:
    """Go on as a branch says; called in a copy of the process."""
    episode = running.episode

    def change() -> None:
        episode.nudge(number)
        if branch.config is not None:
            episode.swap(branch.config)
        if branch.robot is not None:
            episode.remove(branch.robot)

    ended = go_on(running, verdict, until, change)
    # a robot that is gone fails at nothing
    others = [v for v in ended.violated if not v.who or set(v.who) - {branch.name}]
    return RewoundCopy(failed=bool(others), answered=not ended.unjudged or bool(others))
