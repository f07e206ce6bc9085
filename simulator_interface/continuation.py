"""Run an episode to time t, then fork it: continuations from one common past."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.interruption import propagate_interrupts
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.world import World
from mrta_falsify.process.supervisor import run_supervised
from simulator_interface.determinism_check import repeats_of
from simulator_interface.episode import Episode
from simulator_interface.forecast import offer_forecasts

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Running:
    """An episode run to time t, from which continuations begin."""

    episode: Episode
    frames: Iterator[Frame]  #: from the next one on
    specifications: tuple[Specification, ...]  #: that have seen all until then
    last: Frame

    def in_a_copy(self, run: Callable[[], T], kind: type[T]) -> T:
        """Run something in a copy of this process, and leave the episode as it was.

        Args:
            run: what to run; it may continue the episode.
            kind: of its answer.

        Raises:
            HarnessError: the copy failed, or a foreign stack has none.
        """

        def answer() -> Any:
            self.episode.become_copy()
            return codec.encode(run())

        data = run_supervised(answer)
        return codec.decode(kind, data, where="re-run")

    def at(self, time: float) -> Running:
        """Go on to the first tick not before ``time`` [s]; what was here before is used up."""
        frame = self.last
        with propagate_interrupts():
            while frame.sensed.time < time:
                frame = next(self.frames)
                for specification in self.specifications:
                    specification.update(frame)
        return dataclasses.replace(self, last=frame)


@contextmanager
def run_to(
    world: World,
    config: StackConfig,
    specifications: Sequence[Specification],
    time: float,
    *,
    forecasts: bool = True,
) -> Iterator[Running]:
    """Run an episode to its first tick not before ``time`` [s].

    Args:
        world: what to simulate.
        config: the stack under test.
        specifications: that see its frames; they are started here.
        time: when to stop [s].
        forecasts: whether specifications may ask for continuations; without, they only suspect.
    """
    specifications = tuple(specifications)
    episode = Episode(world, config)
    for specification in specifications:
        specification.start(world, episode.dt)
    episode.repeats = repeats_of(specifications, config)
    frames = episode.frames()
    if forecasts:
        offer_forecasts(specifications, episode, frames)
    try:
        with propagate_interrupts():
            first = next(frames)
        for specification in specifications:
            specification.update(first)
        begun = Running(episode=episode, frames=frames, specifications=specifications, last=first)
        yield begun.at(time)
    finally:
        frames.close()
        episode.close()
