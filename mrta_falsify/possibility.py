"""Worlds that no stack can do: a way that is too narrow, or deadlines that leave too little time.

A campaign sets such worlds apart, since they say nothing about the stack. Every bound is on the
safe side: walls alone are in the way, robots drive at their top speed from where they happen to
be best placed, and what the prover does not decide within its limit counts as possible.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Collection, Iterator

import numpy as np
from shapely.geometry import Polygon

from mrta_falsify.bare_floor import BareFloor
from mrta_falsify.core.allocation_problem import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Push
from mrta_falsify.core.protocols import Planner
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import ROOM_REACH
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.timing import closed_travel_times
from simulator_interface.engines.robot_models import find_model

CELL = 0.05  # m of the map on which ways are looked for
CELL_ERROR = 1.5 * CELL  # m that cells may take from the width of a passage, on each side
WAY_ERROR = 0.9  # of a planned way's length is surely no longer than the shortest one
NODES = 200_000  # of the prover's search, about 50 ms
NEVER = 1e9  # s, for the prover, which counts in finite times
MOST_TASKS = 40  # more are not proved together: the limit would be reached


def why_impossible(world: World, specifications: Collection[str]) -> str:
    """Say why no stack can keep the specifications in a world; empty: one may.

    Args:
        world: to look at.
        specifications: that the stack is to keep; deadlines count if ``deadlines`` is among them.
    """
    floor = BareFloor.of(world)
    reasons = [_too_wide(world, floor)]
    if "deadlines" in specifications and world.robots and world.tasks:
        reasons.append(_too_late(world, floor))
    return next(itertools.chain.from_iterable(reasons), "")


# --- ways -------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)
def _planner(floor: BareFloor, radius: float) -> Planner:
    """Plan on the walls of a floor for a body that is ``radius`` [m] wide to each side."""
    options = {"resolution": CELL, "robot_radius": radius, "inflation_radius": radius}
    planner, _ = floor.planner(options, {})
    return planner


@functools.lru_cache(maxsize=64)
def _shortest_ways(floor: BareFloor, radius: float) -> Array:
    """Bound the ways between rooms from below, ``(R, R)`` [m]; infinite: there is none."""
    planner, rooms = _planner(floor, radius), floor.world.rooms
    ways = np.zeros((len(rooms), len(rooms)))
    for i, start in enumerate(rooms):
        for k, end in enumerate(rooms[:i]):
            ways[i, k] = ways[k, i] = _bound(planner, start.point, end.point)
    return ways


def _bound(planner: Planner, start: Array, goal: Array) -> float:
    """Bound the way between the surroundings of two points from below [m]."""
    plan = planner.plan(np.asarray(start), np.asarray(goal))
    if plan.reason == "unreachable":
        return math.inf
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


# --- too wide ---------------------------------------------------------------------------------


def _too_wide(world: World, floor: BareFloor) -> Iterator[str]:
    """Name tasks that no robot fits to, and furniture that does not fit where it is pushed."""
    widths = {_robot_half_width(world, i) for i in range(len(world.robots))}
    for number, task in enumerate(world.tasks):
        if widths and all(
            math.isinf(_shortest_ways(floor, width)[task.start, task.end]) for width in widths
        ):
            ends = f"{world.rooms[task.start].name} to {world.rooms[task.end].name}"
            yield f"task{number}: no robot is narrow enough for a way from {ends}"
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


def _too_late(world: World, floor: BareFloor) -> Iterator[str]:
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
    if has_any and len(world.tasks) <= MOST_TASKS:
        yield from _cannot_all(world, times)


def _least_times(world: World, floor: BareFloor) -> Array:
    """Bound the travel times between rooms from below, ``(R, R)`` [s]."""
    speed = max(robot.max_speed for robot in world.robots)
    widths = [_robot_half_width(world, i) for i in range(len(world.robots))]
    ways = np.min([_shortest_ways(floor, width) for width in set(widths)], axis=0)
    return closed_travel_times(ways / speed)


def _cannot_all(world: World, times: Array) -> Iterator[str]:
    """Ask the prover for tasks that no fleet can deliver in time together."""
    finite = np.where(np.isfinite(times), times, world.horizon)
    tasks = tuple(
        OpenTask(
            number=number,
            start=task.start,
            end=task.end,
            # The prover sends robots off when a task arrives; a stack may have one nearer by then.
            arrival=max(0.0, task.arrival - float(finite[:, task.start].max())),
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
        now=0.0, robots=robots, tasks=tasks, travel_times=_with_starts(world, finite)
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
