"""A run goes on before it knows the answer to a question about its own future.

What a continuation would show, the run shows itself, as long as nothing comes from outside. So a
question whose answer is expected to be the harmless one costs a checkpoint instead of a second
simulation of the same future. If the answer proves to be another, the run is taken back to the
question (see :mod:`.checkpoint`). Where something comes from outside, or the run ends, before the
answer is known, a copy that goes on without it finds the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import SpeculativeWatch
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.specs.deadlock.counterfactual import begin_times
from simulator_interface.checkpoint import Checkpoint, Resumed, set_checkpoint
from simulator_interface.episode import Episode
from simulator_interface.heartbeat import post
from simulator_interface.watched_copy import CopyFailed, run_in_watched_copy

MOST_OPEN = 6  # questions; each keeps a copy of all memory that the run has changed since
SAME_TIME = 1e-9  # s


class _Open(NamedTuple):
    """A question that is not answered yet."""

    watch: SpeculativeWatch
    checkpoint: Checkpoint
    tick: int  #: at which it was asked


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
        self._open: list[_Open] = []

    def takes(self, watch: SpeculativeWatch) -> bool:
        """Whether the run may go on before it knows the answer of ``watch``."""
        is_free = post().may_roll_back and len(self._open) < MOST_OPEN
        return is_free and watch.expected is not None

    def ask(self, watch: SpeculativeWatch) -> dict[str, Any] | None:
        """Give the expected answer, and go on; where that was wrong, the right one.

        Args:
            watch: it is shown all further frames of the run.
        """
        point = set_checkpoint()
        if isinstance(point, Resumed):
            self._open.clear()  # those from before have been answered as expected
            answer: dict[str, Any] | None = point.answer
            return answer
        self._open.append(_Open(watch, point, self._episode.tick))
        return watch.expected

    def note(self, frame: Frame) -> None:
        """Take in a frame of the run, once it has been judged.

        Raises:
            RolledBack: a question proves to have another answer than expected.
        """
        if not self._open:
            return
        for question in tuple(self._open):
            if question.tick < frame.sensed.tick and question.watch.update(frame):
                self._answer(question)
        if self._is_overtaken_after(frame.sensed.time):
            self.settle()

    def settle(self) -> None:
        """Answer all open questions, by a copy that goes on from here without outside events.

        Raises:
            RolledBack: as :meth:`note`.
        """
        for question, answer in zip(tuple(self._open), self._foretold(), strict=True):
            if answer is not None and answer != question.watch.expected:
                self._roll_back(question, answer)
            self._close(question)

    def drop(self) -> None:
        """Forget all open questions: the run has become meaningless, or has ended."""
        for question in tuple(self._open):
            self._close(question)

    def _is_overtaken_after(self, time: float) -> bool:
        """Whether something comes from outside before the next frame is over."""
        first, last = np.searchsorted(
            self._begins, [time + SAME_TIME, time + self._episode.dt + SAME_TIME], side="right"
        )
        return bool(last > first)

    def _answer(self, question: _Open) -> None:
        """Close a question that has its answer; earlier ones come first where it is wrong."""
        if question.watch.is_as_expected():
            self._close(question)
            return
        before = self._open[: self._open.index(question)]
        for earlier, answer in zip(before, self._foretold(before), strict=True):
            if answer is not None and answer != earlier.watch.expected:
                self._roll_back(earlier, answer)
        self._roll_back(question, question.watch.answer())

    def _foretold(self, questions: Sequence[_Open] | None = None) -> list[dict[str, Any] | None]:
        """Find the answers to open questions in a copy; None: the stack fails there."""
        watches = [one.watch for one in (self._open if questions is None else questions)]
        if not watches:
            return []
        try:
            answers: list[dict[str, Any] | None] = run_in_watched_copy(lambda: self._go_on(watches))
        except (StackFailed, CopyFailed):
            answers = [None] * len(watches)
        return answers

    def _roll_back(self, question: _Open, answer: dict[str, Any] | None) -> None:
        """Go back to a question.

        Raises:
            RolledBack: always.
        """
        self._open.remove(question)
        self.drop()
        raise question.checkpoint.roll_back(answer)

    def _close(self, question: _Open) -> None:
        self._open.remove(question)
        question.checkpoint.drop()
