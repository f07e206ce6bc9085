"""Worlds that no stack can do: a way that is shut, or deadlines that leave too little time.

A campaign sets such worlds apart, since they say nothing about the stack. Every bound is on the
safe side. Of a robot only the largest disc inside its body must get through, at any time before
the horizon. In its way are walls, furniture that nobody pushes, and blockages that nobody can
hold up and that stand to the horizon; people and other robots never are. For deadlines, robots
drive at their top speed from where they happen to be best placed, and what the prover does not
decide within its limit counts as possible.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Appear, Push, begins_outside
from mrta_falsify.core.free_space import Disc, free_space, widest_gap
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.protocols import Planner
from mrta_falsify.core.tight_ways import TightWay, things_text
from mrta_falsify.core.world import Blockage, HumanSpec, RobotSpec, Task, World
from mrta_falsify.specs.books import ROOM_REACH, stop_area
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.timing import closed_travel_times
from mrta_falsify.static_floor import StaticFloor
from simulator_interface.engines.robot_models import find_model, inner_disc
from simulator_interface.engines.sensing import PUT_DOWN

CELL = 0.05  # m of the map on which ways are measured
CELL_ERROR = 1.5 * CELL  # m that cells may take from the width of a passage, on each side
WAY_ERROR = 0.9  # of a planned way's length is surely no longer than the shortest one
NODES = 200_000  # of the prover's search, about 50 ms on the median, under 1 s
NEVER = 1e9  # s, for the prover, which counts in finite times
MAX_TASKS = 40  # more are not proved together: the limit would be reached
FASTEST_WALK = 3.0  # m/s; somebody who wants to walk slower runs no faster


@dataclass(frozen=True, slots=True, kw_only=True)
class Possibility:
    """What of a world no stack can do, and what is narrow in it."""

    shut: tuple[TightWay, ...] = ()  #: one for each task that no robot that may serve it fits to
    late: str = ""  #: why deadlines cannot be kept, empty: they may; not asked if a way is shut
    #: one for each task that the planning radius of no robot that may serve it fits to
    narrow: tuple[TightWay, ...] = ()
    stuck_pushes: tuple[str, ...] = ()  #: furniture that does not fit to where it is pushed

    @property
    def reason(self) -> str:
        """Say why no stack can do the world; empty: one may."""
        if not self.shut:
            return self.late
        way = self.shut[0]
        gap = f"gap {way.gap:.2f} m" if way.gap else "no gap"
        return (
            f"task{way.task}: {way.is_shut_by}; no robot that may serve it fits "
            f"(body {way.needed:.2f} m wide, {gap})"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """List what is narrow in the world, one sentence each, without repeats."""
        told = (
            f"{way.is_only}, {'beside' if way.by else 'between'} {things_text(way.by)} "
            f"(robots plan for {way.needed:.2f} m)"
            for way in self.narrow
        )
        return tuple(dict.fromkeys([*told, *self.stuck_pushes]))


def look_at(world: World, specifications: Collection[str]) -> Possibility:
    """Look for what no stack can do in a world.

    Args:
        world: to look at.
        specifications: that the stack is to keep; deadlines count if ``deadlines`` is among them.
    """
    shut, narrow = _tight_ways(world)
    floor = StaticFloor.of(world)
    late: Iterator[str] = iter(())
    if "deadlines" in specifications and world.robots and world.tasks and not shut:
        late = _too_late(world, floor)
    return Possibility(
        shut=shut,
        late=next(late, ""),
        narrow=narrow,
        stuck_pushes=tuple(_stuck_pushes(world, floor)),
    )


# --- shut ways --------------------------------------------------------------------------------


class _Ground:
    """The solids and stops of a world, and where discs can go among them."""

    def __init__(self, world: World) -> None:
        self.world = world
        walls, things = [wall.polygon for wall in world.walls], things_that_stand(world)
        self._free = functools.cache(lambda half: free_space(world.bounds, walls, things, half))
        solids = [Polygon(wall) for wall in walls]
        self._stop = functools.cache(lambda room: stop_area(world.rooms[room].point, solids))
        self._goal = functools.cache(lambda room, away: shapely.buffer(self._stop(room), away))
        self._reaching = functools.cache(
            lambda room, disc: self._free(disc.half_width).reaching(self._goal(room, disc.away))
        )
        self._shut_by = functools.cache(self._find_shut_by)
        self._gap = functools.cache(self._measure_gap)

    def fits(self, robot: RobotSpec, disc: Disc) -> bool:
        """Whether a robot's disc fits where the robot starts."""
        return bool(self._free(disc.half_width).at(disc.at(robot.pose)).any())

    def target(self, task: Task, robot: RobotSpec, disc: Disc) -> int | None:
        """Find the room of a task to which a robot's disc cannot get.

        None: it gets to both, or does not fit where the robot starts, and nothing is known.
        """
        here = self._free(disc.half_width).at(disc.at(robot.pose))
        if not here.any():
            return None
        for room in (task.start, task.end):
            here = here & self._reaching(room, disc)
            if not here.any():
                return room
        return None

    def tight_way(self, number: int, room: int, robot: RobotSpec, disc: Disc) -> TightWay:
        """Describe the way to a room to which a robot's disc cannot get."""
        start = tuple(disc.at(robot.pose).tolist())
        by = self._shut_by(start, room, disc)
        return TightWay(
            task=number,
            room=self._shut_room(start, room, disc),
            by=by,
            gap=self._gap(start, room, disc),
            needed=disc.width,
        )

    def _find_shut_by(self, start: tuple[float, float], room: int, disc: Disc) -> tuple[str, ...]:
        space = self._free(disc.half_width)
        return space.shut_by(start, self._goal(room, disc.away)) or ()

    def _measure_gap(self, start: tuple[float, float], room: int, disc: Disc) -> float:
        goal = self._goal(room, disc.away)
        gap = widest_gap(lambda half: self._free(half).is_open(start, goal), high=disc.half_width)
        return min(gap, disc.width)

    def _shut_room(self, start: tuple[float, float], room: int, disc: Disc) -> str:
        """Name the one room that is cut off: where the robot starts, or where it is to go."""
        space, rooms = self._free(disc.half_width), self.world.rooms
        goals = [self._reaching(k, disc) for k in range(len(rooms))]
        here, there = space.at(start), goals[room]
        with_start = [k for k, parts in enumerate(goals) if (parts & here).any()]
        with_goal = [k for k, parts in enumerate(goals) if k == room or (parts & there).any()]
        area = shapely.area(space.parts)
        is_left = len(with_start) == 1 and (
            len(with_goal) > 1 or area[here].sum() < area[there].sum()
        )
        return rooms[with_start[0] if is_left else room].name


