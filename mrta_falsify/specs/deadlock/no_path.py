"""Why a robot has no path: solids, robots at rest, or no reason that the geometry shows."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.goals import Goal
from mrta_falsify.specs.deadlock.occupancy import SOLID_CLEARANCE, SolidGrid
from mrta_falsify.specs.deadlock.queue_edges import queue_edges_from_afar
from mrta_falsify.specs.deadlock.snapshot import FleetSnapshot

UNREACHABLE = "unreachable"  #: ``resource`` of a no-path edge whose goal walls cut off for good
#: m beyond the narrowest body; a planner may leave gaps aside that are wider than a body
ROOM_BESIDE = (0.0, 0.05, 0.1)
KEY_STEP = 0.1  # m or rad; answers are kept for places that agree to this
KEPT_ANSWERS = 256  # answers; all are dropped once there are more


class NoPathReasons:
    """Finds out why robots have no path, and keeps the answers; one object per episode.

    Args:
        world: of the episode.
        space: where its solids are; kept furnished by its owner.
    """

    def __init__(self, world: World, space: SolidGrid) -> None:
        self._world = world
        self._space = space
        self._radius = np.array([robot.radius for robot in world.robots])
        narrowest = min((robot.radius for robot in world.robots), default=SOLID_CLEARANCE)
        self._bodies = [SolidGrid(world, clearance=narrowest + room) for room in ROOM_BESIDE]
        self._known: dict[tuple[int, ...], tuple[BlockedBy, ...]] = {}

    def edges(self, fleet: FleetSnapshot, i: int, goal: Goal) -> list[BlockedBy]:
        """Derive the edges of robot ``i``, which heads for ``goal`` and has no path."""
        resting = [int(j) for j in np.flatnonzero(fleet.still) if j != i]
        key = self._key(fleet, i, resting)
        if key not in self._known:
            if len(self._known) > KEPT_ANSWERS:
                self._known.clear()
            self._known[key] = self._find(fleet, i, resting)
        found = list(self._known[key])
        if goal.resource >= 0 and all(edge.other < 0 and not edge.resource for edge in found):
            return queue_edges_from_afar(fleet, i, goal) or found
        return found

    def _key(self, fleet: FleetSnapshot, i: int, resting: list[int]) -> tuple[int, ...]:
        """Round the places and events that the answer depends on."""
        sensed = fleet.sensed
        places = np.concatenate(
            [
                fleet.intent.goal[i],
                fleet.position[i],
                fleet.position[resting].ravel(),
                sensed.furniture_pose.ravel(),
            ]
        )
        events = enumerate(self._world.events)
        return (
            i,
            *resting,
            -1,
            *(k for k, event in events if event.start <= sensed.time < event.end),
            -1,
            *np.round(places / KEY_STEP).astype(int).tolist(),
        )

    def _find(self, fleet: FleetSnapshot, i: int, resting: list[int]) -> tuple[BlockedBy, ...]:
        time, start, goal = fleet.sensed.time, fleet.position[i], fleet.intent.goal[i]
        gap = 2.0 * float(self._radius[i])
        closing = self._space.closing(start, goal, time)
        if closing is not None:
            return _cut_off_by(i, closing or (UNREACHABLE,))
        still = np.flatnonzero(fleet.still)
        own = int(np.searchsorted(still, i))
        bodies = None
        if not self._space.is_open_among(
            start, goal, time, bodies=fleet.position[still], own=own, gap=gap
        ):
            others = fleet.position[resting]
            bodies = self._space.bodies_closing(start, goal, time, others=others, gap=gap)
        if bodies is None:
            return _cut_off_by(i, self._closing_body(fleet, start, goal) or ("",))
        return tuple(BlockedBy(i, "no-path", resting[k]) for k in bodies)

    def _closing_body(self, fleet: FleetSnapshot, start: Array, goal: Array) -> tuple[str, ...]:
        """Name what leaves no gap for a robot; empty: nothing, or walls."""
        for grid in self._bodies:
            grid.furnish(fleet.sensed.furniture_pose)
            closing = grid.closing(start, goal, fleet.sensed.time)
            if closing is not None:
                return closing
        return ()


def _cut_off_by(i: int, solids: tuple[str, ...]) -> tuple[BlockedBy, ...]:
    return tuple(BlockedBy(i, "no-path", -1, name) for name in solids)
