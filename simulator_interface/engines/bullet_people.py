"""The people in a Bullet client: those near robots, and those who overlap one."""

from __future__ import annotations

import math

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
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
from simulator_interface.engines.overlaps import Overlaps
from simulator_interface.engines.sensing import Observer, Surroundings

NEAR_PERSON = 1.0  # m between surfaces, below which a person stands in Bullet's world


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
        self._around = around
        n = len(world.humans)
        self._bodies = [client.add_person(human.radius) for human in world.humans]
        client.column.update(dict.fromkeys(self._bodies, gaps.HUMAN))
        self._is_in = np.zeros(n, dtype=np.bool_)  # stands in Bullet's world
        self._near = np.zeros(n, dtype=np.bool_)
        self._overlaps = Overlaps(fleet, observer, around, self._collide)

    def place(self, human: Array, pose: Array) -> None:
        """Put people at ``human`` ``(H, 2)`` [m]; robots are at ``pose`` ``(N, 3)``.

        Only people near a robot stand in Bullet's world: to move all of them costs too much.
        """
        if not self._bodies:
            return
        around, near = self._around, self._near
        radius, present, reach = around.human_radius, around.present, self._fleet.reach
        if not _fill_near_people(human, radius, present, pose, reach, self._is_in, near):
            return
        for h in np.flatnonzero(near | self._is_in):
            z = 0.5 * (BODY_HEIGHT - CAPSULE_DEPTH) if near[h] else AWAY
            x, y = human[h].tolist()
            self._client.place(self._bodies[h], (x, y, z), NO_TURN)
        self._is_in[:] = near

    def note_arrivals(self, human: Array) -> None:
        """Take in the people who have become present, at ``human`` ``(H, 2)`` [m]."""
        self._overlaps.note_arrivals(human)

    def release_overlaps(self, human: Array) -> None:
        """Let pairs collide that have come apart; the others are in contact."""
        self._overlaps.release(human)

    def _collide(self, robot: int, human: int, enable: bool) -> None:
        self._robots.collide_with(robot, self._bodies[human], enable=enable)


@njit(cache=True)
def _fill_near_people(
    position: Array,
    radius: Array,
    present: BoolArray,
    pose: Array,
    reach: Array,
    was_in: BoolArray,
    near: BoolArray,
) -> bool:
    """Write whether people ``(H,)`` are present and near a robot; say whether any body moves."""
    news = False
    for h in range(len(position)):
        near[h] = False
        for i in range(len(pose)):
            apart = math.hypot(position[h, 0] - pose[i, 0], position[h, 1] - pose[i, 1])
            near[h] = near[h] or apart < radius[h] + NEAR_PERSON + reach[i]
        near[h] = near[h] and present[h]
        news = news or near[h] or was_in[h]
    return news
