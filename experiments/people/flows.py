"""How fast people walk in a stream, and how near they come, in worlds of this toolkit.

    python -m experiments.people.flows [--model NAME] [--seeds N]

Streams walk along a straight corridor on routes, as the people of any world do. Density and speed
are measured in a part of it and compared with Weidmann's curve. Then two people meet head-on, and
one passes a robot that stands, in corridors of several widths.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Sensed
from mrta_falsify.core.geometry import rectangle, transform
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import HumanSpec, RobotSpec, Wall, World
from simulator_interface.episode import Episode

FREE_SPEED = 1.34  # m/s, Weidmann 1993
SPREAD = 0.15  # m/s, of desired speeds, as a seed draws them
LENGTH = 48.0  # m of a corridor
MEASURED = 6.0  # m of it, in the middle of both streams, or ahead of that in one
SETTLING, UNTIL = 6.0, 16.0  # s, of measurements; later nobody comes any more
DENSITIES = (0.5, 1.0, 1.5, 2.0)  # 1/m^2
WALL = 0.15  # m


def weidmann(density: float) -> float:
    """Speed [m/s] in a stream of ``density`` [1/m^2] (Weidmann 1993)."""
    return FREE_SPEED * (1.0 - math.exp(-1.913 * (1.0 / density - 1.0 / 5.4)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow:
    """What was measured of one stream."""

    wanted: float  #: density over the whole ring [1/m^2]
    density: float  #: in the measured parts [1/m^2]
    speed: float  #: along the corridor [m/s]
    touching: float  #: share of people that touch another one at a moment


def walls_of(*boxes: tuple[float, float, float, float]) -> tuple[Wall, ...]:
    """Build walls from x, y of the centre, length and width [m]."""
    return tuple(
        Wall(
            name=f"wall{i}",
            polygon=frozen_array(transform(rectangle(length, width), (x, y, 0.0))),
        )
        for i, (x, y, length, width) in enumerate(boxes)
    )


def world_with(
    walls: tuple[Wall, ...], people: tuple[HumanSpec, ...], robot: Array, horizon: float
) -> World:
    """Put people and one robot without tasks between walls."""
    points = np.concatenate([wall.polygon for wall in walls])
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    pose = frozen_array([*robot, 0.0])
    low, high = np.minimum(low, pose[:2] - 1.0), np.maximum(high, pose[:2] + 1.0)
    return World(
        name="people",
        bounds=frozen_array([*low, *high]),
        walls=walls,
        robots=(RobotSpec(name="robot1", pose=pose),),
        humans=people,
        horizon=horizon,
    )


def frames(world: World, model: str) -> Iterator[Sensed]:
    """Run a world; its robot has nothing to do."""
    config = StackConfig(engine=Choice("kinematic"), human_model=Choice(model))
    running = Episode(world, config)
    taken = running.frames()
    for frame in taken:
        yield frame.sensed
        if frame.sensed.time >= world.horizon:
            taken.close()


def walkers(density: float, width: float, *, both_ways: bool, seed: int) -> list[HumanSpec]:
    """Draw the people of a corridor, spread evenly over it, each to its end or its beginning."""
    random = stream(seed, f"flow/{density}/{width}/{both_ways}")
    half, room = LENGTH / 2.0, width / 2.0 - 0.3
    columns = max(1, int(width / 0.65))
    rows = round(density * LENGTH * width / columns)
    people = []
    for row in range(rows):
        for column in range(columns):
            x = -half + (row + 0.5 + random.uniform(-0.2, 0.2)) * LENGTH / rows
            y = -room + (column + 0.5 + random.uniform(-0.1, 0.1)) * 2.0 * room / columns
            end = -half if both_ways and random.random() < 0.5 else half
            speed = float(np.clip(random.normal(FREE_SPEED, SPREAD), 0.8, 1.9))
            people.append(walker(f"h{len(people)}", (x, y), (end, y), speed))
    return people


def measure(density: float, width: float, model: str, *, both_ways: bool, seed: int) -> Flow:
    """Measure one stream in the middle of a corridor, while people still come."""
    people = tuple(walkers(density, width, both_ways=both_ways, seed=seed))
    world = corridor(width, people, np.array([0.0, width + 3.0]), UNTIL)
    seen = (
        (sensed.human_position, sensed.human_velocity)
        for sensed in frames(world, model)
        if sensed.time >= SETTLING and not sensed.tick % 10
    )
    return measured_flow(density, width, people, seen)


def measured_flow(
    density: float, width: float, people: Sequence[HumanSpec], seen: Iterable[tuple[Array, Array]]
) -> Flow:
    """Measure a stream from positions and velocities ``(h, 2)`` of its people at some moments."""
    forward = np.array([np.sign(person.route[1, 0] - person.route[0, 0]) for person in people])
    middle = 0.0 if (forward < 0.0).any() else MEASURED
    counts, speeds, touching = [], [], []
    for at, moves in seen:
        inside = np.abs(at[:, 0] - middle) < MEASURED / 2.0
        counts.append(inside.sum())
        speeds.extend((moves[:, 0] * forward)[inside])
        apart = np.hypot(*(at[:, None] - at[None, inside]).transpose(2, 0, 1))
        apart[apart == 0.0] = np.inf
        touching.append((apart.min(axis=0) < 0.5).mean())
    return Flow(
        wanted=density,
        density=float(np.mean(counts)) / (MEASURED * width),
        speed=float(np.mean(speeds)),
        touching=float(np.mean(touching)),
    )


def corridor(width: float, people: tuple[HumanSpec, ...], robot: Array, horizon: float) -> World:
    """Build a straight corridor along x."""
    north = (width + WALL) / 2.0
    sides = [(0.0, side * north, LENGTH + 4.0, WALL) for side in (-1.0, 1.0)]
    return world_with(walls_of(*sides), people, robot, horizon)


def walker(
    name: str, start: tuple[float, float], end: tuple[float, float], speed: float
) -> HumanSpec:
    """Send a person along a corridor once."""
    return HumanSpec(name=name, route=frozen_array([start, end]), speed=speed, repeat=False)


def least_gaps(model: str, width: float, *, robot: bool, seeds: int) -> list[tuple[float, float]]:
    """Least gap between bodies [m] and the speed then [m/s], head-on or past a robot, by seed."""
    found = []
    for seed in range(seeds):
        random = stream(seed, f"passing/{width}/{robot}")
        speeds, offsets = random.normal(FREE_SPEED, SPREAD, 2), random.uniform(-0.15, 0.15, 2)
        ys, people = offsets.tolist(), []
        people.append(walker("east", (-9.0, ys[0]), (9.0, ys[0]), speeds[0]))
        place = np.array([0.0, ys[1]])
        if not robot:
            people.append(walker("west", (9.0, ys[1]), (-9.0, ys[1]), speeds[1]))
            place = np.array([0.0, width + 3.0])
        world = corridor(width, tuple(people), place, 16.0)
        rows = []
        for sensed in frames(world, model):
            gap = sensed.gap_human.min() if robot else _between(sensed.human_position)
            rows.append((float(gap), float(np.hypot(*sensed.human_velocity[0]))))
        found.append(min(rows))
    return found


def _between(position: Array) -> float:
    return float(np.hypot(*(position[0] - position[1]))) - 0.5


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="by_sight")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--densities", type=float, nargs="*", default=DENSITIES)
    parser.add_argument("--widths", type=float, nargs="*", default=(2.4, 3.6))
    options = parser.parse_args()
    print("| stream | corridor | density [1/m^2] | speed [m/s] | Weidmann | | touching |")
    for both_ways in (False, True):
        for width in options.widths:
            for density in options.densities:
                flows = [
                    measure(density, width, options.model, both_ways=both_ways, seed=seed)
                    for seed in range(options.seeds)
                ]
                at = float(np.mean([flow.density for flow in flows]))
                speed = float(np.mean([flow.speed for flow in flows]))
                share = float(np.mean([flow.touching for flow in flows]))
                print(
                    f"| {'counterflow' if both_ways else 'one way'} | {width} m | {at:.2f} "
                    f"| {speed:.2f} | {weidmann(at):.2f} | {speed / weidmann(at) - 1.0:+.0%} "
                    f"| {share:.0%} |",
                    flush=True,
                )
    print("| passing | corridor | least gap [m]: least, median | touched | speed then [m/s] |")
    for robot in (False, True):
        for width in (1.6, 2.4, 3.6):
            rows = least_gaps(options.model, width, robot=robot, seeds=4 * options.seeds)
            gaps, speeds = np.array(rows).T
            print(
                f"| {'a robot that stands' if robot else 'head-on'} | {width} m "
                f"| {gaps.min():.2f}, {np.median(gaps):.2f} | {(gaps <= 0.0).sum()} of {len(gaps)} "
                f"| {np.median(speeds):.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
