"""Scenes for a stack that locks areas: crosswise over two and three of them, near and far."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import affinity, unary_union
from shapely.geometry import Polygon, box

from experiments.oracle.sampled import Scene
from experiments.oracle.stacks import NEVER, outside
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import Resource, Task
from mrta_falsify.testing.floors import facing_robots, facing_rooms, floor, robot

DEADLINE = 900.0  # s; ``worlds.case`` moves it beyond all continuations
HORIZON = 90.0  # s
MODES = ("hold", "hold", "hold", "hold", "hold", "atomic", "ordered", "timeout", "timeout")


def area(name: str, shape: Polygon) -> Resource:
    """Something for one robot that a stack may lock."""
    corners = np.array(shape.exterior.coords)[:-1]
    if not shape.exterior.is_ccw:
        corners = corners[::-1]
    return Resource(name=name, kind="corridor", request_area=corners, release_area=corners)


def _locks(random: np.random.Generator, *, keep: float) -> tuple[StackConfig, float]:
    """A stack that locks, and the time by which its timers may have ended [s].

    Args:
        random: draws mode, distances and patience.
        keep: chance that areas are let go at the next stop only.
    """
    mode = MODES[int(random.integers(len(MODES)))]
    patience = float(random.uniform(20.0, 200.0)) if mode == "timeout" else NEVER
    before = float(random.uniform(0.4, 1.6))
    kept = int(random.random() < keep)
    config = outside(random, "locks", mode=mode, before=before, keep=kept, patience=patience)
    return config, HORIZON + (patience if mode == "timeout" else 0.0)


def _arrival(random: np.random.Generator) -> float:
    """Mostly at once; some come so late that the others are through."""
    late = random.random() < 0.15
    return float(random.uniform(35.0, 60.0) if late else random.uniform(0.2, 4.0))


def lock_hall(random: np.random.Generator) -> Scene:
    """An open hall with two or three areas; each robot crosses its own and then the next one's.

    They lie metres apart, and so do the robots that wait. A further robot may want one of them.
    """
    count = int(random.integers(2, 4))
    side = float(random.uniform(3.5, 6.0))
    if count == 2:
        areas = [box(-side / 2 - 0.8, -1.4, -side / 2 + 0.8, 1.4)]
        areas.append(box(side / 2 - 0.8, -1.4, side / 2 + 0.8, 1.4))
        reach = side / 2 + 2.4
        ends = [((-reach, 0.7), (reach, 0.7)), ((reach, -0.7), (-reach, -0.7))]
        ends.append(((-side / 2, 3.2), (-side / 2, -3.2)))
    else:
        angles = np.pi / 2 + 2.0 * np.pi / 3.0 * np.arange(3)
        corners = side / np.sqrt(3.0) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        areas = [box(x - 0.8, y - 0.8, x + 0.8, y + 0.8) for x, y in corners]
        ends = []
        for k in range(3):
            start, end = corners[k], corners[(k + 1) % 3]
            way = 2.2 * (end - start) / side
            ends.append((tuple(start - way), tuple(end + way)))
    robots_here = count + int(count == 2 and random.random() < 0.4)
    ends = ends[:robots_here]
    points = np.array([start for start, _ in ends] + [end for _, end in ends])
    low, high = points.min(axis=0) - 1.5, points.max(axis=0) + 1.5
    world = floor(box(*low, *high), points)
    config, horizon = _locks(random, keep=0.75)
    return dataclasses.replace(
        world,
        resources=tuple(area(f"area{k + 1}", shape) for k, shape in enumerate(areas)),
        robots=tuple(
            robot(i, *start, float(np.arctan2(end[1] - start[1], end[0] - start[0])))
            for i, (start, end) in enumerate(ends)
        ),
        tasks=tuple(
            Task(
                arrival=_arrival(random) if i < count else 8.0,
                start=i,
                end=len(ends) + i,
                deadline=DEADLINE,
                robot=f"robot{i + 1}",
            )
            for i in range(len(ends))
        ),
        horizon=horizon,
    ), config


def lock_lane(random: np.random.Generator) -> Scene:
    """A lane, a car where robots can pass, maybe a second lane: each for one robot at a time.

    One or two robots come from the west, one from the east.
    """
    width = float(random.uniform(0.8, 1.2))
    long = float(random.uniform(3.0, 5.5))
    back = float(random.choice([0.0, random.uniform(2.0, 4.0)]))
    car = box(long / 2, -1.0, long / 2 + 2.0, 1.0)
    lane = box(-long / 2, -width / 2, long / 2, width / 2)
    areas = [lane, car]
    if back:
        areas.append(box(long / 2 + 2.0, -width / 2, long / 2 + 2.0 + back, width / 2))
    length = long + 2.0 + back
    shift = (length - long) / 2
    passage = unary_union(areas)
    half = length / 2 + 1.7
    starts = [(-half, 0.0), (half, 0.0)]
    if random.random() < 0.35:
        starts.append((-half - 1.2, 0.0))
    world = facing_rooms(_moved(passage, -shift), starts, gap=length)
    inner = [_moved(shape, -shift).buffer(-0.05, join_style="mitre") for shape in areas]
    config, horizon = _locks(random, keep=0.3)
    arrivals = [_arrival(random) + 3.0 * (i == 2) for i in range(len(starts))]
    return dataclasses.replace(
        world,
        **facing_robots(starts, arrivals, DEADLINE),
        resources=tuple(area(f"area{k + 1}", shape) for k, shape in enumerate(inner)),
        horizon=horizon,
    ), config


def _moved(shape: Polygon, x: float) -> Polygon:
    return affinity.translate(shape, xoff=x)
