"""The planning service: one planner for all robots, and which robots are obstacles of its map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, ByteArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.costmap import INSCRIBED, Costmap, cell_at
from mrta_falsify.core.fleet import PARKED_AFTER
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.polyline import project_on_path
from mrta_falsify.core.protocols import CostmapSource, Planner
from mrta_falsify.stack.detours import Closed, Detours
from mrta_falsify.stack.route import RETRY, Way

PARKED_MOVED = 0.3  # m, more than six times a localisation error of 0.05 m
DETOURS = 10  # ways around what is on the way, before one through it is taken
BESIDE_SELF = 0.5  # m of the path's beginning that are not checked: the robot is there already
COMES_BACK = 1.0  # m back along the same line; a robot nearer to a waypoint than that drops it
SAME_LINE = 0.25  # m, half a robot beside a line is on it


class Flaw(IntEnum):
    """What is wrong with a path, the worst last."""

    NOTHING = 0
    ROOM = 1  #: leads through a room that the robot does not hold
    GAP = 2  #: leads through a gap that the barrier shuns
    NO_PATH = 3


class _Found(NamedTuple):
    """What came of planning once."""

    path: Array  #: (L, 2) [m]
    skipped: int  #: waypoints of the route that are left out
    reason: str  #: why there is no path
    flaw: Flaw


@dataclass(slots=True)
class ServiceState:
    """Memory of the planning service."""

    parked: dict[int, Array] = field(default_factory=dict)  #: robots at rest, place (2,) [m]
    parked_number: int = 0  #: changes with ``parked``
    blocked_until: float = 0.0  #: nothing is planned until then [s]

    def note_parked(self, position: Array, parked_for: Array) -> None:
        """Make robots that are at rest for some seconds obstacles of the map.

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
            elif known is None or _has_moved(known, position[robot]):
                self.parked[robot] = position[robot].copy()
                self.parked_number += 1


def _has_moved(known: Array, position: Array) -> bool:
    """Whether a robot at rest is not any more where it was."""
    dx, dy = position[0] - known[0], position[1] - known[1]
    return bool(max(abs(dx), abs(dy)) > PARKED_MOVED)


