"""Small floors of the labelled set: two rooms and a passage, and mazes of narrow corridors."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from shapely import unary_union
from shapely.geometry import LineString, Polygon, box

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.world import Lane, RobotSpec, Room, Task, Wall, World

HORIZON = 120.0  # s
RIM = 0.5  # m of wall around everything
APPROACH_SPEED = 0.69  # m/s, of travel times


def robot(number: int, *pose: float, **more: Any) -> RobotSpec:
    """Robot ``robot{number + 1}`` at a pose x, y, and yaw if it is not 0 [m, rad]."""
    x, y, yaw = pose if len(pose) == 3 else (*pose, 0.0)
    return RobotSpec(name=f"robot{number + 1}", pose=np.array([x, y, yaw]), **more)


def two_rooms(passage: Polygon, *, side: float = 3.0, gap: float = 10.0) -> World:
    """West room 0 and east room 1, ``gap`` apart, joined by ``passage``."""
    half = gap / 2
    west = box(-half - side, -side / 2, -half, side / 2)
    east = box(half, -side / 2, half + side, side / 2)
    points = np.array([[-half - side / 2, 0.0], [half + side / 2, 0.0]])
    doors = np.array([[-half + 0.3, 0.0], [half - 0.3, 0.0]])
    lanes = []
    for start, end in ((0, 1), (1, 0)):
        way = np.array([doors[start], doors[end], points[end]])
        lanes.append(Lane(start=start, end=end, to_queue=way, to_room=way))
    areas = [np.array(room.exterior.coords)[:-1] for room in (west, east)]
    world = floor(unary_union([west, east, passage]), points, areas)
    return dataclasses.replace(world, lanes=tuple(lanes))


def facing_rooms(
    passage: Polygon, starts: Sequence[tuple[float, float]], *, side: float = 3.4, gap: float = 8.0
) -> World:
    """Two rooms ``gap`` apart, with a start and a destination of its own for each robot.

    Room i lies at the start of robot i, room N + i in the other one of the two, side by side.

    Args:
        passage: joins the two rooms.
        starts: of N <= 3 robots x, y [m], in either room.
        side: of each room [m].
        gap: between them [m].
    """
    half = gap / 2
    west = box(-half - side, -side / 2, -half, side / 2)
    east = box(half, -side / 2, half + side, side / 2)
    far, aside = half + 0.7 * side, (0.34 * side, -0.34 * side, 0.0)
    ends = [(far if x < 0.0 else -far, aside[i]) for i, (x, _) in enumerate(starts)]
    free = unary_union([west, east, passage], grid_size=1e-6)  # they touch, but for rounding
    return floor(free, np.array([*starts, *ends]))


def facing_robots(
    starts: Sequence[tuple[float, float]], arrivals: Sequence[float], deadline: float
) -> dict[str, Any]:
    """Fields `robots` and `tasks` of a world with :func:`facing_rooms`.

    Args:
        starts: of N robots x, y [m].
        arrivals: of their tasks [s].
        deadline: of their tasks [s].
    """
    robots = tuple(robot(i, x, y, 0.0 if x < 0.0 else np.pi) for i, (x, y) in enumerate(starts))
    tasks = tuple(
        Task(
            arrival=arrival,
            start=i,
            end=len(robots) + i,
            deadline=deadline,
            robot=robots[i].name,
        )
        for i, arrival in enumerate(arrivals)
    )
    return {"robots": robots, "tasks": tasks}


def floor(free: Polygon, points: Array, areas: Sequence[Array] = ()) -> World:
    """Walls around ``free``, and a room at each of ``points`` ``(R, 2)`` [m]; no lanes."""
    x_min, y_min, x_max, y_max = free.bounds
    outside = (x_min - RIM, y_min - RIM, x_max + RIM, y_max + RIM)
    away = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    seconds = np.ceil(1.5 * away / APPROACH_SPEED + 5.0) * (away > 0.0)
    return World(
        name="oracle",
        bounds=frozen_array(outside),
        walls=tuple(_walls(outside, free)),
        rooms=tuple(
            Room(
                name=f"end{i}",
                point=point,
                door=np.zeros((0, 2)),
                area=areas[i] if len(areas) else np.zeros((0, 2)),
            )
            for i, point in enumerate(points)
        ),
        travel_times=frozen_array(seconds),
        horizon=HORIZON,
    )


def _walls(outside: tuple[float, float, float, float], free: Polygon) -> Iterator[Wall]:
    """Rectangles over everything that is not free; all sides of ``free`` are along an axis."""
    x_min, y_min, x_max, y_max = outside
    rings = [free.exterior, *free.interiors]
    xs = sorted({x_min, x_max, *(round(float(x), 6) for ring in rings for x, _ in ring.coords)})
    number = itertools.count()
    for left, right in itertools.pairwise(xs):
        column = box(left + 1e-5, y_min, right - 1e-5, y_max).difference(free)
        for part in getattr(column, "geoms", [column]):
            if part.area > 1e-4:
                piece = box(left, part.bounds[1], right, part.bounds[3])
                corners = np.array(piece.exterior.coords)[:-1][::-1]
                yield Wall(name=f"wall_{next(number)}", polygon=corners)


def maze(random: np.random.Generator) -> World:
    """Corridors of one width along a random tree on a grid, some closed to rings.

    Rooms are the ends of the tree and some crossings: as wide as the corridors, or wider.
    """
    rows, cols = int(random.integers(2, 4)), int(random.integers(2, 4))
    step = float(random.uniform(2.4, 3.2))
    width = float(random.choice([0.9, 1.1, 1.4, 1.8]))
    nodes = [(row, col) for row in range(rows) for col in range(cols)]
    pairs = [
        (a, b)
        for a, b in itertools.combinations(nodes, 2)
        if abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1
    ]
    joined = {node: node for node in nodes}

    def root(node: tuple[int, int]) -> tuple[int, int]:
        while joined[node] != node:
            node = joined[node]
        return node

    degree = dict.fromkeys(nodes, 0)
    parts = []
    for k in random.permutation(len(pairs)):
        a, b = pairs[k]
        if root(a) == root(b) and random.random() > 0.25:
            continue
        joined[root(a)] = root(b)
        degree[a] += 1
        degree[b] += 1
        ends = np.array([[a[1], a[0]], [b[1], b[0]]]) * step
        parts.append(LineString(ends).buffer(width / 2, cap_style="square"))
    ends_of_tree = [node for node in nodes if degree[node] == 1]
    rest = [node for node in nodes if degree[node] > 1]
    places = (ends_of_tree + [rest[k] for k in random.permutation(len(rest))])[:4]
    side = width + float(random.choice([0.0, 0.0, 0.8]))
    points = np.array([[col, row] for row, col in places], dtype=np.float64) * step
    parts += [box(x - side / 2, y - side / 2, x + side / 2, y + side / 2) for x, y in points]
    free = unary_union(parts).simplify(1e-9)
    return floor(free, points)
