"""Run an episode to its end: frames, trace, verdicts and counts.

``frames_of`` yields one :class:`Frame` per control tick; ``simulate`` folds the frames into a
trace and verdicts. Both are functions of (world, configuration): same input, same digest.
"""

from __future__ import annotations

import time as wall_clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mrta_falsify.core.codec import later
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.external import Coupling
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.interruption import HIDES_INTERRUPT, pass_on, propagate_interrupts
from mrta_falsify.core.protocols import JudgingFailures, RepeatingRun, Specification
from mrta_falsify.core.renamed import renamed_attribute, renamed_keywords
from mrta_falsify.core.stack_failure import FailureKind, StackFailed, StackFailure
from mrta_falsify.core.trace import Trace, TraceRecorder
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import Books
from mrta_falsify.specs.contacts import ContactCounter
from mrta_falsify.specs.stack_runs import StackRuns
from simulator_interface.determinism_check import repeats_of
from simulator_interface.episode import Episode
from simulator_interface.external.transcript import Transcript
from simulator_interface.forecast import offer_forecasts
from simulator_interface.speculation import Speculation

#: why an episode ended, by how the stack failed
ENDED_BY: dict[FailureKind, str] = {
    "crash": "stack-crashed",
    "hang": "stack-hung",
    "memory": "stack-took-memory",
    "answer": "stack-answered-nonsense",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskCount:
    """Tasks by how they ended, as the harness's own books say."""

    total: int  #: deliveries that arrive before the horizon
    completed: int  #: reported by the stack and confirmed by motion
    late: int  #: delivered after the deadline, or not at all
    told: bool = later(True)  #: false: the stack reports no deliveries, and the counts mean nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One finished episode."""

    trace: Trace  #: without columns if the trace was not kept; the digest is always there
    verdicts: tuple[Verdict, ...]
    contacts: dict[str, int]  #: robot_robot, robot_human, robot_static, robot_human_at_rest
    tasks: TaskCount
    robots_finished: int  #: robots with nothing aboard that no open task is left to
    ended: str  #: why the episode ended
    sim_time: float  #: simulated [s]
    wall_s: float  #: measured; never part of a digest
    transcript: Transcript | None = None  #: what a foreign stack has said, if it is kept
    coupling: Coupling | None = None  #: of such a stack to simulated time

    def __getattr__(self, name: str) -> Any:
        return renamed_attribute(self, name, {"told": "transcript"})

    def __repr__(self) -> str:
        """Write it in one line."""
        violated = [verdict.spec for verdict in self.verdicts if verdict.violated]
        told = f"violates {', '.join(violated)}" if violated else "violates nothing"
        return f"<Outcome {told}, ended {self.ended} at {self.sim_time:.1f} s>"


def frames_of(world: World, config: StackConfig) -> Iterator[Frame]:
    """Run an episode until its books hold the last delivery or the horizon is reached.

    Args:
        world: what to simulate.
        config: the stack under test.

    Yields:
        One frame per control tick, the first at time 0.

    Raises:
        StackFailed: the stack does not answer a tick, or not properly.
        InputError: the world cannot be run (a start inside a wall) or a layer is unknown.
    """
    _check_unscripted(world)
    running = Episode(world, config)
    for frame in running.frames():
        yield frame
        if _end_of(running, frame):
            return


def _check_unscripted(world: World) -> None:
    if world.scripted:
        raise WorldError(
            f"{world.name}: cannot be run without its Scenic program, because of "
            f"{world.scripted}; run the program: scenic -S FILE.scenic --count 1"
        )


def _end_of(running: Episode, frame: Frame) -> str:
    if running.books.due and running.books.closed:
        return "all-tasks-done"
    if running.world.is_over(frame.sensed.time, running.dt):
        return "horizon"
    return ""


@renamed_keywords(told="transcript")
def simulate(
    world: World,
    config: StackConfig,
    *,
    specifications: Sequence[Specification] = (),
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
    stop: Callable[[Frame], str] | None = None,
    transcript: Transcript | None = None,
) -> Outcome:
    """Run one episode to its end.

    Args:
        world: what to simulate.
        config: the stack under test.
        specifications: folds that score the run; they are started here.
        keep_trace: keep columns and tables; without, the trace has only its digest.
        on_progress: called about once per simulated second with the time [s].
        stop: ends the episode at the first frame for which it returns a reason.
        transcript: what a foreign stack has said; it is not asked again.

    Returns:
        Trace, verdicts and counts.

    Raises:
        InputError: as in :func:`frames_of`.
        KeyboardInterrupt: Ctrl-C; an unfinished episode has no outcome.
    """
    _check_unscripted(world)
    running = EpisodeRun(
        world,
        config,
        specifications=specifications,
        keep_trace=keep_trace,
        stop=stop,
        transcript=transcript,
        speculates=True,
    )
    per_second = config.control_rate
    try:
        while not running.ended:
            frame = running.advance()
            if on_progress is not None and frame.sensed.tick % per_second == 0:
                on_progress(frame.sensed.time)
    finally:
        running.close()
    return running.outcome()


class EpisodeRun:
    """One episode, recorded and judged tick by tick.

    :func:`simulate` advances it to its end, Scenic's simulation by a few ticks per time step.
    Close it whatever happens.

    Args:
        world: what to simulate.
        config: the stack under test.
        specifications: folds that score the run; they are started here.
        keep_trace: keep columns and tables; without, the trace has only its digest.
        stop: ends the episode at the first frame for which it returns a reason.
        transcript: what a foreign stack has said; it is not asked again.
        copies: False where nobody would command the robots in a copy of the run: no forecasts.
        speculates: whether a copy of this process may take its place (see :mod:`.speculation`);
            only if nobody changes the building, or the stack, from outside.

    Raises:
        InputError: as in :func:`frames_of`.
    """

    def __init__(
        self,
        world: World,
        config: StackConfig,
        *,
        specifications: Sequence[Specification] = (),
        keep_trace: bool = True,
        stop: Callable[[Frame], str] | None = None,
        transcript: Transcript | None = None,
        copies: bool = True,
        speculates: bool = False,
    ) -> None:
        self._began = wall_clock.perf_counter()
        self.episode = Episode(world, config, transcript)
        self._keeps_answers = keep_trace
        self.ended = ""  #: why the episode ended, empty: it goes on
        self.frame: Frame | None = None  #: of the last tick
        self._recorder = TraceRecorder(
            world_digest=world.digest(),
            dt=self.episode.dt,
            robots=tuple(robot.name for robot in world.robots),
            humans=tuple(human.name for human in world.humans),
            keep=keep_trace,
        )
        self._contacts = ContactCounter()
        self._contacts.start(world, self.episode.dt)
        # Whatever is asked for, a stack that fails to answer has not passed.
        self._stack_runs = StackRuns(StackRuns.Options())
        self._asked_for = tuple(specifications)
        self._specifications = (*self._asked_for, self._stack_runs)
        for specification in self._specifications:
            specification.start(world, self.episode.dt)
        self._stop = stop
        self._frames = self.episode.frames()
        self._speculation: Speculation | None = None
        if copies:
            self.episode.repeats = repeats_of(self._asked_for, config)
            self._speculation = offer_forecasts(
                self._specifications, self.episode, self._frames, speculates=speculates
            )

    def advance(self) -> Frame:
        """Run the next tick, recorded and judged; the run must not have ended.

        Returns:
            The frame of the tick. Where the stack fails there is none: the run ends, and the
            last frame is given again.
        """
        frame = self.look()
        if not self.ended:
            self.take_in(frame)
        return frame

    def look(self) -> Frame:
        """Run the next tick; it is neither recorded nor judged before :meth:`take_in`.

        Returns:
            As :meth:`advance`.
        """
        try:
            return next(self._frames)
        except StackFailed as failed:
            return self._stack_failed(failed.failure)
        except HIDES_INTERRUPT as error:
            pass_on(error)
            raise

    def take_in(self, frame: Frame) -> None:
        """Record and judge the tick that was looked at last."""
        try:
            if self._speculation is not None:
                self._speculation.note(frame)
            self._recorder.add(frame)
            self._contacts.update(frame)
            for specification in self._specifications:
                specification.update(frame)
            if self._speculation is not None:
                self._speculation.look_out(frame.sensed.time)
        except HIDES_INTERRUPT as error:
            pass_on(error)
            raise
        self.frame = frame
        reason = _end_of(self.episode, frame) or (self._stop(frame) if self._stop else "")
        if reason:
            self.end(reason)

    def _stack_failed(self, failure: StackFailure) -> Frame:
        assert self.frame is not None, "an episode has a frame before its stack fails"
        self.ended = ENDED_BY[failure.kind]
        for specification in self._specifications:
            if isinstance(specification, JudgingFailures):
                specification.stack_failed(failure)
        return self.frame

    def end(self, reason: str) -> None:
        """End the run here, unless it has already; an empty reason ends nothing."""
        if self.ended or not reason:
            return
        self.ended = reason
        with propagate_interrupts():
            if self._speculation is not None:
                self._speculation.settle()
            self._ask_at_end()

    def _ask_at_end(self) -> None:
        """Ask a foreign stack all again, for the specifications that want it."""
        outside = self.episode.outside
        judging = [one for one in self._specifications if isinstance(one, RepeatingRun)]
        if outside is None or not judging:
            return
        again = outside.talk.ask_fresh()
        for specification in judging:
            specification.asked_at_end(again)

    def close(self) -> None:
        """Free the engine, and end the stack's process; may be called twice."""
        self._frames.close()
        self.episode.close()

    def outcome(self) -> Outcome:
        """Sum up the run; call it once, at its end."""
        books, outside = self.episode.books, self.episode.outside
        return Outcome(
            trace=self._recorder.finish(self.ended),
            verdicts=self._verdicts(),
            contacts=self._contacts.totals(),
            tasks=_count_tasks(
                books,
                self.frame.sensed.time if self.frame is not None else 0.0,
                told=self.frame is None or self.frame.tells.deliveries,
            ),
            robots_finished=books.robots_finished(),
            ended=self.ended,
            sim_time=self.frame.sensed.time if self.frame is not None else 0.0,
            wall_s=wall_clock.perf_counter() - self._began,
            transcript=self._transcript(),
            coupling=None if outside is None else outside.talk.ready.coupling,
        )

    def _transcript(self) -> Transcript | None:
        outside = self.episode.outside
        return outside.talk.transcript() if outside is not None and self._keeps_answers else None

    def _verdicts(self) -> tuple[Verdict, ...]:
        verdicts = tuple(specification.verdict() for specification in self._asked_for)
        always = self._stack_runs.verdict()
        if always.violated and always not in verdicts:
            return (*verdicts, always)
        return verdicts


def _count_tasks(books: Books, time: float, *, told: bool) -> TaskCount:
    late = {task for task, margin in books.margins(time).items() if margin < 0.0}
    count = TaskCount(
        total=len(books.due),
        completed=len(books.due) - len(books.open),
        late=len(late.union(books.open)),
    )
    return count if told else replace(count, told=False)
