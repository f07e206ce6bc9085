"""A crowded world says what it costs before it is run."""

from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.commands.crowd_cost import cost_of
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import HumanSpec, RobotSpec, Task, read_world
from tests.fuzz.readers import RECORDED

WORLD = read_world(RECORDED / "beds/trials/0003/world.json")
QUICK = StackConfig(engine=Choice("kinematic"))


def crowd(**counts: int):
    made = {
        "robots": lambda i: RobotSpec(name=f"x{i}", pose=[0.1 * i, 0.0, 0.0]),
        "humans": lambda i: HumanSpec(name=f"p{i}", route=[[0.0, 0.1 * i]]),
        "tasks": lambda i: Task(arrival=0.0, start=0, end=1, deadline=100.0),
        "furniture": lambda i: dataclasses.replace(WORLD.furniture[0], name=f"f{i}"),
    }
    parts = {name: tuple(map(made[name], range(count))) for name, count in counts.items()}
    return dataclasses.replace(WORLD, **parts)


@pytest.mark.parametrize(
    "counts", [{"robots": 300}, {"humans": 200}, {"tasks": 500}, {"furniture": 400}]
)
def test_a_crowd_of_anything_is_one(counts):
    assert cost_of(crowd(**counts), QUICK).is_crowd
    assert not cost_of(WORLD, QUICK).is_crowd


def test_more_costs_more():
    few, many = (cost_of(crowd(robots=n), QUICK) for n in (100, 300))
    assert many.second_s > 2 * few.second_s
    assert cost_of(crowd(robots=300), StackConfig()).second_s > many.second_s
    assert cost_of(crowd(robots=300, tasks=500), QUICK).start_s > many.start_s
    assert many.total_s == pytest.approx(many.start_s + many.second_s * WORLD.horizon)