def _tight_ways(world: World) -> tuple[tuple[TightWay, ...], tuple[TightWay, ...]]:
    """Find the ways that no body fits through, and those that no planning radius does."""
    ground = _Ground(world)
    joining = [robot for robot in world.robots if robot.joins_at <= world.horizon]
    both = [(r, body_disc(r), Disc((0.0, 0.0), r.radius)) for r in joining]
    shut, narrow = [], []
    for number, task in enumerate(world.tasks):
        serving = [discs for discs in both if task.robot in ("", discs[0].name)]
        if not serving or task.arrival > world.horizon:
            continue
        bodies = [(robot, body) for robot, body, _ in serving]
        planned = [(robot, plan) for robot, _, plan in serving]
        is_planned = [ground.target(task, *pair) is None for pair in planned]
        # What a planning radius fits through, the disc inside it does.
        passes = [
            (done and body.is_within(plan) and ground.fits(robot, plan))
            or ground.target(task, robot, body) is None
            for done, (robot, body, plan) in zip(is_planned, serving, strict=True)
        ]
        if not any(passes):
            shut.append(_best_way(ground, number, bodies))
        elif not any(is_planned):
            kept = [pair for pair, fits in zip(planned, passes, strict=True) if fits]
            narrow.append(_best_way(ground, number, kept))
    return tuple(shut), tuple(narrow)


def _best_way(ground: _Ground, number: int, discs: Sequence[tuple[RobotSpec, Disc]]) -> TightWay:
    """Describe the way of the robot that comes nearest to passing."""
    task = ground.world.tasks[number]
    ways = []
    for robot, disc in discs:
        room = ground.target(task, robot, disc)
        assert room is not None, "only what does not pass is described"
        ways.append(ground.tight_way(number, room, robot, disc))
    return min(ways, key=lambda way: (way.needed - way.gap, not way.by, len(way.by)))


def body_disc(robot: RobotSpec) -> Disc:
    """Find the largest disc inside a robot's body: it goes wherever the body does."""
    return inner_disc(find_model(robot.model))


