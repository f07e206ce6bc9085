"""The people in a Bullet client: those near robots, and those who overlap one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.bullet_client import (
    AWAY,
    BODY_HEIGHT,
    CAPSULE_DEPTH,
    NO_TURN,
    BulletClient,
)
from simulator_interface.engines.bullet_robots import BulletRobots
from simulator_interface.engines.bullet_substeps import Prepared
from simulator_interface.engines.sensing import Observer, Surroundings


class _Overlap(NamedTuple):
    """A robot and a person who do not collide until they have come apart."""

    robot: int
    human: int


class BulletPeople:
    """The people of a world in a client."""

    def __init__(
        self,
        client: BulletClient,
        world: World,
        robots: BulletRobots,
        fleet: Fleet,
        observer: Observer,
        around: Surroundings,
    ) -> None:
        self._client = client
        self._robots = robots
        self._fleet = fleet
        self._observer = observer
        self._around = around
        n = len(world.humans)
        self._bodies = [client.add_person(human.radius) for human in world.humans]
        client.column.update(dict.fromkeys(self._bodies, gaps.HUMAN))
        self._was_present = np.zeros(n, dtype=np.bool_)
        self.overlaps: list[_Overlap] = []  #: of people who appeared on top of a robot

    def place(self, human: Array, prepared: Prepared) -> None:
        """Put people at ``human`` ``(H, 2)`` [m].

        Only people near a robot stand in Bullet's world: to move all of them costs too much.
        """
        near, was_in = prepared.near, prepared.was_in
        for h in (near | was_in).nonzero()[0].tolist():
            z = 0.5 * (BODY_HEIGHT - CAPSULE_DEPTH) if near[h] else AWAY
            x, y = human[h].tolist()
            self._client.place(self._bodies[h], (x, y, z), NO_TURN)
        was_in[:] = near

    # --- overlaps ------------------------------------------------------------------------

    def note_arrivals(self, human: Array) -> None:
        """Take in the people who have become present, at ``human`` ``(H, 2)`` [m].

        A person who appears on top of a robot must not throw it: the two do not collide until
        they have come apart.
        """
        present = self._around.present
        for h in np.flatnonzero(present & ~self._was_present):
            for i in range(len(self._robots)):
                pair = _Overlap(i, int(h))
                if self._gap(pair, human) < 0.0:
                    self.overlaps.append(pair)
                    self._collide(pair, enable=False)
        self._was_present = present

    def release_overlaps(self, human: Array) -> None:
        """Let pairs collide that have come apart; the others are in contact."""
        overlapping = []
        for pair in self.overlaps:
            if self._gap(pair, human) >= 0.0:
                self._collide(pair, enable=True)
            else:
                overlapping.append(pair)
                self._observer.contact[pair.robot, gaps.HUMAN] = True
        self.overlaps = overlapping

    def _gap(self, pair: _Overlap, human: Array) -> float:
        """Gap of a pair's surfaces [m], negative: they overlap."""
        i = pair.robot
        placed, corners = self._observer.placed[i], int(self._fleet.corners[i])
        x, y = human[pair.human]
        radius = self._around.human_radius[pair.human]
        return float(gaps.polygon_point_gap(placed, corners, x, y) - radius)

    def _collide(self, pair: _Overlap, *, enable: bool) -> None:
        self._robots.collide_with(pair.robot, self._bodies[pair.human], enable=enable)
