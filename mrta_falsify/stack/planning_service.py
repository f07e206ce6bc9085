"""From waypoints to paths: the shared planning service and each robot's way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, ByteArray
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.fleet import PARKED_AFTER
from mrta_falsify.core.polyline import point_ahead, project_on_path
from mrta_falsify.core.protocols import CostmapSource, Planner

WAYPOINT_REACHED = 1.0  # m, MRTA-Sim
ROOM_REACHED = 0.3  # m, MRTA-Sim
SPOT_REACHED = 0.2  # m
OFF_PATH = 0.5  # m beside the path: plan again
RETRY = 2.0  # s between plans that fail, and while a robot is stuck
PARKED_MOVED = 0.3  # m, more than six times a localisation error of 0.05 m
BESIDE_SELF = 0.5  # m of the path's beginning that are not checked: the robot is there already
NO_POINTS = np.zeros((0, 2))
NO_POINTS.setflags(write=False)


@dataclass(slots=True)
class Way:
    """Where a robot is going and how; part of the stack's memory."""

    route: Array = field(default_factory=lambda: NO_POINTS)  #: waypoints still to visit
    path: Array = field(default_factory=lambda: NO_POINTS)  #: planned, to the next two
    halt: Array = field(default_factory=lambda: NO_POINTS)  #: (1, 2) waiting spot to go to first
    must_plan: bool = False
    plan_at: float = 0.0  #: not before this time [s]
    failed: str = ""  #: why there is no path
    through_parked: bool = False  #: the path found no way around robots at rest
    parked_number: int = -1  #: which robots were at rest when the path was found

    def head_for(self, route: Array) -> None:
        """Take up a new route; the robot waits until there is a path."""
        self.route, self.path, self.halt = route, NO_POINTS, NO_POINTS
        self.must_plan, self.plan_at, self.failed = True, 0.0, ""

    def halt_at(self, spot: Array) -> None:
        """Go to a waiting spot ``(2,)`` first; the route is for later."""
        self.halt, self.path = np.array(spot, dtype=np.float64).reshape(1, 2), NO_POINTS
        self.must_plan, self.plan_at = True, 0.0

    def go_on(self) -> None:
        """End of the halt: back to the route."""
        if len(self.halt):
            self.halt, self.path = NO_POINTS, NO_POINTS
            self.must_plan, self.plan_at = True, 0.0

    def stop(self) -> None:
        """Stay here."""
        self.route, self.path, self.halt = NO_POINTS, NO_POINTS, NO_POINTS
        self.must_plan, self.failed = False, ""

    @property
    def is_going(self) -> bool:
        """Whether there is somewhere to go."""
        return len(self.route) > 0


@dataclass(slots=True)
class ServiceState:
    """Memory of the planning service."""

    parked: dict[int, Array] = field(default_factory=dict)  #: robots at rest, place (2,) [m]
    parked_number: int = 0  #: changes with ``parked``
    blocked_until: float = 0.0  #: `planner_failure_blocks_all` holds everybody up until then

    def note_parked(self, position: Array, parked_for: Array) -> None:
        """Robots at rest for some seconds become obstacles of the map.

        Args:
            position: ``(N, 2)`` as localised [m].
            parked_for: ``(N,)`` time at rest [s].
        """
        for robot, rest in enumerate(parked_for.tolist()):
            known = self.parked.get(robot)
            if rest <= PARKED_AFTER:
                if known is not None:
                    del self.parked[robot]
                    self.parked_number += 1
            elif known is None or np.abs(position[robot] - known).max() > PARKED_MOVED:
                self.parked[robot] = position[robot].copy()
                self.parked_number += 1


