"""Same world, same configuration: same trace; and what must not matter to a verdict."""

from __future__ import annotations

import dataclasses
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from mrta_falsify.core.config import StackConfig, apply_setting
from mrta_falsify.core.world import World
from mrta_falsify.testing.watching import watch
from mrta_falsify.trial import Job, run_job
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from tests.scenes import worlds


def digest_of(world: World, engine: str) -> str:
    config = apply_setting(StackConfig(), f"engine={engine}")
    return run_job(Job(world=world, config=config), keep_trace=False).trace.digest


def noisy_day(seed: int) -> World:
    """Six robots and eight people of the AWS hospital, for 12 s, with every noise switched on."""
    world = dataclasses.replace(vary_world(load_world("aws_hospital_day"), seed), horizon=12.0)
    noisy = (
        dataclasses.replace(
            robot,
            position_noise=0.01,
            heading_noise=0.01,
            wheel_slip=0.02,
            command_latency=0.1,
        )
        for robot in world.robots
    )
    return dataclasses.replace(world, robots=tuple(noisy))


@pytest.mark.long
@pytest.mark.parametrize("engine", ["kinematic", "bullet"])
def test_runs_in_several_processes_give_one_digest(engine):
    world = noisy_day(7)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(3, mp_context=context) as pool:
        digests = list(pool.map(digest_of, [world] * 8, [engine] * 8))
    assert len(set(digests)) == 1
    assert digest_of(world, engine) == digests[0]


@pytest.mark.slow
def test_another_seed_gives_another_digest():
    assert digest_of(noisy_day(7), "kinematic") != digest_of(noisy_day(8), "kinematic")


def test_two_runs_of_one_scene_give_one_digest():
    world = dataclasses.replace(worlds.cluttered_ward(), horizon=15.0)
    for engine in ("kinematic", "bullet"):
        assert digest_of(world, engine) == digest_of(world, engine)


@pytest.mark.parametrize(
    "order",
    [(6, 5, 4, 3, 2, 1, 0), pytest.param((3, 0, 6, 1, 5, 2, 4), marks=pytest.mark.slow)],
)
def test_order_and_names_of_furniture_do_not_matter_to_verdicts(order):
    world = worlds.cluttered_ward()
    shuffled = tuple(
        dataclasses.replace(world.furniture[i], name=f"thing {9 - k}") for k, i in enumerate(order)
    )
    other = dataclasses.replace(world, furniture=shuffled, walls=world.walls[::-1])
    one, two = watch(world), watch(other)
    assert len(one.verdicts) == len(two.verdicts) > 5
    for mine, theirs in zip(one.verdicts, two.verdicts, strict=True):
        assert mine.spec == theirs.spec
        assert mine.violated == theirs.violated
        np.testing.assert_allclose(mine.robustness, theirs.robustness, rtol=1e-6, atol=1e-6)
    assert one.sim_time == two.sim_time
    assert one.contacts == two.contacts