# --- what stands ------------------------------------------------------------------------------


def things_that_stand(world: World) -> list[tuple[str, Array]]:
    """List what is in everybody's way from the start to the horizon: name, outline ``(V, 2)``.

    Furniture that no person of the world pushes; of a world whose program goes on in the run,
    only furniture that cannot be pushed. Blockages that nobody can hold up and that do not end.
    """
    pushed = {
        directive.furniture
        for human in world.humans
        for directive in human.directives
        if isinstance(directive, Push)
    }
    things = [
        (item.name, item.polygon)
        for item in world.furniture
        if not item.movable or not (world.scripted or item.name in pushed)
    ]
    blockages = (event for event in world.events if isinstance(event, Blockage))
    return things + [
        (event.name, event.polygon)
        for event in blockages
        if event.end >= world.horizon and not _may_be_held_up(world, event)
    ]


def _may_be_held_up(world: World, blockage: Blockage) -> bool:
    """Whether a robot or person may be where a blockage is to be put down, and so keep it away.

    Engines put a blockage down once nobody is there. What nobody can reach before its start is as
    good as there from time 0.
    """
    outline = Polygon(blockage.polygon)
    return any(_may_be_at(robot, outline, blockage.start) for robot in world.robots) or any(
        _may_walk_to(human, outline, blockage.start) for human in world.humans
    )


def _may_be_at(robot: RobotSpec, outline: Polygon, time: float) -> bool:
    """Whether a robot may be beside an outline at ``time`` [s], or too fast to stop before it."""
    model = find_model(robot.model)
    body = Polygon(transform(model.footprint, robot.pose))
    near = PUT_DOWN
    if time > robot.joins_at:
        speed = min(robot.max_speed, model.max_speed)
        turning = 2.0 * float(np.hypot(*model.footprint.T).max())
        near += turning + speed * (time - robot.joins_at)
        near += 0.5 * speed**2 / min(robot.max_acceleration, model.max_acceleration)
    return bool(body.distance(outline) <= near)


def _may_walk_to(human: HumanSpec, outline: Polygon, time: float) -> bool:
    """Whether a person may be beside an outline at ``time`` [s]."""
    if not human.appears_at <= time < human.leaves_at or not len(human.route):
        return False
    if time <= 0.0 and begins_outside(human.directives):
        return False
    if time > 0.0 and any(isinstance(step, Appear) for step in human.directives):
        return True
    route = human.route[:1] if human.directives else human.route
    way = LineString(route) if len(route) > 1 else Point(route[0])
    near = human.radius + PUT_DOWN + max(FASTEST_WALK, 2.0 * human.speed) * time
    return bool(way.distance(outline) <= near)


# --- ways -------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def _planner(floor: StaticFloor, radius: float) -> Planner:
    """Plan on the walls of a floor for a body that is ``radius`` [m] wide to each side."""
    options = {"resolution": CELL, "robot_radius": radius, "inflation_radius": radius}
    planner, _ = floor.planner(options, {})
    return planner


@functools.lru_cache(maxsize=64)
def _shortest_ways(floor: StaticFloor, radius: float) -> Array:
    """Bound the ways between rooms from below, ``(R, R)`` [m]."""
    planner, rooms = _planner(floor, radius), floor.world.rooms
    ways = np.zeros((len(rooms), len(rooms)))
    for i, start in enumerate(rooms):
        for k, end in enumerate(rooms[:i]):
            ways[i, k] = ways[k, i] = _bound(planner, start.point, end.point)
    return ways


def _bound(planner: Planner, start: Array, goal: Array) -> float:
    """Bound the way between the surroundings of two points from below [m]."""
    plan = planner.plan(np.asarray(start), np.asarray(goal))
    length = max(WAY_ERROR * plan.length if plan.found else 0.0, float(np.hypot(*(goal - start))))
    return max(0.0, length - 2.0 * ROOM_REACH)


@functools.lru_cache(maxsize=64)
def _half_width(outline: tuple[tuple[float, float], ...]) -> float:
    """Measure half the width [m] of the narrowest gap that a body passes, less the cells' error."""
    box = Polygon(outline).minimum_rotated_rectangle
    corners = np.array(box.exterior.coords)
    sides = np.hypot(*np.diff(corners, axis=0).T)
    return max(CELL, float(sides[:2].min()) / 2.0 - CELL_ERROR)


