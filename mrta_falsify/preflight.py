"""Preflights: what a world asks of any stack, told in milliseconds and without running it.

Robots go their ways at cruise speed, people theirs, and nobody sees anybody. Each task goes to the
robot that would begin it first; rooms admit as many as they have place for, first come first
served. No stack does just that, but where ways cross and who comes when is much the same. So a
search can look at many scenes for each one that it runs (as low fidelities serve in multi-fidelity
optimisation: Peherstorfer et al., SIAM Review 2018).
"""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import INSCRIBED
from mrta_falsify.core.feedback import DEMANDS
from mrta_falsify.core.polyline import path_length
from mrta_falsify.core.shapes import polygons
from mrta_falsify.core.world import HumanSpec, Task, World
from mrta_falsify.static_floor import StaticFloor

CELL = 0.1  # m of the map on which ways are looked for
KEPT_FLOORS = 4  # whose ways are kept
KEPT_GOALS = 32  # of each floor
MOMENTS = 300  # looked at, at most
SLOWEST = 0.05  # m/s, so that each way ends
LEAVING = 8.0  # s that a robot takes to clear a room
ABOUT = 5.0  # s; robots that come to a room within it come at about one time
MISSED = 10.0  # s by which robots miss each other in their rooms: a ring counts exp(-1) as much
MISSED_AT_MOST = 40.0  # s; a ring that is missed by more is none
LONGEST_RING = 4  # robots
MAX_LOOKS = 20_000  # at a visit that may be of a ring; fleets of hundreds in one stream need more
NEAR = 1.2  # m between two that meet
STEP = 0.2  # m between points of a way that are looked at
ABREAST = 0.6  # m between furniture and the middle of a robot that passes it


def preflight(world: World) -> Array:
    """Measure what a world asks of a stack.

    Returns:
        ``(m,)`` by :data:`~mrta_falsify.core.feedback.DEMANDS`; larger asks for more.
    """
    fleet = _Fleet(world, _ways(StaticFloor.of(world)))
    schedule = _acted(fleet, _assigned(fleet))
    moments = np.linspace(0.0, world.horizon, min(MOMENTS, 2 + int(world.horizon)))
    robots = _driven(fleet, schedule.drives, moments)
    people = [_walked(human, moments) for human in world.humans]
    measured = {
        **_of_schedule(world, schedule, moments),
        **_of_ways(fleet, schedule.drives),
        **_of_motion(world, robots, people, moments),
    }
    return np.array([measured[name] for name in DEMANDS])


# --- the schedule -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Stop:
    """A pick-up or a drop-off."""

    task: int
    room: int
    known: float  #: [s], nobody sets off before
    service: float  #: [s]


@dataclass(frozen=True, slots=True)
class _Visit:
    """A robot at a room."""

    stop: _Stop
    robot: int
    arrives: float  #: [s]
    begins: float  #: [s], once there is a place
    served: float  #: [s]


@dataclass(frozen=True, slots=True)
class _Drive:
    """A robot under way."""

    begins: float  #: [s]
    path: Array  #: (L, 2) [m]


@dataclass(frozen=True, slots=True)
class _Schedule:
    visits: list[_Visit]  #: in order of arrival
    drives: list[list[_Drive]]  #: by robot


class _Ways:
    """Ways on a floor without furniture; those between rooms are kept."""

    def __init__(self, floor: StaticFloor) -> None:
        self._rooms = [room.point for room in floor.world.rooms]
        self._planner, self.costmap = floor.planner(
            {"resolution": CELL}, {"resolution": CELL, "goal_cache": KEPT_GOALS}
        )
        self._between: dict[tuple[int, int], Array] = {}

    def to_room(self, start: Array, room: int) -> Array:
        """Find the way from ``start`` ``(2,)`` [m] to a room, ``(L, 2)``."""
        goal = self._rooms[room]
        plan = self._planner.plan(np.asarray(start), np.asarray(goal))
        return plan.path if len(plan.path) > 1 else np.array([start, goal])

    def between(self, start: int, end: int) -> Array:
        """Find the way from room to room, ``(L, 2)`` [m]."""
        if (start, end) not in self._between:
            self._between[start, end] = self.to_room(self._rooms[start], end)
        return self._between[start, end]


@functools.lru_cache(maxsize=KEPT_FLOORS)
def _ways(floor: StaticFloor) -> _Ways:
    return _Ways(floor)


