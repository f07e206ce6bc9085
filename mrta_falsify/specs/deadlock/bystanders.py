"""Furniture and people: where they are, and since when they have stood there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame, Sensed
from mrta_falsify.core.world import World

AWAY = 1e9  # m, coordinate of who or what is not in the building
STANDS_WITHIN = 0.05  # m or rad from a place; who stays within it stands there
WALKS_BEYOND = 0.5  # m from a place; who gets there walks on


@dataclass(frozen=True, slots=True, kw_only=True)
class Bystanders:
    """Movable furniture and people at one moment."""

    furniture: tuple[tuple[float, float, float, float], ...] = ()
    """F rows: centre x, y [m], turn since the start [rad], and since when it stands there [s]."""
    people: tuple[tuple[float, float, float], ...] = ()
    """H rows: x, y [m], and since when the person stands there [s]; ``AWAY``: not here."""


class BystanderClock:
    """Since when each piece of movable furniture and each person stands; one object per run.

    Args:
        world: of the run.
    """

    def __init__(self, world: World) -> None:
        pieces, people = len(world.movable_furniture()), len(world.humans)
        self._furniture, self._moved = np.full((pieces, 3), np.inf), np.zeros(pieces)
        self._people, self._walked = np.full((people, 2), np.inf), np.zeros(people)

    def update(self, sensed: Sensed) -> None:
        """Take in a look at the run."""
        _note(self._furniture, sensed.furniture_pose, self._moved, sensed.time)
        _note(self._people, sensed.human_position, self._walked, sensed.time)

    def rows(self) -> tuple[Array, Array]:
        """Give the rows of :class:`Bystanders`, ``(F, 4)`` and ``(H, 3)``."""
        return (
            np.column_stack([self._furniture, self._moved]),
            np.column_stack([self._people, self._walked]),
        )


class WalkWatch:
    """Watches whether one of some people walks on in a copy of the run.

    Args:
        people: their numbers.
        seconds: for which it watches [s].
    """

    def __init__(self, people: Sequence[int], seconds: float) -> None:
        self._people, self._seconds = list(people), seconds
        self._began: tuple[float, Array] | None = None  # when [s] and where (K, 2) [m]
        self._walked = False

    def update(self, frame: Frame) -> bool:
        """See :class:`mrta_falsify.core.protocols.Watch`."""
        sensed = frame.sensed
        places = sensed.human_position[self._people]
        if self._began is None:
            self._began = sensed.time, places.copy()
        began, before = self._began
        self._walked = not bool((np.hypot(*(places - before).T) <= WALKS_BEYOND).all())
        return self._walked or sensed.time - began >= self._seconds

    def answer(self) -> dict[str, Any]:
        """Tell whether one ``walked``."""
        return {"walked": self._walked}


def bystanders_of(rows: tuple[Array, Array]) -> Bystanders:
    """Build the value from the rows of a clock."""
    furniture, people = (np.nan_to_num(part, nan=AWAY, posinf=AWAY).tolist() for part in rows)
    return Bystanders(
        furniture=tuple((x, y, turn, at) for x, y, turn, at in furniture),
        people=tuple((x, y, at) for x, y, at in people),
    )


def _note(known: Array, places: Array, since: Array, time: float) -> None:
    """Take in places ``(K, D)``: those that have moved from ``known`` stand since ``time`` [s]."""
    if len(places) != len(known) or not len(known):
        return
    moved = ~(np.abs(places - known).max(axis=1) <= STANDS_WITHIN)
    known[moved], since[moved] = places[moved], time
