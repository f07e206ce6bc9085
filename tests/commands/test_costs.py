"""Specifications that compare a run with one of a reference stack."""

import dataclasses

import pytest

from mrta_falsify import trial
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import RobotSpec, Task
from mrta_falsify.stack.pipeline import Stack
from mrta_falsify.testing.wards import ward_layout
from mrta_falsify.trial import Job, run_job

pytestmark = pytest.mark.slow  # whole missions

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
COSTS = ("costly_way", "costly_time", "costly_calls")


@pytest.fixture
def errand():
    layout = ward_layout(rooms=2)
    robot = RobotSpec(name="robot1", pose=frozen_array([*layout.rooms[0].point, 0.0]))
    task = Task(arrival=0.0, start=0, end=1, deadline=90.0)
    return dataclasses.replace(layout, robots=(robot,), tasks=(task,), horizon=90.0)


def test_the_reference_is_run_once_for_each_world_and_costs_what_it_costs(errand, monkeypatch):
    runs = []

    def counted(world, config, **more):
        runs.append(config)
        return simulate(world, config, **more)

    simulate = trial.simulate
    monkeypatch.setattr(trial, "simulate", counted)
    monkeypatch.setattr(trial, "_references", {})
    job = Job(world=errand, config=KINEMATIC, specifications=COSTS)
    for _ in range(2):
        outcome = run_job(job, keep_trace=False)
        assert {v.outcome for v in outcome.verdicts} == {"holds"}
        for v in outcome.verdicts:
            assert v.evidence["run"] == v.evidence["reference"] > 0
    assert len(runs) == 3


def test_a_stack_that_drives_needlessly_is_costly(errand, monkeypatch):
    world = dataclasses.replace(errand, horizon=400.0)
    job = Job(world=world, config=KINEMATIC, specifications=("costly_time", "all_tasks_done"))
    monkeypatch.setattr(trial, "_references", {})
    trial.judges_of(job)  # the reference runs as it is
    drive = Stack.step

    def dawdling(self, state, fleet):
        state, command, intent, events = drive(self, state, fleet)
        slowed = dataclasses.replace(command, twist=0.5 * command.twist)
        return state, slowed, intent, events

    monkeypatch.setattr(Stack, "step", dawdling)
    late, done = run_job(job, keep_trace=False).verdicts
    assert (late.outcome, done.outcome) == ("violated", "holds")
