"""Ways that a task needs and that are shut, or narrower than robots plan for, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mrta_falsify.core.words import listed

WALLS = "walls"


@dataclass(frozen=True, slots=True, kw_only=True)
class TightWay:
    """A way that a task needs and that is too narrow."""

    task: int  #: number
    room: str  #: that cannot be entered, or left
    by: tuple[str, ...]  #: names of the things that make it narrow; empty: walls alone
    gap: float  #: its narrowest place [m], on the best way
    needed: float  #: width [m] of what is to pass

    @property
    def is_shut_by(self) -> str:
        """Say it as in ``ward_1 is shut by trolley_1``."""
        return f"{self.room} is shut by {things_text(self.by)}"

    @property
    def is_only(self) -> str:
        """Say it as in ``only 0.41 m at ward_1``."""
        return f"only {self.gap:.2f} m at {self.room}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TightCount:
    """In how many worlds the same things make the ways to one room too narrow."""

    room: str
    by: tuple[str, ...]  #: empty: walls alone
    worlds: int
    gaps: tuple[float, float]  #: narrowest and widest [m] among these worlds


def counted(worlds: Iterable[Sequence[TightWay]]) -> tuple[TightCount, ...]:
    """Count worlds by room and things, the most frequent first.

    Args:
        worlds: for each, the ways that are too narrow.
    """
    counts: Counter[tuple[str, tuple[str, ...]]] = Counter()
    gaps: dict[tuple[str, tuple[str, ...]], list[float]] = {}
    for ways in worlds:
        counts.update({(way.room, way.by) for way in ways})
        for way in ways:
            gaps.setdefault((way.room, way.by), []).append(way.gap)
    ordered = sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))
    return tuple(
        TightCount(room=key[0], by=key[1], worlds=count, gaps=(min(gaps[key]), max(gaps[key])))
        for key, count in ordered
    )


def things_text(things: Sequence[str]) -> str:
    """Write the names of things as in ``bed_1, cart_2 and trolley_1``; none: the walls."""
    return listed(things or (WALLS,))
