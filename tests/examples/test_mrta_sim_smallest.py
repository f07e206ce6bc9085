"""The smallest failures of MRTA-Sim's nodes are worlds that its own files hold.

That the nodes fail in them is tested in ``test_mrta_sim``, which needs a checkout.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrta_falsify.commands.worlds import find_world
from simulator_interface.formats.mrta_sim_files import robot_setup, task_stream

SMALLEST = Path(__file__).resolve().parents[2] / "examples" / "mrta_sim" / "smallest"
PROGRAMS = sorted(SMALLEST.glob("*.scenic"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_its_own_files_hold_the_world(program):
    world, folder = find_world(program), program.with_suffix("")
    assert json.loads((folder / "robot_setup.json").read_text()) == robot_setup(world)
    assert json.loads((folder / "testcase.json").read_text()) == task_stream(world)
    assert not world.humans
    again = find_world(
        "aws_hospital_day", tasks=folder / "testcase.json", robots=folder / "robot_setup.json"
    )
    assert [robot.name for robot in again.robots] == [robot.name for robot in world.robots]
    for robot, other in zip(again.robots, world.robots, strict=True):
        assert robot.pose.tolist() == other.pose.tolist()
    tasks = [
        [(task.arrival, task.start, task.end, task.deadline) for task in found.tasks]
        for found in (again, world)
    ]
    assert tasks[0] == tasks[1]