class PlanningService:
    """One planner for all robots; it has no memory that decides anything."""

    def __init__(self, planner: Planner, source: CostmapSource, *, failure_blocks: bool) -> None:
        self._planner = planner
        self._source = source
        self._failure_blocks = failure_blocks

    def plan(self, state: ServiceState, way: Way, position: Array, time: float) -> bool:
        """Plan ``way`` from ``position`` through its next two waypoints; says if that worked.

        A way around robots at rest is preferred to one through them.
        """
        if state.blocked_until > time:
            return False
        way.must_plan, way.parked_number = False, state.parked_number
        route = way.halt if len(way.halt) else way.route
        maps = (True, False) if state.parked else (False,)
        for with_parked in maps:
            path, skipped, reason = self._path(
                self._map(state, time, with_parked=with_parked), position, route
            )
            if not reason:
                way.path, way.failed, way.plan_at = path, "", time + RETRY
                way.through_parked = bool(state.parked) and not with_parked
                if not len(way.halt):
                    way.route = route[skipped:]
                return True
        way.path, way.failed = NO_POINTS, reason
        way.must_plan, way.plan_at = True, time + RETRY
        if self._failure_blocks:
            state.blocked_until = time + 10.0  # MRTA-Sim: 100 retries, 0.1 s each
        return False

    def _map(self, state: ServiceState, time: float, *, with_parked: bool) -> Costmap:
        places = NO_POINTS
        if with_parked and state.parked:
            places = np.array([state.parked[robot] for robot in sorted(state.parked)])
        return self._source.costmap(time, places)

    def _path(self, costmap: Costmap, position: Array, route: Array) -> tuple[Array, int, str]:
        """Path, how many waypoints it leaves out because they are covered, reason of failure."""
        self._planner.use(costmap)
        skipped = 0
        first = self._planner.plan(position, route[0])
        while first.reason == "goal-blocked" and skipped + 1 < len(route):
            skipped += 1
            first = self._planner.plan(position, route[skipped])
        if first.reason == "unreachable" and skipped + 1 < len(route):
            skipped = len(route) - 1
            first = self._planner.plan(position, route[-1])
        if not first.found or skipped + 1 == len(route):
            return first.path, skipped, first.reason
        second = self._planner.plan(first.path[-1], route[skipped + 1])
        if not second.found:
            return first.path, skipped, ""
        return np.vstack([first.path, second.path[1:]]), skipped, ""

    def is_obstructed(self, state: ServiceState, way: Way, position: Array, time: float) -> bool:
        """Whether the path ahead runs into something on the map of the moment.

        A path through robots at rest is tried anew when other robots are at rest.
        """
        if way.through_parked and way.parked_number != state.parked_number:
            return True
        costmap = self._map(state, time, with_parked=not way.through_parked)
        return len(way.path) > 1 and _meets_obstacle(
            way.path,
            position,
            costmap.cost,
            costmap.resolution,
            costmap.origin[0],
            costmap.origin[1],
        )


@njit(cache=True)
def _meets_obstacle(
    path: Array, position: Array, cost: ByteArray, resolution: float, west: float, south: float
) -> bool:
    """Whether what is left of ``path`` enters a cell where the robot would touch something."""
    x, y = position[0], position[1]
    segment, share = project_on_path(path, x, y, 0)
    ax = path[segment, 0] + share * (path[segment + 1, 0] - path[segment, 0])
    ay = path[segment, 1] + share * (path[segment + 1, 1] - path[segment, 1])
    for i in range(segment + 1, path.shape[0]):
        bx, by = path[i, 0], path[i, 1]
        steps = max(1, int(np.ceil(np.hypot(bx - ax, by - ay) / resolution)))
        for k in range(1, steps + 1):
            px, py = ax + (bx - ax) * k / steps, ay + (by - ay) * k / steps
            if (px - x) ** 2 + (py - y) ** 2 <= BESIDE_SELF * BESIDE_SELF:
                continue
            col, row = (
                int(np.floor((px - west) / resolution)),
                int(np.floor((py - south) / resolution)),
            )
            outside = row < 0 or col < 0 or row >= cost.shape[0] or col >= cost.shape[1]
            if outside or cost[row, col] >= INSCRIBED:
                return True
        ax, ay = bx, by
    return False


@njit(cache=True)
def look_along(
    path: Array, x: float, y: float, look_ahead: float
) -> tuple[Array, float, float, float]:
    """What is left of a path, all that a tick needs in one call.

    Args:
        path: ``(L, 2)`` polyline [m], L >= 1.
        x: position [m], map frame.
        y: position [m], map frame.
        look_ahead: distance of the point to steer for [m].

    Returns:
        The rest of the path ``(K, 2)``, the point to steer for (x, y), the rest's length [m].
    """
    if path.shape[0] == 1:
        return path.copy(), path[0, 0], path[0, 1], 0.0
    segment, share = project_on_path(path, x, y, 0)
    if share >= 1.0:
        rest = path[segment + 1 :].copy()
    else:
        rest = path[segment:].copy()
        rest[0] = path[segment] + share * (path[segment + 1] - path[segment])
    target_x, target_y = point_ahead(path, segment, share, x, y, look_ahead)
    return rest, target_x, target_y, path_length(rest)


@njit(cache=True)
def path_length(points: Array) -> float:
    """Length [m] of the polyline ``(K, 2)``."""
    length = 0.0
    for i in range(1, points.shape[0]):
        length += np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return length


@njit(cache=True)
def cut_path(points: Array, distance: float) -> Array:
    """The first ``distance`` [m] of the polyline ``(K, 2)``; its first point at least."""
    left = max(distance, 0.0)
    for i in range(1, points.shape[0]):
        length = np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        if length > left:
            part = points[: i + 1].copy()
            part[i] = points[i - 1] + (points[i] - points[i - 1]) * (left / length)
            return part
        left -= length
    return points.copy()


@njit(cache=True)
def is_near(point: Array, position: Array, distance: float) -> bool:
    """Whether ``point`` is at most ``distance`` [m] away; x and y come first in both."""
    dx, dy = point[0] - position[0], point[1] - position[1]
    return bool(dx * dx + dy * dy <= distance * distance)


@njit(cache=True)
def is_within(points: Array, position: Array, distance: float) -> bool:
    """Whether one of the points ``(K, 2)`` is at most ``distance`` [m] away."""
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - position[0], points[i, 1] - position[1]
        if dx * dx + dy * dy <= distance * distance:
            return True
    return False
