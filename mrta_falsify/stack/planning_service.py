"""From waypoints to paths: one planner shared by all robots, and each robot's way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.protocols import CostmapSource, Planner
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.stack.control.lookahead import project_on_path, remaining_path

OFF_PATH = 0.5  # m beside the path: plan again
RETRY = 2.0  # s between plans that fail, and while a robot is stuck
PARKED_AFTER = 5.0  # s at rest: an obstacle for the others
PARKED_SHIFT = 0.1  # m, localisation noise below this leaves the map as it is
SERVICE_BLOCKED = 10.0  # s, MRTA-Sim's wrapper: 100 retries, 0.1 s each
OWN_BODY = 0.5  # m of path beside the robot itself that are not checked
NO_POINTS = np.zeros((0, 2))
NO_POINTS.setflags(write=False)


@dataclass(slots=True)
class Way:
    """Where a robot is going and how; part of the stack's memory."""

    route: Array = field(default_factory=lambda: NO_POINTS)  #: (K, 2) waypoints still to visit
    path: Array = field(default_factory=lambda: NO_POINTS)  #: (L, 2) planned, to the next two
    why: str = ""  #: reason for which a plan is due, "" if none is
    plan_at: float = 0.0  #: no other try before this time [s]
    failed: str = ""  #: why there is no path
    failed_since: float = np.inf  #: [s]
    version: int = -1  #: map that the path was last checked on

    def head_for(self, route: Array) -> None:
        """Take up a new route ``(K, 2)``; the old path stays until there is a new one."""
        self.route, self.why, self.plan_at = route, "new route", 0.0
        self.failed, self.failed_since = "", np.inf

    def stop(self) -> None:
        """Stay here."""
        self.route, self.path, self.why = NO_POINTS, NO_POINTS, ""
        self.failed, self.failed_since = "", np.inf

    @property
    def is_going(self) -> bool:
        """Whether there is somewhere to go."""
        return len(self.route) > 0

    @property
    def is_starting(self) -> bool:
        """Whether the first plan of a route is still to come."""
        return self.is_going and not len(self.path) and not self.failed


@dataclass(slots=True)
class ServiceState:
    """Memory of the planning service; caches of the planner are not part of it."""

    parked: list[int] = field(default_factory=list)  #: robots at rest, ascending
    parked_at: Array = field(default_factory=lambda: NO_POINTS)  #: (P, 2) where they were seen
    epoch: int = -1  #: blockages that were in place
    version: int = 0  #: counts the changes of the map
    blocked_until: float = -np.inf  #: `planner_failure_blocks_all` holds everybody until then


class PlanningService:
    """One planner for all robots; everything that decides is in :class:`ServiceState`."""

    def __init__(
        self, world: World, planner: Planner, source: CostmapSource, *, failure_blocks: bool
    ) -> None:
        self._planner = planner
        self._source = source
        self._failure_blocks = failure_blocks
        blockages = [event for event in world.events if isinstance(event, Blockage)]
        changes = {time for event in blockages for time in (event.start, event.end)}
        self._changes = np.array(sorted(changes))

    def look(self, state: ServiceState, fleet: FleetState) -> None:
        """Take note of robots at rest and of blockages that came or went."""
        epoch = int(np.searchsorted(self._changes, fleet.time, side="right"))
        parked = np.flatnonzero(fleet.parked_for > PARKED_AFTER).tolist()
        places = fleet.pose[parked, :2]
        same = parked == state.parked and (
            not parked or np.abs(places - state.parked_at).max() <= PARKED_SHIFT
        )
        if not same:
            state.parked, state.parked_at = parked, places.copy()
        if not same or epoch != state.epoch:
            state.epoch = epoch
            state.version += 1

    def plan(
        self,
        state: ServiceState,
        way: Way,
        position: Array,
        time: float,
        leaving: frozenset[int],
    ) -> bool:
        """Plan ``way`` through its next two waypoints.

        Robots at rest are obstacles. If nothing leads around them, they are left out of the
        map: they may move.

        Args:
            state: memory of the service.
            way: the robot's way; its path and retry time are set.
            position: ``(2,)`` of the robot [m].
            time: now [s].
            leaving: robots that are no obstacles: the robot itself and those about to go.

        Returns:
            Whether there is a path now.
        """
        if state.blocked_until > time:
            return False
        seen = [k for k, robot in enumerate(state.parked) if robot not in leaving]
        reason = ""
        for places in (state.parked_at[seen], NO_POINTS) if seen else (NO_POINTS,):
            self._planner.use(self._source.costmap(time, places))
            path, route, reason = self._path(position, way.route)
            if not reason:
                way.path, way.route, way.why = path, route, ""
                way.failed, way.failed_since = "", np.inf
                way.plan_at, way.version = time + RETRY, state.version
                return True
        way.path, way.why, way.plan_at = NO_POINTS, "retry", time + RETRY
        way.failed, way.failed_since = reason, min(way.failed_since, time)
        way.version = state.version
        if self._failure_blocks:
            state.blocked_until = time + SERVICE_BLOCKED
        return False

    def _path(self, position: Array, route: Array) -> tuple[Array, Array, str]:
        """Path through the next two waypoints, what is left of the route, reason of failure."""
        first = self._planner.plan(position, route[0])
        if len(route) == 1:
            return first.path, route, first.reason
        if not first.found:  # a waypoint may be covered for now; the one behind it counts
            second = self._planner.plan(position, route[1])
            return second.path, route[1:], second.reason
        second = self._planner.plan(first.path[-1], route[1])
        if not second.found:
            return first.path, route, ""
        return np.concatenate([first.path, second.path[1:]]), route, ""

    def reason_to_replan(
        self, state: ServiceState, robot: int, way: Way, position: Array, time: float
    ) -> str:
        """Why the path of ``robot`` at ``position`` ``(2,)`` no longer serves, "" if it does."""
        if not len(way.path):
            return "no path"
        if distance_off(way.path, position) > OFF_PATH:
            return "off the path"
        if way.version != state.version:
            way.version = state.version
            if self._is_obstructed(state, robot, way.path, position, time):
                return "map changed"
        return ""

    def _is_obstructed(
        self, state: ServiceState, robot: int, path: Array, position: Array, time: float
    ) -> bool:
        seen = [k for k, other in enumerate(state.parked) if other != robot]
        costmap: Costmap = self._source.costmap(time, state.parked_at[seen])
        ahead = remaining_path(path, position)
        far = ahead[np.hypot(*(ahead - position).T) > OWN_BODY]
        return bool((costmap.cost_at(far) >= INSCRIBED).any())


@njit(cache=True)
def path_length(points: Array) -> float:
    """Length [m] of the polyline ``(K, 2)``."""
    length = 0.0
    for i in range(1, points.shape[0]):
        length += np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return length


@njit(cache=True)
def distance_off(path: Array, position: Array) -> float:
    """Distance [m] from ``position`` ``(2,)`` to the nearest point of ``path`` ``(L, 2)``."""
    if path.shape[0] == 0:
        return np.inf
    if path.shape[0] == 1:
        return float(np.hypot(path[0, 0] - position[0], path[0, 1] - position[1]))
    i, share = project_on_path(path, position[0], position[1], 0)
    x = path[i, 0] + share * (path[i + 1, 0] - path[i, 0])
    y = path[i, 1] + share * (path[i + 1, 1] - path[i, 1])
    return float(np.hypot(x - position[0], y - position[1]))
