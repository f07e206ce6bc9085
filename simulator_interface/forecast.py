"""What would come of an episode if nothing more happened from outside?

The answer is found by going on with a copy of the episode (see :mod:`forking`) in which no
task arrives any more and no blockage or outage begins. Those in force run their course, and
people go on with what they do. One robot may be taken away, to see whom it holds up.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Foreseeing, Watch
from simulator_interface import forking
from simulator_interface.episode import Episode


class EpisodeForecast:
    """Forecasts of one episode, from the frame it has come to (see ``core.protocols.Forecast``).

    Args:
        episode: in progress.
        frames: its frames, at the last of which a forecast begins.
    """

    def __init__(self, episode: Episode, frames: Iterator[Frame]) -> None:
        self._episode = episode
        self._frames = frames

    def __call__(self, watch: Watch, *, without: int = -1) -> dict[str, Any] | None:
        """What ``watch`` sees in a copy of the run.

        Args:
            watch: is shown every frame from the next one on until it has seen enough.
            without: a robot that is taken away, -1: none.

        Returns:
            The watch's answer; None if the engine cannot take robots away.

        Raises:
            HarnessError: the copy failed.
        """
        if without >= 0 and not self._episode.can_remove:
            return None
        parent = os.getpid()

        def run() -> dict[str, Any]:
            self._episode.forget_events()
            if without >= 0:
                self._episode.remove(without)
            for frame in self._frames:
                if watch.update(frame):
                    break
                if os.getppid() != parent:
                    raise HarnessError("the process that asked has ended")
            return watch.answer()

        answer: dict[str, Any] = forking.answer_of_a_copy(run)
        return answer


def offer_forecasts(
    specifications: Iterable[object], episode: Episode, frames: Iterator[Frame]
) -> None:
    """Offer forecasts of an episode to the specifications that want them, if there can be any.

    There are none on a system that does not copy processes safely, and none with a window open.
    """
    if not forking.can_fork() or episode.config.engine.options.get("gui", False):
        return
    forecast = EpisodeForecast(episode, frames)
    for specification in specifications:
        if isinstance(specification, Foreseeing):
            specification.foresee(forecast)
