"""Forecasts: what specifications see in a continuation of an episode.

A continuation is a fork (see :mod:`mrta_falsify.process`) in which no task arrives any more and no
blockage or outage begins, unless what is to come is asked for. Those in force run their course, and
people continue their routes and scripts.
In a counterfactual robots are taken away as well, to see whom they hold up. A nudged
continuation differs a little: robots stand a few millimetres away, and noise falls otherwise.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.free_space import Disc
from mrta_falsify.core.protocols import (
    Foreseeing,
    ProvingWatch,
    ResumedWatch,
    SpeculativeWatch,
    Watch,
)
from mrta_falsify.core.stack_failure import StackFailed
from mrta_falsify.core.world import World
from mrta_falsify.process.child import can_fork
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import Supervisor, run_supervised
from simulator_interface.engines.robot_models import find_model, inner_disc
from simulator_interface.episode import Episode
from simulator_interface.external.branching import CannotBranch
from simulator_interface.external.session import TranscriptSession
from simulator_interface.external.transcript import QUESTIONS
from simulator_interface.speculation import UNKNOWN, Speculation


class _Run(NamedTuple):
    """What a copy continues."""

    world: World
    config: StackConfig
    series: object | None
    process: int

    def is_same(self, other: _Run) -> bool:
        """Whether a copy of one run is one of the other: nothing has been changed in between."""
        return self.process == other.process and all(
            mine is its for mine, its in zip(self[:3], other[:3], strict=True)
        )


class _Standing(NamedTuple):
    run: _Run
    copy: Supervisor


class _Held(NamedTuple):
    frames: Iterator[Frame]
    watch: ResumedWatch


_held: list[_Held] = []  # in a standing copy: what the next question goes on with, last


def _go_on(question: Any) -> dict[str, Any] | None:
    """Answer another question; called in the standing copy."""
    frames, watch = _held[-1]
    if not watch.resume(question):
        for frame in frames:
            if watch.update(frame):
                break
    return watch.answer()


class EpisodeForecast:
    """Forecasts of one episode from its last frame (see ``core.protocols.Forecast``).

    Questions of one series go to one copy, the standing one, which goes on from where the last
    question left it. It is thrown away once the run has become another.

    Args:
        episode: in progress; it closes the forecasts.
        frames: its frames; a forecast begins at the last one.
        speculates: whether the run may go on before it knows an answer, and be taken back.
    """

    def __init__(
        self, episode: Episode, frames: Iterator[Frame], *, speculates: bool = False
    ) -> None:
        self._episode = episode
        self._frames = frames
        self.is_outside = episode.outside is not None
        self.discs = discs_of(episode.world)
        self._standing: _Standing | None = None
        self.speculation: Speculation | None = None  #: None: the run waits for each answer
        if speculates and episode.outside is None:
            self.speculation = Speculation(episode, self._continue_all)
        episode.at_end.callback(self.close)

    def __call__(
        self, watch: Watch, *, without: Sequence[int] = (), nudge: int = 0, to_come: bool = False
    ) -> dict[str, Any] | None:
        """Show a continuation to ``watch``.

        Args:
            watch: sees every frame from the next one on until it has seen enough.
            without: robots that are taken away.
            nudge: number of a copy with small differences, 0: without any.
            to_come: whether what is still to come from outside comes.

        Returns:
            The watch's answer. None if the engine cannot take robots away, or move them, if the
            stack cannot be copied, or if it fails in the continuation: that says nothing of this
            run.

        Raises:
            HarnessError: the copy failed.
        """
        if not self._can(without, nudge):
            return None
        answer: dict[str, Any] | None
        if isinstance(watch, ProvingWatch):
            watch.take_run(self._episode)
        ahead = self.speculation
        if ahead is not None:
            if isinstance(watch, SpeculativeWatch) and ahead.takes(watch):
                known: Any = ahead.ask(watch)
                if known is not UNKNOWN:
                    return known  # type: ignore[no-any-return]
            ahead.settle()  # of a run that is to be taken back nothing need be asked
        try:
            if isinstance(watch, ResumedWatch) and watch.series is not None:
                answer = self._ask_standing(watch)
            else:
                answer = run_supervised(
                    functools.partial(self._continue, watch, tuple(without), nudge, to_come)
                )
        except (StackFailed, Ending):
            answer = None
        if self._episode.outside is not None:
            self._episode.outside.talk.note_forecast(answer)
        return answer

    def close(self) -> None:
        """End all copies; may be called twice."""
        if self.speculation is not None:
            self.speculation.drop()
        if self._standing is not None:
            self._standing.copy.close()
            self._standing = None

    def _ask_standing(self, watch: ResumedWatch) -> dict[str, Any] | None:
        """Put a question to the standing copy; make one if there is none, or of another run."""
        known, self._standing = self._standing, None
        run = _Run(self._episode.world, self._episode.config, watch.series, os.getpid())
        answer: dict[str, Any] | None = None
        if known is not None and known.run.is_same(run) and known.copy.is_alive():
            call: Callable[[], Any] = functools.partial(_go_on, watch.question)
        else:
            if known is not None:
                known.copy.close()
            known, call = _Standing(run, Supervisor()), functools.partial(self._stand, watch)
        try:
            answer = known.copy.run(call)
        finally:
            if answer is None:
                known.copy.close()
            else:
                self._standing = known
        return answer

    def _stand(self, watch: ResumedWatch) -> dict[str, Any] | None:
        """Answer the first question; called in the standing copy."""
        _held.append(_Held(self._frames, watch))
        return self._continue(watch)

    def _continue_all(self, watches: Sequence[Watch]) -> list[dict[str, Any]]:
        """Go on with the run for watches that have begun; called in a copy of the process."""
        self._episode.forget_events()
        left = list(watches)
        for frame in self._frames:
            left = [watch for watch in left if not watch.update(frame)]
            if not left:
                break
        return [watch.answer() for watch in watches]

    def _continue(
        self, watch: Watch, without: Sequence[int] = (), nudge: int = 0, to_come: bool = False
    ) -> dict[str, Any] | None:
        """Go on with the run; called in a copy of the process."""
        try:
            self._episode.become_copy()
        except CannotBranch:
            return None
        if not to_come:
            self._episode.forget_events()
        for robot in without:
            self._episode.remove(robot)
        if nudge:
            self._episode.nudge(nudge)
        for frame in self._frames:
            if watch.update(frame):
                break
        return watch.answer()

    def _can(self, without: Sequence[int], nudge: int) -> bool:
        """Whether the engine can make such a copy."""
        episode = self._episode
        return (not without or episode.can_remove) and (not nudge or episode.can_nudge)


class RecordedForecast:
    """Tells again what an earlier run saw in its copies; its questions come in the same order.

    Args:
        answers: in the order of the questions.
        discs: N, inside the robots' bodies.
    """

    is_outside = True

    def __init__(self, answers: Iterable[dict[str, Any] | None], discs: tuple[Disc, ...]) -> None:
        self._answers = iter(answers)
        self.discs = discs

    def __call__(
        self, watch: Watch, *, without: Sequence[int] = (), nudge: int = 0, to_come: bool = False
    ) -> dict[str, Any] | None:
        """Give the next answer; None: there is none."""
        del watch, without, nudge, to_come
        return next(self._answers, None)


def discs_of(world: World) -> tuple[Disc, ...]:
    """Find the largest disc inside the body of each robot."""
    return tuple(inner_disc(find_model(robot.model)) for robot in world.robots)


def offer_forecasts(
    specifications: Iterable[object],
    episode: Episode,
    frames: Iterator[Frame],
    *,
    speculates: bool = False,
) -> Speculation | None:
    """Offer forecasts of an episode to the specifications that use them.

    None are offered where processes cannot be forked safely, with a window open, if the stack runs
    elsewhere and cannot be copied, or if an earlier version asked other questions in the run that
    is told again.

    Args:
        specifications: of the run.
        episode: in progress.
        frames: of the episode.
        speculates: whether the run may go on before it knows an answer, and be taken back.

    Returns:
        What is to be shown every frame then; None: the run waits for each answer.
    """
    forecast = _forecast_of(episode, frames, speculates=speculates)
    if forecast is None:
        return None
    for specification in specifications:
        if isinstance(specification, Foreseeing):
            specification.foresee(forecast)
    return forecast.speculation if isinstance(forecast, EpisodeForecast) else None


def _forecast_of(
    episode: Episode, frames: Iterator[Frame], *, speculates: bool
) -> EpisodeForecast | RecordedForecast | None:
    outside = episode.outside
    if outside is not None and isinstance(outside.talk, TranscriptSession):
        told = outside.talk.transcript()
        if told.questions != QUESTIONS:
            return None
        return RecordedForecast(told.forecasts, discs_of(episode.world))
    has_window = episode.config.engine.options.get("gui", False)
    if has_window or not episode.can_copy or not can_fork():
        return None
    return EpisodeForecast(episode, frames, speculates=speculates)
