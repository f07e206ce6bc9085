"""A run goes on before it knows the answer to a question about its own future.

What a continuation would show, the run shows itself, as long as nothing comes from outside. So a
question whose answer is expected to be the harmless one costs a snapshot instead of a second
simulation of the same future. If the answer proves to be another, the run is taken back to the
question (see :mod:`mrta_falsify.process.snapshot`). Where something comes from outside, or the run
ends, before the answer is known, a copy that goes on without it finds the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import SpeculativeWatch
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.snapshot import Snapshot, snapshot
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.process.watch import current_watch
from mrta_falsify.specs.deadlock.counterfactual import begin_times
from simulator_interface.episode import Episode

REUSED_FOR = 30.0  # s for which a snapshot serves later questions, too
MAX_POINTS = 3  # snapshots; each keeps a copy of all memory that the run has changed since
SAME_TIME = 1e-9  # s
UNKNOWN = object()  #: a copy has to be asked


class _Point(NamedTuple):
    """Where the run can be taken up again."""

    snapshot: Snapshot
    tick: int


class _Open(NamedTuple):
    """A question that is not answered yet."""

    watch: SpeculativeWatch
    tick: int  #: at which it was asked
    point: _Point  #: the last one before it

    @property
    def key(self) -> tuple[int, Any]:
        """What it is known by when the run comes to it again."""
        return self.tick, self.watch.question


class Speculation:
    """Questions of one run about its own future.

    Args:
        episode: in progress.
        go_on: continues a copy of the run for watches that have begun, and gives their answers.
    """

    def __init__(
        self,
        episode: Episode,
        go_on: Callable[[Sequence[SpeculativeWatch]], list[dict[str, Any]]],
    ) -> None:
        self._episode = episode
        self._go_on = go_on
        self._begins = begin_times(episode.world)  # of what comes from outside, sorted [s]
        self._points: list[_Point] = []  # as they were made
        self._open: list[_Open] = []  # as they were asked
        self._answered: dict[tuple[int, Any], dict[str, Any]] = {}  # since the first of the points
        self._known: dict[tuple[int, Any], dict[str, Any]] = {}  # answers that a run before found
        self._came_to = -1  # tick that the run before came to

    def takes(self, watch: SpeculativeWatch) -> bool:
        """Whether the run may go on before it knows the answer of ``watch``.

        A run that was taken back does so only once it has come as far as before: where one answer
        was another than expected, the next ones may be, too.
        """
        is_ahead = self._episode.tick > self._came_to
        is_known = (self._episode.tick, watch.question) in self._known
        return (
            current_watch().may_roll_back and watch.expected is not None and (is_ahead or is_known)
        )

    def ask(self, watch: SpeculativeWatch) -> dict[str, Any] | object | None:
        """Give the expected answer, and go on; where that was wrong, the right one.

        Args:
            watch: it is shown all further frames of the run.

        Returns:
            The answer; ``UNKNOWN`` in a run that was taken back farther than to this question.
        """
        key = (self._episode.tick, watch.question)
        point = None if key in self._known else self._point()
        if point is None:
            return self._known.pop(key, UNKNOWN)
        self._open.append(_Open(watch, self._episode.tick, point))
        return watch.expected

    def note(self, frame: Frame) -> None:
        """Take in a frame of the run, before any question is asked at it.

        Raises:
            RolledBack: a question proves to have another answer than expected.
        """
        for question in tuple(self._open):
            if question.watch.update(frame):
                if not question.watch.is_as_expected():
                    self._roll_back(question, question.watch.answer())
                self._close(question, question.watch.expected)

    def look_out(self, time: float) -> None:
        """Answer what something from outside would overtake; call it once a frame is judged.

        Args:
            time: of the frame [s].

        Raises:
            RolledBack: as :meth:`note`.
        """
        if self._open and self._is_overtaken_after(time):
            self.settle()

    def settle(self) -> None:
        """Answer all open questions, by a copy that goes on from here without outside events.

        Raises:
            RolledBack: as :meth:`note`.
        """
        self._settle(tuple(self._open))

    def drop(self) -> None:
        """Forget all open questions: the run has become meaningless, or has ended."""
        self._open.clear()
        self._keep_points(())

    def _point(self) -> _Point | None:
        """Find a snapshot of late, or make one; None: the run has been taken back to it."""
        tick = self._episode.tick
        if self._points and (tick - self._points[-1].tick) * self._episode.dt <= REUSED_FOR:
            return self._points[-1]
        self._keep_points([question.point for question in self._open])
        if len(self._points) >= MAX_POINTS:
            return self._points[-1]
        made = snapshot()
        if isinstance(made, Snapshot):
            self._points.append(_Point(made, tick))
            return self._points[-1]
        self._open.clear()  # those from before have been answered as expected
        self._points.clear()
        self._answered.clear()
        answers, self._came_to = made.answer
        self._known |= answers
        return None

    def _keep_points(self, kept: Collection[_Point]) -> None:
        """Drop all other snapshots."""
        for point in self._points:
            if point not in kept:
                point.snapshot.drop()
        self._points = [point for point in self._points if point in kept]
        if not self._points:
            self._answered.clear()

    def _is_overtaken_after(self, time: float) -> bool:
        """Whether something comes from outside before the next frame is over."""
        first, last = np.searchsorted(
            self._begins, [time + SAME_TIME, time + self._episode.dt + SAME_TIME], side="right"
        )
        return bool(last > first)

    def _settle(self, questions: Sequence[_Open]) -> None:
        for question, answer in zip(questions, self._predicted(questions), strict=True):
            if answer is not None and answer != question.watch.expected:
                self._roll_back(question, answer)
            self._close(question, answer)

    def _predicted(self, questions: Sequence[_Open]) -> list[dict[str, Any] | None]:
        """Find the answers to open questions in a copy; None: the stack fails there."""
        if not questions:
            return []
        watches = [question.watch for question in questions]
        answers: list[dict[str, Any] | None]
        try:
            answers = run_supervised(lambda: self._go_on(watches))
        except (StackFailed, Ending):
            answers = [None] * len(watches)
        return answers

    def _roll_back(self, question: _Open, answer: dict[str, Any]) -> None:
        """Go back to a question, or to one before it that proves wrong, too.

        Raises:
            RolledBack: always.
        """
        point = question.point
        # Only this process can go back to what was asked before the snapshot.
        self._settle([other for other in self._open if other.point.tick < point.tick])
        told = self._answered | {question.key: answer}, self._episode.tick
        self._open.clear()
        self._keep_points([point])
        self._points.clear()  # the last one becomes the run
        raise point.snapshot.rollback(told)

    def _close(self, question: _Open, answer: dict[str, Any] | None) -> None:
        """Take in the answer to a question; None: there is none to be had."""
        self._open.remove(question)
        if answer is not None:
            self._answered[question.key] = answer
