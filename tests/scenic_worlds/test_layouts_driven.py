import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import RobotSpec, Task
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.layouts.hospital import hospital
from scenic_worlds.layouts.warehouse import warehouse
from simulator_interface.simulate import simulate

LAYOUTS = {
    "line": lambda: hospital(shape="line", rooms=4, corridor_width=2.2),
    "ell": lambda: hospital(shape="ell", rooms=4),
    "ring": lambda: hospital(shape="ring", rooms=4, door_width=0.8, bathroom=1.0),
    "comb": lambda: hospital(shape="comb", rooms=4, corridor_width=1.8),
    "lift": lambda: hospital(shape="line", rooms=3, lifts=1, station=False),
    "warehouse": lambda: warehouse(picks=4, aisle_width=1.8),
}


def with_fleet(layout):
    rooms = len(layout.rooms)
    starts = [layout.rooms[i].point for i in range(rooms - 3, rooms)] + [layout.parking[0]]
    robots = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=frozen_array([*start, 0.0]))
        for i, start in enumerate(starts)
    )
    tasks = tuple(
        Task(arrival=0.0, start=i % rooms, end=(i + 2) % rooms, deadline=600.0) for i in range(4)
    )
    return dataclasses.replace(layout, robots=robots, tasks=tasks, horizon=600.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", LAYOUTS)
def test_four_robots_do_their_tasks_without_touching_a_wall(name):
    world = with_fleet(LAYOUTS[name]())
    outcome = simulate(
        world,
        StackConfig(engine=Choice("kinematic")),
        specifications=build_specifications(("no_robot_static_contact", "all_tasks_done")),
        keep_trace=False,
    )
    assert outcome.tasks.completed == 4
    assert not any(verdict.violated for verdict in outcome.verdicts)
    assert outcome.sim_time < np.inf