class _Fleet:
    """Ways and driving times of the robots of one world; each way from a start is planned once."""

    def __init__(self, world: World, ways: _Ways) -> None:
        self.world = world
        self.ways = ways
        self._from_start: dict[tuple[int, int], Array] = {}

    def way(self, robot: int, done: Sequence[_Stop], room: int) -> Array:
        """Find the way ``(L, 2)`` [m] to a room from the last stop that is done, or the start."""
        if done:
            return self.ways.between(done[-1].room, room)
        if (robot, room) not in self._from_start:
            start = self.world.robots[robot].pose[:2]
            self._from_start[robot, room] = self.ways.to_room(start, room)
        return self._from_start[robot, room]

    def time(self, robot: int, path: Array) -> float:
        """Say how long a robot drives along ``path`` ``(L, 2)`` [s]."""
        return path_length(path) / self.speed(robot)

    def time_at_least(self, robot: int, done: Sequence[_Stop], room: int) -> float:
        """Say how long the way to a room would take at least [s], without planning it."""
        rooms = self.world.rooms
        start = rooms[done[-1].room].point if done else self.world.robots[robot].pose[:2]
        return math.dist(start, rooms[room].point) / self.speed(robot)

    def speed(self, robot: int) -> float:
        """Say how fast a robot drives [m/s]."""
        kind = self.world.robots[robot]
        return max(min(kind.cruise_speed, kind.max_speed), SLOWEST)


def _assigned(fleet: _Fleet) -> list[list[_Stop]]:
    """Give each task, in order of arrival, to the robot that would begin it first."""
    world = fleet.world
    stops: list[list[_Stop]] = [[] for _ in world.robots]
    free = [robot.joins_at for robot in world.robots]
    for number in sorted(range(len(world.tasks)), key=lambda k: world.tasks[k].arrival):
        task = world.tasks[number]
        able = [i for i, robot in enumerate(world.robots) if task.robot in ("", robot.name)]
        if not able:
            continue
        begins, chosen = _soonest(fleet, task, able, free, stops)
        trip = fleet.time(chosen, fleet.ways.between(task.start, task.end))
        free[chosen] = begins + task.pickup_time + trip + task.dropoff_time
        stops[chosen] += [
            _Stop(number, task.start, task.arrival, task.pickup_time),
            _Stop(number, task.end, task.arrival, task.dropoff_time),
        ]
    return stops


def _soonest(
    fleet: _Fleet,
    task: Task,
    able: Sequence[int],
    free: Sequence[float],
    stops: Sequence[Sequence[_Stop]],
) -> tuple[float, int]:
    """Find when [s] and by which robot a task is begun first; few ways have to be planned."""
    since = {i: max(free[i], task.arrival) for i in able}
    at_least = {i: since[i] + fleet.time_at_least(i, stops[i], task.start) for i in able}
    best = math.inf, -1
    for i in sorted(able, key=lambda i: at_least[i]):
        if at_least[i] > best[0]:
            break
        way = fleet.way(i, stops[i], task.start)
        best = min(best, (since[i] + fleet.time(i, way), i))
    return best


def _acted(fleet: _Fleet, stops: Sequence[Sequence[_Stop]]) -> _Schedule:
    """Let all robots go their ways and wait at rooms that are full."""
    world = fleet.world
    places = {r.room: r.capacity for r in world.resources if r.kind == "room"}
    left: dict[int, list[float]] = {}  # when those in a room have left it, by room
    visits: list[_Visit] = []
    drives: list[list[_Drive]] = [[] for _ in world.robots]
    arrivals: list[tuple[float, int, int]] = []  # time, robot, number of its stop

    def set_off(robot: int, number: int, time: float) -> None:
        if number < len(stops[robot]):
            stop = stops[robot][number]
            begins = max(time, stop.known)
            path = fleet.way(robot, stops[robot][:number], stop.room)
            drives[robot].append(_Drive(begins, path))
            heapq.heappush(arrivals, (begins + fleet.time(robot, path), robot, number))

    for robot, kind in enumerate(world.robots):
        set_off(robot, 0, kind.joins_at)
    while arrivals:
        arrives, robot, number = heapq.heappop(arrivals)
        stop = stops[robot][number]
        inside = sorted(time for time in left.get(stop.room, ()) if time > arrives)
        most = places.get(stop.room, len(world.robots))
        begins = arrives if len(inside) < most else inside[-most]
        served = begins + stop.service
        left[stop.room] = [*inside, served + LEAVING]
        visits.append(_Visit(stop, robot, arrives, begins, served))
        set_off(robot, number + 1, served)
    return _Schedule(visits, drives)


