"""What is written for another system, and what writes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exported:
    """A world, or a run of it, that is written for another system."""

    world: World
    costmap: Callable[[], Costmap]  #: builds the map that the stack sees, at time 0
    trace: Trace | None = None  #: of the run; None: the format needs none
    verdicts: tuple[Verdict, ...] = ()  #: of the run
    #: builds the map for a picture; None: a component that may not run builds it
    picture_map: Callable[[], Costmap | None] = lambda: None

    def run(self) -> Trace:
        """Give the trace to a format that is of runs."""
        assert self.trace is not None, "the format does not say that it needs a run"
        return self.trace


class Exporter(Protocol):
    """A format of another system, by the name that ``export --format`` takes."""

    of_run: bool  #: whether it needs a run, not only a world
    of_folder: bool  #: whether it is several files in a directory, which is made before

    def write(self, exported: Exported, path: Path) -> tuple[Path, ...]:
        """Write, and list the files.

        Args:
            exported: what.
            path: the file or directory that the user names.

        Raises:
            InputError: it cannot be written in this format, or an extra is missing.
            PlaceError: a file cannot be written.
        """
