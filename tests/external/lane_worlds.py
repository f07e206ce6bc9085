"""Worlds of one narrow lane, and the two stacks that drive in it: in Python and in C++."""

from __future__ import annotations

import dataclasses
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import RobotSpec, Room, Task, Wall, World

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
LENGTH, WIDTH = 14.0, 1.2  # m
THICK = 0.2  # m, of the walls


def lane_world(offset: float = 0.0, *, head_on: bool = True, followers: int = 0) -> World:
    """Build a lane with a room at each end, and tasks from each to the other.

    Args:
        offset: of the first robot's start [m].
        head_on: whether a robot comes from the other end.
        followers: robots behind the first, with tasks of the same direction.
    """
    middle = 0.5 * WIDTH
    rooms = tuple(Room(name=name, point=np.array([x, middle])) for name, x in
                  (("west", 4.0), ("east", LENGTH - 1.0)))  # fmt: skip
    starts = [(4.5 + offset, 0.0)] + [(2.4 - 1.2 * i, 0.0) for i in range(followers)]
    ways = [(0, 1)] + [(0, 1)] * followers
    if head_on:
        starts.append((LENGTH - 1.5, math.pi))
        ways.append((1, 0))
    robots = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=np.array([x, middle, yaw]))
        for i, (x, yaw) in enumerate(starts)
    )
    walls = tuple(
        Wall(
            name=name,
            polygon=np.array([[0.0, y], [LENGTH, y], [LENGTH, y + THICK], [0.0, y + THICK]]),
        )
        for name, y in (("south", -THICK), ("north", WIDTH))
    )
    tasks = tuple(
        Task(arrival=0.0, start=start, end=end, deadline=100.0, robot=robot.name)
        for robot, (start, end) in zip(robots, ways, strict=True)
    )
    return World(
        name="lane",
        bounds=np.array([0.0, -THICK, LENGTH, WIDTH + THICK]),
        robots=robots,
        rooms=rooms,
        walls=walls,
        tasks=tasks,
        travel_times=np.array([[0.0, 25.0], [25.0, 0.0]]),
        horizon=60.0,
    )


def built(folder: Path) -> Path | None:
    """Compile the stack in C++; None: there is no compiler."""
    compiler = shutil.which("c++")
    if compiler is None:
        return None
    program = folder / "lane_stack"
    header = f"-I{ROOT / 'simulator_interface' / 'clients'}"
    flags = ["-std=c++17", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", header]
    source = str(HERE / "lane_stack.cpp")
    subprocess.run([compiler, *flags, "-o", str(program), source], check=True)
    return program


def lane_config(program: Path | None, branch: str, engine: str = "kinematic") -> StackConfig:
    """Configure the stack of ``program``, or the one in Python."""
    command = (str(program),) if program else (sys.executable, "-m", "tests.external.lane_stack")
    stack = ExternalStack(
        command=command, folder=str(ROOT), env={"PYTHONPATH": str(ROOT)}, branch=branch
    )
    return dataclasses.replace(StackConfig(), engine=Choice(engine), stack=stack)
