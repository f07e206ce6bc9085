"""What a seed changes in a fixed world: starts, people's pace and phase, sensor noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import RobotSpec, World
from simulator_interface.solids import Solids

JITTER_START = 0.02  # m, how exactly a robot is put down on a real floor
START_OFFSET = 0.2  # m, robots start within this of their place
WALKING_SPEED = (1.0, 0.15)  # m/s, mean and standard deviation of people's desired speed
SLOWEST, FASTEST = 0.5, 1.5  # m/s, bounds of the desired speed
RAY_NOISE = 0.01  # m, standard deviation of measured obstacle distances, as the Waffle's lidar
ATTEMPTS = 200  # places tried for a start


def vary_world(world: World, seed: int) -> World:
    """Vary a fixed world as candidate 0 of a campaign with ``seed`` does.

    Start poses move within 0.2 m (never into an obstacle or another robot), people get a
    phase on their route and a desired speed, and obstacle distances get noise.

    Args:
        world: the fixed world.
        seed: >= 0.

    Returns:
        A new world whose ``seed`` field is ``seed``.

    Raises:
        WorldError: a robot's start has no free place within 0.2 m.
    """
    robots = _moved_starts(world, stream(seed, "start_offsets"), reach=START_OFFSET)
    random = stream(seed, "people")
    humans = tuple(
        dataclasses.replace(
            human,
            start=float(random.uniform()) if len(human.route) > 1 else human.start,
            speed=float(np.clip(random.normal(*WALKING_SPEED), SLOWEST, FASTEST)),
        )
        for human in world.humans
    )
    return dataclasses.replace(world, robots=robots, humans=humans, ray_noise=RAY_NOISE, seed=seed)


def perturb_world(world: World, seed: int) -> World:
    """Vary a world by less than can be controlled on a real floor.

    Starts move within 2 cm, people's pace within 2 % and phase within 1 % of their route. Tasks
    come up to 0.5 s later, and rays have 1 cm of noise. A failure that survives most of these
    is robust; one that needs its exact numbers stands on a knife edge.

    Args:
        world: any world that runs.
        seed: >= 0.

    Raises:
        WorldError: a robot's start has no free place within 2 cm.
    """
    random = stream(seed, "jitter")
    robots = _moved_starts(world, random, reach=JITTER_START)
    humans = tuple(
        dataclasses.replace(
            human,
            start=float((human.start + random.uniform(-0.01, 0.01)) % 1.0)
            if len(human.route) > 1
            else human.start,
            speed=float(human.speed * random.uniform(0.98, 1.02)),
        )
        for human in world.humans
    )
    tasks = tuple(
        dataclasses.replace(
            task, arrival=float(min(task.arrival + random.uniform(0.0, 0.5), task.deadline))
        )
        for task in world.tasks
    )
    return dataclasses.replace(
        world,
        robots=robots,
        humans=humans,
        tasks=tasks,
        ray_noise=max(world.ray_noise, RAY_NOISE),
        seed=seed,
    )


def _moved_starts(
    world: World, random: np.random.Generator, *, reach: float
) -> tuple[RobotSpec, ...]:
    """Move every robot's start within ``reach`` [m], never into anything solid."""
    outlines = [*world.solid_polygons(), *(item.polygon for item in world.movable_furniture())]
    solids = Solids(outlines)
    placed: list[RobotSpec] = []
    for robot in world.robots:
        placed.append(_moved_start(robot, placed, solids, random, reach))
    return tuple(placed)


def _moved_start(
    robot: RobotSpec,
    placed: list[RobotSpec],
    solids: Solids,
    random: np.random.Generator,
    reach: float,
) -> RobotSpec:
    for _ in range(ATTEMPTS):
        angle, share = random.uniform(0.0, 2.0 * np.pi), np.sqrt(random.uniform())
        offset = reach * share * np.array([np.cos(angle), np.sin(angle)])
        pose = np.append(robot.pose[:2] + offset, robot.pose[2])
        if _is_free(pose, robot.radius, placed, solids):
            return dataclasses.replace(robot, pose=frozen_array(pose))
    raise WorldError(
        f"robots.{robot.name}.pose is {robot.pose.tolist()}; within {reach} m of it there "
        f"is no place {robot.radius} m clear of obstacles and robots"
    )


def _is_free(pose: Array, radius: float, placed: list[RobotSpec], solids: Solids) -> bool:
    for other in placed:
        if np.hypot(*(pose[:2] - other.pose[:2])) <= radius + other.radius:
            return False
    return not solids.met_by_disc(float(pose[0]), float(pose[1]), radius)
