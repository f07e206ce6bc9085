"""The people in a Bullet client: those near robots, and those who overlap one."""

from __future__ import annotations

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
from simulator_interface.engines.overlaps import Overlaps
from simulator_interface.engines.sensing import Observer, Surroundings


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
        self._bodies = [client.add_person(human.radius) for human in world.humans]
        client.column.update(dict.fromkeys(self._bodies, gaps.HUMAN))
        self.overlaps = Overlaps(fleet, observer, around, self._collide)

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

    def _collide(self, robot: int, human: int, enable: bool) -> None:
        self._robots.collide_with(robot, self._bodies[human], enable=enable)
