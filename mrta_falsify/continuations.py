"""An episode run to a moment, and gone on with from there in copies of the process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from mrta_falsify.core import codec
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Specification
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.trial import Job
from simulator_interface import forking
from simulator_interface.forecast import offer_forecasts
from simulator_interface.simulate import Episode

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Running:
    """An episode that has come to a moment."""

    episode: Episode
    frames: Iterator[Frame]  #: from the next one on
    specifications: tuple[Specification, ...]  #: that have seen all until then
    last: Frame

    def in_a_copy(self, run: Callable[[], T], kind: type[T]) -> T:
        """``run()`` in a copy of this process, which is as it was afterwards.

        Args:
            run: may go on with the episode.
            kind: of its answer.

        Raises:
            HarnessError: the copy failed.
        """
        data = forking.answer_of_a_copy(lambda: codec.encode(run()))
        return codec.decode(kind, data, where="re-run")


@contextmanager
def run_to(job: Job, time: float) -> Iterator[Running]:
    """The episode of a job at the first tick not before ``time`` [s]."""
    specifications = build_specifications(job.specifications)
    episode = Episode(job.world, job.config)
    for specification in specifications:
        specification.start(job.world, episode.dt)
    frames = episode.frames()
    offer_forecasts(specifications, episode, frames)
    try:
        for frame in frames:
            for specification in specifications:
                specification.update(frame)
            if frame.sensed.time >= time:
                break
        yield Running(episode=episode, frames=frames, specifications=specifications, last=frame)
    finally:
        frames.close()
