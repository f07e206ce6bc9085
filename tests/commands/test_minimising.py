from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.analysis.minimize.minimising import minimize_job, write_as_program
from mrta_falsify.analysis.minimize.reruns import PERTURBED
from mrta_falsify.campaigns.signature import signature
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Furniture, HumanSpec, RobotSpec
from mrta_falsify.lab import Lab
from mrta_falsify.testing import planted as worlds
from mrta_falsify.trial import Job, judge, on_kinematic_engine
from scenic_worlds.program import compile_program
from tests.external import lane_worlds


@pytest.fixture(scope="module")
def cluttered():
    """A stalled robot with a person, a chair and an idle robot that have no part in it."""
    world = worlds.same_room_twice_stalls(0)
    far = world.rooms[-1].point
    crowd = dataclasses.replace(
        world,
        robots=(*world.robots, RobotSpec(name="spare", pose=frozen_array([*far, 0.0]))),
        humans=(HumanSpec(name="visitor", route=frozen_array([(far[0] + 1.0, far[1] + 1.5)])),),
        furniture=(
            *world.furniture,
            Furniture(
                name="chair",
                kind="chair",
                polygon=rectangle(0.4, 0.4, (far[0] - 1.5, far[1] + 1.5)),
            ),
        ),
    )
    config = on_kinematic_engine(StackConfig(defects=("same_room_twice_stalls",)))
    return Job(world=crowd, config=config, specifications=(worlds.STANDS,), early_stop=True)


@pytest.fixture(scope="module")
def alone(cluttered):
    """What one worker makes of it."""
    return minimize_job(cluttered, max_runs=60)


@pytest.fixture(scope="module")
def begun(cluttered):
    """What two runs make of it."""
    return minimize_job(cluttered, max_runs=2)


@pytest.mark.slow
def test_what_has_no_part_in_the_failure_goes_and_the_rest_is_needed(cluttered, alone):
    found = alone
    world = found.world
    assert found.finding.one_minimal
    assert [robot.name for robot in world.robots] == ["robot1"]
    assert world.humans == ()
    assert "chair" not in [item.name for item in world.furniture]
    assert world.horizon < cluttered.world.horizon
    assert found.finding.share_removed > 0.4
    assert found.finding.pairs_tried == found.finding.pairs > 0
    assert found.finding.jittered.runs == PERTURBED
    assert found.finding.signature == signature(judge(cluttered).verdicts)
    again = judge(dataclasses.replace(cluttered, world=world))
    assert again.outcome.trace.digest == found.judged.outcome.trace.digest
    for number in range(len(world.tasks)):
        tasks = world.tasks[:number] + world.tasks[number + 1 :]
        without = dataclasses.replace(cluttered, world=dataclasses.replace(world, tasks=tasks))
        assert signature(judge(without).verdicts) != found.finding.signature


@pytest.mark.long
def test_the_runs_are_bounded_and_a_second_call_goes_on(cluttered, tmp_path):
    path = tmp_path / "runs.jsonl"
    few = minimize_job(cluttered, max_runs=2, lab=Lab(path))
    assert few.finding.runs == 2 + PERTURBED
    assert not few.finding.one_minimal
    seen = []
    more = minimize_job(
        cluttered,
        max_runs=4,
        lab=Lab(path),
        on_run=lambda runs, text: seen.append(runs),
    )
    assert seen == list(range(1, 4 + PERTURBED + 1))
    assert more.finding.runs == 4 + PERTURBED


@pytest.mark.long
def test_several_workers_come_to_the_same_world(cluttered, alone):
    together = minimize_job(cluttered, max_runs=60, lab=Lab(workers=2))
    assert together.world.digest() == alone.world.digest()
    assert together.judged.outcome.trace.digest == alone.judged.outcome.trace.digest
    assert together.finding.one_minimal
    assert together.finding.runs >= alone.finding.runs  # what runs ahead is not always needed


@pytest.mark.long
def test_several_workers_keep_to_the_runs_allowed(cluttered, tmp_path):
    path = tmp_path / "runs.jsonl"
    few = minimize_job(cluttered, max_runs=3, lab=Lab(path, workers=2))
    assert few.finding.runs == 3 + PERTURBED
    assert not few.finding.one_minimal
    more = minimize_job(cluttered, max_runs=4, lab=Lab(path))
    assert more.finding.runs == 4 + PERTURBED


def test_a_run_that_holds_cannot_be_minimised(cluttered):
    healthy = dataclasses.replace(cluttered, config=on_kinematic_engine(StackConfig()))
    with pytest.raises(InputError, match="violates nothing"):
        minimize_job(healthy)


@pytest.mark.slow
def test_values_move_to_nominal_where_the_failure_does_not_need_them(cluttered):
    noisy = tuple(
        dataclasses.replace(robot, position_noise=0.003) for robot in cluttered.world.robots
    )
    job = dataclasses.replace(
        cluttered, world=dataclasses.replace(cluttered.world, robots=noisy, ray_noise=0.001)
    )
    found = minimize_job(job, max_runs=60)
    assert np.all([robot.position_noise == 0.0 for robot in found.world.robots])
    assert "noise and delays of robots" in found.finding.removed


@pytest.mark.slow
def test_the_smallest_world_is_written_as_a_program_that_fails_in_the_same_way(
    cluttered, begun, tmp_path
):
    said = write_as_program(begun, cluttered, tmp_path)
    assert said in ("identical", "same failure")
    again = compile_program(tmp_path / "world.min.scenic").sample(0)
    judged = judge(dataclasses.replace(cluttered, world=again), keep_trace=False)
    assert signature(judged.verdicts) == begun.finding.signature


@pytest.mark.slow
def test_no_program_is_left_that_does_not_fail(cluttered, begun, tmp_path):
    healthy = dataclasses.replace(cluttered, config=on_kinematic_engine(StackConfig()))
    assert "no failure" in write_as_program(begun, healthy, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_failure_with_two_reasons_keeps_the_one_it_began_with(monkeypatch):
    monkeypatch.setattr(lane_worlds, "WIDTH", 0.7)  # too narrow for two
    lane = dataclasses.replace(lane_worlds.lane_world(), horizon=130.0)
    box = Furniture(name="box", kind="box", polygon=rectangle(0.5, 0.6, (8.5, 0.35)))
    job = Job(
        world=dataclasses.replace(lane, furniture=(box,)),
        config=dataclasses.replace(
            on_kinematic_engine(StackConfig()),
            controller=Choice("cluster_cbf", {"recovery": False}),
        ),
        specifications=("progress",),
        early_stop=True,
    )
    behind = judge(dataclasses.replace(job, world=lane), keep_trace=False).verdicts
    assert signature(behind) == "progress/robot"  # they meet, and neither gives way
    found = minimize_job(job, max_runs=60)
    assert found.finding.one_minimal
    assert found.finding.signature == signature(found.judged.verdicts) == "progress/solid"
    assert [item.name for item in found.world.furniture] == ["box"]
    assert len(found.world.robots) == 1