class PlanningService:
    """One planner for all robots; has no memory that decides anything."""

    def __init__(
        self,
        planner: Planner,
        source: CostmapSource,
        *,
        rooms: Sequence[Array] = (),
    ) -> None:
        """Plan for a fleet.

        Args:
            planner: of all robots.
            source: of maps.
            rooms: outlines ``(V, 2)`` [m] of rooms that robots must ask for; empty: not a room.
        """
        self._planner = planner
        self._source = source
        self._detours = Detours(rooms)

    def plan(
        self,
        state: ServiceState,
        way: Way,
        position: Array,
        time: float,
        not_held: Sequence[int] = (),
    ) -> Way:
        """Plan from ``position`` through the next two waypoints of ``way``.

        A way around robots at rest is preferred to one through them, and so is a way around rooms
        that the robot does not hold and around gaps that a barrier shuns.

        Args:
            state: memory of the service.
            way: to plan for.
            position: ``(2,)`` of the robot [m].
            time: now [s].
            not_held: numbers of rooms that the robot does not hold.

        Returns:
            The way with a path, or with the reason why there is none.
        """
        route = way.halt if len(way.halt) else way.route
        tries: list[tuple[_Found, bool]] = []
        for with_parked in (True, False) if state.parked else (False,):
            costmap = self._map(state, time, with_parked=with_parked)
            tries.append((self._path_around(costmap, position, route, not_held), with_parked))
            if not tries[-1][0].flaw:
                break
        found, with_parked = min(tries, key=lambda tried: tried[0].flaw)
        if found.flaw < Flaw.NO_PATH:
            return replace(
                way,
                route=way.route if len(way.halt) else route[found.skipped :],
                path=found.path,
                must_plan=False,
                plan_at=time + RETRY,
                failed="",
                through_parked=bool(state.parked) and not with_parked,
                parked_number=state.parked_number,
            )
        return replace(
            way,
            path=NO_POINTS,
            must_plan=True,
            plan_at=time + RETRY,
            failed=found.reason,
            parked_number=state.parked_number,
        )

    def _map(self, state: ServiceState, time: float, *, with_parked: bool) -> Costmap:
        places = NO_POINTS
        if with_parked and state.parked:
            places = np.array([state.parked[robot] for robot in sorted(state.parked)])
        return self._source.costmap(time, places)

    def _path_around(
        self, costmap: Costmap, position: Array, route: Array, not_held: Sequence[int]
    ) -> _Found:
        """Do as :meth:`_path`, around rooms and gaps that neither the robot nor the route is in.

        Of ways with a flaw it takes the first with the least.
        """
        found, flawed = self._path(costmap, position, route), list[_Found]()
        ends, closed = np.vstack([position, route]), Closed()
        for _ in range(DETOURS):
            if found.reason:
                break
            flaw, shunned = Flaw.GAP, self._detours.gaps(costmap, found.path, ends)
            if shunned <= closed:
                flaw, shunned = Flaw.ROOM, self._detours.rooms(found.path, ends, not_held)
            if shunned <= closed:  # it may touch the outline of a room that it leads around
                return found
            flawed.append(found._replace(flaw=flaw))
            closed |= shunned
            found = self._path(self._detours.map_without(costmap, closed), position, route)
        return min(flawed, key=lambda one: one.flaw, default=found)

    def _path(self, costmap: Costmap, position: Array, route: Array) -> _Found:
        """Plan a path.

        Waypoints that are covered are left out, and those from which the path comes back on itself.
        """
        self._planner.use(costmap)
        skipped = 0
        first = self._planner.plan(position, route[0])
        while first.reason == "goal-blocked" and skipped + 1 < len(route):
            skipped += 1
            first = self._planner.plan(position, route[skipped])
        if first.reason == "unreachable" and skipped + 1 < len(route):
            skipped = len(route) - 1
            first = self._planner.plan(position, route[-1])
        while first.found and skipped + 1 < len(route):
            second = self._planner.plan(first.path[-1], route[skipped + 1])
            if not second.found:
                break
            if not _comes_back(first.path, second.path):
                path = np.vstack([first.path, second.path[1:]])
                return _Found(path, skipped, "", Flaw.NOTHING)
            skipped += 1
            first = self._planner.plan(position, route[skipped])
        flaw = Flaw.NO_PATH if first.reason else Flaw.NOTHING
        return _Found(first.path, skipped, first.reason, flaw)

    def is_obstructed(self, state: ServiceState, way: Way, position: Array, time: float) -> bool:
        """Whether the path ahead runs into something on the map of the moment.

        A path through robots at rest counts as obstructed as soon as other robots are at rest.
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
def _comes_back(path: Array, second: Array) -> bool:
    """Whether ``second``, which begins where ``path`` ends, runs back along it for COMES_BACK."""
    arc, last = 0.0, second.shape[0] if path.shape[0] > 1 else 0
    for k in range(1, last):
        x, y = second[k, 0], second[k, 1]
        segment, share = project_on_path(path, x, y, 0)
        px = path[segment, 0] + share * (path[segment + 1, 0] - path[segment, 0])
        py = path[segment, 1] + share * (path[segment + 1, 1] - path[segment, 1])
        if (px - x) ** 2 + (py - y) ** 2 > SAME_LINE * SAME_LINE:
            return False
        arc += np.hypot(x - second[k - 1, 0], y - second[k - 1, 1])
        if arc >= COMES_BACK:
            return True
    return False


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
            row, col = cell_at(px, py, cost, resolution, west, south)
            if row < 0 or cost[row, col] >= INSCRIBED:
                return True
        ax, ay = bx, by
    return False
