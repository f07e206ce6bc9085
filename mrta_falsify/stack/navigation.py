"""From waypoints to paths: the shared planning service and each robot's way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.protocols import CostmapSource, Planner
from mrta_falsify.stack.control.lookahead import remaining_path

WAYPOINT_REACHED = 1.0  # m, MRTA-Sim
ROOM_REACHED = 0.3  # m, MRTA-Sim
SPOT_REACHED = 0.2  # m
OFF_PATH = 0.5  # m beside the path: plan again
RETRY = 2.0  # s between plans that fail, and while a robot is stuck
PARKED_AFTER = 5.0  # s at rest: an obstacle for the others
NO_POINTS = np.zeros((0, 2))
NO_POINTS.setflags(write=False)


@dataclass(slots=True)
class Way:
    """Where a robot is going and how; part of the stack's memory."""

    route: Array = field(default_factory=lambda: NO_POINTS)  #: waypoints still to visit
    path: Array = field(default_factory=lambda: NO_POINTS)  #: planned, to the next two
    must_plan: bool = False
    plan_at: float = 0.0  #: not before this time [s]
    failed: str = ""  #: why there is no path
    map_number: int = -1  #: costmap that the path was checked on

    def head_for(self, route: Array) -> None:
        """Take up a new route; the old path stays until there is a new one."""
        self.route, self.must_plan, self.plan_at = route, True, 0.0

    def stop(self) -> None:
        """Stay here."""
        self.route, self.path, self.must_plan, self.failed = NO_POINTS, NO_POINTS, False, ""

    @property
    def is_going(self) -> bool:
        """Whether there is somewhere to go."""
        return len(self.route) > 0


@dataclass(slots=True)
class ServiceState:
    """Memory of the planning service."""

    parked: Array = field(default_factory=lambda: NO_POINTS)  #: (P, 2) robots at rest
    blocked_until: float = 0.0  #: `planner_failure_blocks_all` holds everybody up until then


class PlanningService:
    """One planner for all robots."""

    def __init__(self, planner: Planner, source: CostmapSource, *, failure_blocks: bool) -> None:
        self._planner = planner
        self._source = source
        self._failure_blocks = failure_blocks
        self._with_parked: Costmap | None = None
        self._bare: Costmap | None = None
        self.map_number = 0  #: changes with the map

    def look(self, state: ServiceState, time: float) -> None:
        """Take up the map of the moment."""
        bare = self._source.costmap(time, NO_POINTS)
        full = self._source.costmap(time, state.parked) if len(state.parked) else bare
        if full is not self._with_parked or bare is not self._bare:
            self._with_parked, self._bare = full, bare
            self.map_number += 1

    def plan(self, state: ServiceState, way: Way, position: Array, time: float) -> bool:
        """Plan ``way`` from ``position`` through its next two waypoints; says if that worked."""
        if state.blocked_until > time:
            return False
        way.must_plan, way.map_number = False, self.map_number
        for costmap in (self._with_parked, self._bare):
            assert costmap is not None
            path, reason = self._path(costmap, position, way.route)
            if not reason:
                way.path, way.failed, way.plan_at = path, "", time + RETRY
                return True
        way.path, way.failed = NO_POINTS, reason
        way.must_plan, way.plan_at = True, time + RETRY
        if self._failure_blocks:
            state.blocked_until = time + 10.0  # MRTA-Sim: 100 retries, 0.1 s each
        return False

    def _path(self, costmap: Costmap, position: Array, route: Array) -> tuple[Array, str]:
        self._planner.use(costmap)
        first = self._planner.plan(position, route[0])
        if not first.found and len(route) > 1:
            # A waypoint may be covered for now; the one behind it counts.
            first = self._planner.plan(position, route[1])
            return first.path, first.reason
        if not first.found or len(route) == 1:
            return first.path, first.reason
        second = self._planner.plan(first.path[-1], route[1])
        if not second.found:
            return first.path, ""
        return np.vstack([first.path, second.path[1:]]), ""

    def is_obstructed(self, way: Way, position: Array) -> bool:
        """Whether the map has changed so that the path ahead runs into something."""
        if way.map_number == self.map_number or not len(way.path):
            return False
        way.map_number = self.map_number
        assert self._with_parked is not None
        ahead = remaining_path(way.path, position)
        far = ahead[np.hypot(*(ahead - position).T) > 0.4]
        return bool((self._with_parked.cost_at(far) >= INSCRIBED).any())


@njit(cache=True)
def path_length(points: Array) -> float:
    """Length [m] of the polyline ``(K, 2)``."""
    length = 0.0
    for i in range(1, points.shape[0]):
        length += np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return length


def distance_off(path: Array, position: Array) -> float:
    """Distance [m] from ``position`` to the nearest point of ``path`` ``(L, 2)``."""
    rest = remaining_path(path, position)
    return float(np.hypot(*(rest[0] - position))) if len(rest) else np.inf