def _robot_half_width(world: World, robot: int) -> float:
    model = find_model(world.robots[robot].model)
    return _half_width(tuple(map(tuple, model.footprint.tolist())))


# --- pushes -----------------------------------------------------------------------------------


def _stuck_pushes(world: World, floor: StaticFloor) -> Iterator[str]:
    """Name furniture that does not fit past the walls to where it is to be pushed."""
    pieces = {piece.name: piece for piece in world.movable_furniture()}
    for human in world.humans:
        place = {name: piece.center for name, piece in pieces.items()}
        for directive in human.directives:
            if not isinstance(directive, Push) or directive.furniture not in pieces:
                continue
            corners = tuple(map(tuple, np.asarray(pieces[directive.furniture].polygon).tolist()))
            planner = _planner(floor, _half_width(corners))
            start, place[directive.furniture] = place[directive.furniture], directive.point
            if planner.plan(np.asarray(start), np.asarray(directive.point)).reason == "unreachable":
                x, y = directive.point
                yield (
                    f"{human.name}: {directive.furniture} is too wide for every way to "
                    f"({x:.1f}, {y:.1f}) m, where it is to be pushed"
                )


# --- too late ---------------------------------------------------------------------------------


def _too_late(world: World, floor: StaticFloor) -> Iterator[str]:
    """Name tasks that cannot be delivered in time, alone or together."""
    times = _least_times(world, floor)
    for number, task in enumerate(world.tasks):
        earliest = task.arrival + task.pickup_time + times[task.start, task.end] + task.dropoff_time
        if earliest > task.deadline:
            yield (
                f"task{number}: even a robot that waits in {world.rooms[task.start].name} delivers "
                f"it at {earliest:.1f} s at the earliest; it must by {task.deadline:.1f} s"
            )
    has_any = any(math.isfinite(task.deadline) for task in world.tasks)
    if has_any and len(world.tasks) <= MAX_TASKS:
        yield from _cannot_all(world, times)


def _least_times(world: World, floor: StaticFloor) -> Array:
    """Bound the travel times between rooms from below, ``(R, R)`` [s]."""
    speed = max(robot.max_speed for robot in world.robots)
    widths = [_robot_half_width(world, i) for i in range(len(world.robots))]
    ways = np.min([_shortest_ways(floor, width) for width in set(widths)], axis=0)
    return closed_travel_times(ways / speed)


def _cannot_all(world: World, times: Array) -> Iterator[str]:
    """Ask the prover for tasks that no fleet can deliver in time together."""
    tasks = tuple(
        OpenTask(
            number=number,
            start=task.start,
            end=task.end,
            # The prover sends robots off when a task arrives; a stack may have one nearer by then.
            arrival=max(0.0, task.arrival - float(times[:, task.start].max())),
            deadline=min(task.deadline, NEVER),
            pickup_time=task.pickup_time,
            dropoff_time=task.dropoff_time,
        )
        for number, task in enumerate(world.tasks)
    )
    starts = len(world.rooms)  # the robots' starts follow the rooms
    robots = tuple(
        RobotPlan(
            robot=number,
            room=starts + number,
            free_at=robot.joins_at,
            onboard=(),
            capacity=robot.capacity,
        )
        for number, robot in enumerate(world.robots)
    )
    problem = AllocationProblem(
        now=0.0, robots=robots, tasks=tasks, travel_times=_with_starts(world, times)
    )
    options = ExactOptions(node_limit=NODES, fewest_lost=False, improvement_steps=0)
    answer = Exact(options).allocate(problem)
    if answer.infeasible is not None:
        named = ", ".join(f"task{task}" for task in answer.infeasible.core)
        yield f"no fleet delivers all of {named} in time, however it drives: proved"


def _with_starts(world: World, times: Array) -> Array:
    """Add the robots' starts to times between rooms: ``(R + N, R + N)`` [s], bounds from below."""
    points = np.array([room.point for room in world.rooms])
    starts = np.array([robot.pose[:2] for robot in world.robots])
    speed = max(robot.max_speed for robot in world.robots)
    every = np.vstack([points, starts])
    away = np.hypot(*(starts[:, None] - every[None]).transpose(2, 0, 1))
    rooms, count = len(points), len(every)
    full = np.zeros((count, count))
    full[:rooms, :rooms] = times
    full[rooms:] = np.maximum(0.0, away - ROOM_REACH) / speed
    full[:, rooms:] = full[rooms:].T
    return closed_travel_times(full)
