"""What stands in a robot's way: robots, people and solids on the next metre of its path."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.occupancy import SolidGrid
from mrta_falsify.specs.deadlock.path_ahead import first_conflicts, points_ahead
from mrta_falsify.specs.deadlock.snapshot import FleetSnapshot

PATH_STEP = 0.1  # m between points looked at on a path
ROBOT_REACH = 1.2  # m of path ahead on which a robot is in the way
HUMAN_REACH = 1.5  # m of path ahead on which a person is in the way
SOLID_REACH = 1.0  # m of path ahead on which a solid is in the way
ROBOT_CLEARANCE = 0.65  # m centre to centre: barrier distance 0.6 m and a margin
HUMAN_CLEARANCE = 0.3  # m between a robot's and a person's outline
HUMAN_NEAR = 0.8  # m centre to centre at which a person stops a robot from any side
SAME_PLACE = 0.4  # m of path; obstacles this close behind the first one block as well
PULL_REACH = 0.5  # m of path ahead that says where the robot is drawn to
SOLID_NEAR = 0.7  # m to a solid ahead that may hold a robot off
SOLID_CONE = np.cos(np.radians(75.0))  # of the direction in which the robot is drawn


class Obstruction:
    """Finds what is in a robot's way; one object per episode.

    Args:
        world: of the episode.
        space: where its solids are; kept furnished by its owner.
    """

    def __init__(self, world: World, space: SolidGrid) -> None:
        self._space = space
        self._radius = np.array([robot.radius for robot in world.robots])
        self._human_radius = np.array([human.radius for human in world.humans])

    def edges(self, fleet: FleetSnapshot, i: int) -> list[BlockedBy]:
        """Derive edges to the first obstacles on robot ``i``'s path, else to people beside it."""
        x, y = fleet.position[i]
        ahead = points_ahead(fleet.way(i), x, y, HUMAN_REACH, PATH_STEP)
        others = [j for j in range(len(fleet.position)) if j != i]
        arcs = self._body_arcs(fleet, i, others, ahead)
        solid = ahead[: int(SOLID_REACH / PATH_STEP) + 1]
        hit, name = self._space.solid_at(solid, fleet.sensed.time)
        solid_arc = hit * PATH_STEP if hit >= 0 else np.inf
        first = min(float(arcs.min(initial=np.inf)), solid_arc)
        if not np.isfinite(first):
            near = np.hypot(*(fleet.sensed.human_position - fleet.position[i]).T) <= HUMAN_NEAR
            return [BlockedBy(i, "human", int(h)) for h in near.nonzero()[0]]
        found = []
        for k in (arcs <= first + SAME_PLACE).nonzero()[0]:
            if k < len(others):
                found.append(BlockedBy(i, "barrier", others[k]))
            else:
                found.append(BlockedBy(i, "human", int(k - len(others))))
        if solid_arc <= first + SAME_PLACE:
            found.append(BlockedBy(i, "wall", -1, name))
        return found

    def _body_arcs(self, fleet: FleetSnapshot, i: int, others: list[int], ahead: Array) -> Array:
        """Measure the path [m] to each of ``others``, then to each person; inf: not in the way."""
        x, y = fleet.position[i]
        count = len(others)
        chosen = np.array(others, dtype=np.int64)
        bodies = np.concatenate([fleet.position[chosen], fleet.sensed.human_position])
        clearance = np.concatenate(
            [
                np.full(count, ROBOT_CLEARANCE),
                self._radius[i] + self._human_radius + HUMAN_CLEARANCE,
            ]
        )
        arcs = first_conflicts(ahead, x, y, bodies, clearance, PATH_STEP)
        arcs[:count][arcs[:count] > ROBOT_REACH] = np.inf
        return np.asarray(arcs)

    def is_held_off(self, fleet: FleetSnapshot, i: int) -> bool:
        """Whether a solid lies close ahead, as where a barrier row balances the pull."""
        offset = fleet.sensed.obstacle_points[i] - fleet.position[i]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        near = distance <= SOLID_NEAR
        if not near.any():
            return False
        x, y = fleet.position[i]
        ahead = points_ahead(fleet.way(i), x, y, PULL_REACH, PATH_STEP)
        pull = ahead[-1] - fleet.position[i]
        cosine = (offset[near] @ pull) / (distance[near] * np.hypot(*pull) + 1e-12)
        return bool((cosine >= SOLID_CONE).any())
