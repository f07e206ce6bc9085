"""Loads what every run needs, so that forks made afterwards have it.

The first ticks of a run import modules and read some fifty compiled functions from numba's cache:
1.8 s of CPU, in each process that has not done so.
"""

from __future__ import annotations

import contextlib
import functools

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Furniture, HumanSpec, RobotSpec, Room, Task, Wall, World
from mrta_falsify.process.budget import own_budget
from mrta_falsify.specs.library import build_specifications
from simulator_interface.simulate import EpisodeRun

TICKS = 20  # in which each stage of the stack has been called


@functools.cache
def warm_up() -> None:
    """Run the default stack for a second in a hall of two robots, once in this process."""
    with own_budget():
        run = EpisodeRun(
            _hall(),
            StackConfig(engine=Choice("kinematic")),
            specifications=build_specifications(),
            keep_trace=False,
            copies=False,
        )
        with contextlib.closing(run):
            for _ in range(TICKS):
                run.advance()


def _hall() -> World:
    """Build a hall of 8 m x 4 m with a table, two robots, a person, and a task each way."""
    walls = {
        "south": rectangle(8.2, 0.2, (4.0, -0.1)),
        "north": rectangle(8.2, 0.2, (4.0, 4.1)),
        "west": rectangle(0.2, 4.4, (-0.1, 2.0)),
        "east": rectangle(0.2, 4.4, (8.1, 2.0)),
    }
    return World(
        name="hall",
        bounds=frozen_array([-0.5, -0.5, 8.5, 4.5]),
        walls=tuple(Wall(name=name, polygon=polygon) for name, polygon in walls.items()),
        furniture=(Furniture(name="table", kind="desk", polygon=rectangle(1.0, 1.0, (4.0, 1.0))),),
        rooms=(
            Room(name="west_end", point=frozen_array([1.0, 2.0])),
            Room(name="east_end", point=frozen_array([7.0, 2.0])),
        ),
        travel_times=frozen_array([[0.0, 10.0], [10.0, 0.0]]),
        robots=(
            RobotSpec(name="robot1", pose=frozen_array([1.0, 1.0, 0.0])),
            RobotSpec(name="robot2", pose=frozen_array([2.0, 1.0, 0.0])),
        ),
        humans=(HumanSpec(name="human1", route=frozen_array([[2.0, 3.0], [5.0, 3.0]])),),
        tasks=(
            Task(arrival=0.0, start=0, end=1, deadline=100.0),
            Task(arrival=0.0, start=1, end=0, deadline=100.0),
        ),
        horizon=60.0,
    )
