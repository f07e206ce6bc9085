"""Robots and people who appeared on top of each other, and do not collide until they are apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from simulator_interface.engines import gaps
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.sensing import Observer, Surroundings

#: lets a robot and a person collide (True), or pass through each other
Collide = Callable[[int, int, bool], None]


class _Overlap(NamedTuple):
    robot: int
    human: int


class Overlaps:
    """Pairs that pass through each other for now; all others collide."""

    def __init__(
        self, fleet: Fleet, observer: Observer, around: Surroundings, collide: Collide
    ) -> None:
        self._fleet = fleet
        self._observer = observer
        self._around = around
        self._collide = collide
        self._was_present: BoolArray = np.zeros(len(around.human_radius), dtype=np.bool_)
        self.pairs: list[_Overlap] = []  #: that pass through each other now

    def note_arrivals(self, human: Array) -> None:
        """Take in the people who have become present, at ``human`` ``(H, 2)`` [m].

        A person who appears on top of a robot must not throw it: the two do not collide until
        they have come apart.
        """
        present = self._around.present
        for h in np.flatnonzero(present & ~self._was_present):
            for i in range(len(self._fleet.models)):
                pair = _Overlap(i, int(h))
                if self._gap(pair, human) < 0.0:
                    self.pairs.append(pair)
                    self._collide(pair.robot, pair.human, False)
        self._was_present = present

    def release(self, human: Array) -> None:
        """Let pairs collide that have come apart; the others are in contact."""
        overlapping = []
        for pair in self.pairs:
            if self._gap(pair, human) >= 0.0:
                self._collide(pair.robot, pair.human, True)
            else:
                overlapping.append(pair)
                self._observer.contact[pair.robot, gaps.HUMAN] = True
        self.pairs = overlapping

    def _gap(self, pair: _Overlap, human: Array) -> float:
        """Gap of a pair's surfaces [m], negative: they overlap."""
        i = pair.robot
        placed, corners = self._observer.placed[i], int(self._fleet.corners[i])
        x, y = human[pair.human]
        radius = self._around.human_radius[pair.human]
        return float(gaps.polygon_point_gap(placed, corners, x, y) - radius)