# --- motion -----------------------------------------------------------------------------------


def _lengths(path: Array) -> Array:
    """Measure the way to each point of a path ``(L, 2)``, ``(L,)`` [m]."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])


def _along(path: Array, way: Array) -> Array:
    """Find the points ``(n, 2)`` of a path ``(L, 2)`` after ``way`` ``(n,)`` [m]."""
    lengths = _lengths(path)
    return np.column_stack([np.interp(way, lengths, path[:, axis]) for axis in range(2)])


def _driven(fleet: _Fleet, drives: Sequence[Sequence[_Drive]], moments: Array) -> Array:
    """Place the robots, ``(n, N, 2)`` [m]; who waits stands at its room."""
    places = np.empty((len(moments), len(drives), 2))
    for robot, own in enumerate(drives):
        places[:, robot] = fleet.world.robots[robot].pose[:2]
        for drive in own:
            since = moments >= drive.begins
            way = fleet.speed(robot) * (moments[since] - drive.begins)
            places[since, robot] = _along(drive.path, way)
    return places


def _walked(human: HumanSpec, moments: Array) -> Array:
    """Place a person that walks its route, ``(n, 2)`` [m]; nan while it is not there."""
    route = np.asarray(human.route)
    loop = np.vstack([route, route[:1]]) if human.repeat and len(route) > 1 else route
    length = path_length(loop)
    way = human.start * length + human.speed * np.maximum(moments - human.appears_at, 0.0)
    if human.repeat and length > 0.0:
        way = way % length
    is_there = (moments >= human.appears_at) & (moments < human.leaves_at)
    return np.where(is_there[:, None], _along(loop, way), np.nan)


# --- what is measured -------------------------------------------------------------------------


def _of_schedule(world: World, schedule: _Schedule, moments: Array) -> dict[str, float]:
    visits = schedule.visits
    waiting = _most_at_once(visits, moments, lambda visit: (visit.arrives, visit.begins))
    there = _most_at_once(visits, moments, lambda v: (v.arrives - ABOUT, v.served + LEAVING))
    delivered = {visit.stop.task: visit.served for visit in visits}  # the later of its two stops
    tasks = [(task, delivered.get(k, world.horizon)) for k, task in enumerate(world.tasks)]
    is_open = [(moments >= task.arrival) & (moments < end) for task, end in tasks]
    late = [end - task.deadline for task, end in tasks if np.isfinite(task.deadline)]
    rooms: list[list[int]] = [[] for _ in world.robots]
    for visit in visits:
        rooms[visit.robot].append(visit.stop.room)
    return {
        "queue": waiting,
        "gathered": there,
        "waited": sum(min(v.begins, world.horizon) - min(v.arrives, world.horizon) for v in visits),
        "open": float(np.sum(is_open, axis=0).max()) if is_open else 0.0,
        "uneven": float(max(map(len, rooms), default=0)),
        "hurry": float(max(late, default=-world.horizon)),
        "again": float(sum(a == b for own in rooms for a, b in itertools.pairwise(own))),
        "ring": _ring([visit for visit in visits if visit.begins < world.horizon]),
    }


def _ring(visits: Sequence[_Visit]) -> float:
    """Count robots that each want the room of the next one.

    Who holds its room until it has the next one waits for ever in such a ring. The rooms of a ring
    need not be taken at one time: the less the robots miss each other, the more it counts.
    """
    own: dict[int, list[int]] = {}  # numbers of visits, by robot
    for number, visit in enumerate(visits):
        own.setdefault(visit.robot, []).append(number)
    following = {n: visits[m] for numbers in own.values() for n, m in itertools.pairwise(numbers)}
    of_room: dict[int, list[int]] = {}
    for number in following:
        of_room.setdefault(visits[number].stop.room, []).append(number)
    best, looks = 0.0, 0

    def extend(ring: tuple[int, ...], since: float, until: float) -> None:
        """Extend a ring in every way that may beat the best.

        Args:
            ring: numbers of its visits so far.
            since: begin of the time at which all of them are in their rooms [s].
            until: end of that time [s]; before ``since``: they miss each other.
        """
        nonlocal best, looks
        for number in of_room.get(following[ring[-1]].stop.room, ()):
            looks += 1
            if looks > MAX_LOOKS:
                return
            if number == ring[0] and len(ring) > 1:
                best = max(best, _worth(len(ring), since - until))
            if number <= ring[0] or len(ring) == LONGEST_RING:
                continue
            visit = visits[number]
            span = max(since, visit.arrives), min(until, visit.served + LEAVING)
            missed = span[0] - span[1]
            is_promising = missed < MISSED_AT_MOST and _worth(LONGEST_RING, missed) > best
            if is_promising and all(visits[k].robot != visit.robot for k in ring):
                extend((*ring, number), *span)

    for number in following:
        extend((number,), visits[number].arrives, visits[number].served + LEAVING)
    return best


def _worth(robots: int, missed: float) -> float:
    """Say how much a ring counts whose robots miss each other by ``missed`` [s]; below 0: not."""
    return robots * math.exp(-max(0.0, missed) / MISSED)


def _most_at_once(
    visits: Sequence[_Visit], moments: Array, span: Callable[[_Visit], tuple[float, float]]
) -> float:
    """Count the visits of one room whose spans [s] have a moment in common, at most."""
    counts: dict[int, Array] = {}
    for visit in visits:
        begins, ends = span(visit)
        at = counts.setdefault(visit.stop.room, np.zeros(len(moments)))
        at += (moments >= begins) & (moments < ends)
    return max((float(at.max()) for at in counts.values()), default=0.0)


def _of_ways(fleet: _Fleet, drives: Sequence[Sequence[_Drive]]) -> dict[str, float]:
    paths = [drive.path for own in drives for drive in own]
    if not paths:
        return {"driven": 0.0, "narrow": 0.0, "furniture": 0.0}
    points = np.concatenate(
        [_along(path, np.arange(0.5 * STEP, path_length(path), STEP)) for path in paths]
    )
    price = np.minimum(fleet.ways.costmap.cost_at(points), INSCRIBED) / INSCRIBED
    return {
        "driven": float(sum(map(path_length, paths))),
        "narrow": STEP * float(price.sum()),
        "furniture": STEP * float(_is_beside(fleet.world, points).sum()),
    }


def _is_beside(world: World, points: Array) -> Array:
    """Say which points ``(n, 2)`` [m] are so near to furniture that a robot has to mind it."""
    tree = shapely.STRtree(polygons([piece.polygon for piece in world.furniture]))
    near, _ = tree.query(shapely.points(points), predicate="dwithin", distance=ABREAST)
    beside = np.zeros(len(points))
    beside[near] = 1.0
    return beside


def _of_motion(
    world: World, robots: Array, people: Sequence[Array], moments: Array
) -> dict[str, float]:
    if not robots.shape[1]:
        return dict.fromkeys(
            ("crowd", "meetings", "head_on", "people", "sharing", "disturbed"), 0.0
        )
    step = float(moments[1] - moments[0])
    velocity = np.gradient(robots, step, axis=0)
    moves = np.hypot(velocity[..., 0], velocity[..., 1]) > SLOWEST
    crowd = np.zeros(robots.shape[:2])
    meetings = head_on = 0
    for robot in range(robots.shape[1] - 1):  # all pairs at once would not fit for a large fleet
        others = slice(robot + 1, None)
        apart = np.hypot(*np.moveaxis(robots[:, others] - robots[:, [robot]], -1, 0))
        near = apart < NEAR
        against = (velocity[:, others] * velocity[:, [robot]]).sum(axis=-1) < 0.0
        crowd[:, robot] += np.exp(-apart).sum(axis=1)
        crowd[:, others] += np.exp(-apart)
        meetings += int((near[1:] & ~near[:-1]).sum())
        head_on += int((near & against).sum())
    beside = [np.hypot(*np.moveaxis(robots - person[:, None], -1, 0)) < NEAR for person in people]
    events = [(moments >= event.start) & (moments < event.end) for event in world.events]
    return {
        "crowd": float(crowd.max()),
        "meetings": float(meetings),
        "head_on": step * head_on,
        "people": step * float(sum((moves & close).sum() for close in beside)),
        "sharing": _most_sharing(world, robots),
        "disturbed": step * float(sum((moves & lasts[:, None]).sum() for lasts in events)),
    }


def _most_sharing(world: World, robots: Array) -> float:
    """Count the robots that are at one resource at once, beyond its capacity."""
    most = 0.0
    for resource in world.resources:
        area = shapely.Polygon(resource.request_area)
        inside = shapely.contains_xy(area, robots[..., 0], robots[..., 1])
        most = max(most, float(inside.sum(axis=1).max()) - resource.capacity)
    return most
