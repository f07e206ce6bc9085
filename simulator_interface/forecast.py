"""Forecasts: what specifications see in a continuation of an episode.

A continuation is a fork (see :mod:`.forking`) in which no task arrives any more and no blockage
or outage begins. Those in force run their course, and people continue their routes and scripts.
In a counterfactual robots are taken away as well, to see whom they hold up. A nudged
continuation differs a little: robots stand a few millimetres away, and noise falls otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Forecast, Foreseeing, Watch
from mrta_falsify.core.stack_failure import StackFailed
from simulator_interface import forking
from simulator_interface.episode import Episode
from simulator_interface.external.branching import CannotBranch
from simulator_interface.external.conversation import ToldTalk
from simulator_interface.watched_copy import CopyFailed, run_in_watched_copy


class EpisodeForecast:
    """Forecasts of one episode from its last frame (see ``core.protocols.Forecast``).

    Args:
        episode: in progress.
        frames: its frames; a forecast begins at the last one.
    """

    def __init__(self, episode: Episode, frames: Iterator[Frame]) -> None:
        self._episode = episode
        self._frames = frames

    def __call__(
        self, watch: Watch, *, without: Sequence[int] = (), nudge: int = 0
    ) -> dict[str, Any] | None:
        """Show a continuation to ``watch``.

        Args:
            watch: sees every frame from the next one on until it has seen enough.
            without: robots that are taken away.
            nudge: number of a copy with small differences, 0: without any.

        Returns:
            The watch's answer. None if the engine cannot take robots away, or move them, if the
            stack cannot be copied, or if it fails in the continuation: that says nothing of this
            run.

        Raises:
            HarnessError: the copy failed.
        """
        if not self._can(without, nudge):
            return None

        def run() -> dict[str, Any] | None:
            try:
                self._episode.become_copy()
            except CannotBranch:
                return None
            self._episode.forget_events()
            for robot in without:
                self._episode.remove(robot)
            if nudge:
                self._episode.nudge(nudge)
            for frame in self._frames:
                if watch.update(frame):
                    break
            return watch.answer()

        answer: dict[str, Any] | None
        try:
            answer = run_in_watched_copy(run)
        except (StackFailed, CopyFailed):
            answer = None
        if self._episode.outside is not None:
            self._episode.outside.talk.note_forecast(answer)
        return answer

    def _can(self, without: Sequence[int], nudge: int) -> bool:
        """Whether the engine can make such a copy."""
        episode = self._episode
        return (not without or episode.can_remove) and (not nudge or episode.can_nudge)


class ToldForecast:
    """Tells again what an earlier run saw in its copies; its questions come in the same order.

    Args:
        answers: in the order of the questions.
    """

    def __init__(self, answers: Iterable[dict[str, Any] | None]) -> None:
        self._answers = iter(answers)

    def __call__(
        self, watch: Watch, *, without: Sequence[int] = (), nudge: int = 0
    ) -> dict[str, Any] | None:
        """Give the next answer; None: there is none."""
        del watch, without, nudge
        return next(self._answers, None)


def offer_forecasts(
    specifications: Iterable[object], episode: Episode, frames: Iterator[Frame]
) -> None:
    """Offer forecasts of an episode to the specifications that use them.

    None are offered where processes cannot be forked safely, with a window open, or if the stack
    runs elsewhere and cannot be copied.
    """
    forecast = _forecast_of(episode, frames)
    if forecast is None:
        return
    for specification in specifications:
        if isinstance(specification, Foreseeing):
            specification.foresee(forecast)


def _forecast_of(episode: Episode, frames: Iterator[Frame]) -> Forecast | None:
    outside = episode.outside
    if outside is not None and isinstance(outside.talk, ToldTalk):
        return ToldForecast(outside.talk.told().forecasts)
    has_window = episode.config.engine.options.get("gui", False)
    if has_window or not episode.can_copy or not forking.can_fork():
        return None
    return EpisodeForecast(episode, frames)
