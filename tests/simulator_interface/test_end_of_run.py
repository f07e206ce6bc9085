"""When a run ends and what it then counts, whatever its stack says: the shipped demo day."""

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.stack.dispatcher import Dispatcher
from mrta_falsify.stack.pipeline import Stack
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import Outcome, simulate

pytestmark = pytest.mark.slow  # whole missions

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
JUDGES = (
    "exclusive_use",
    "kinematic_limits",
    "honest_events",
    "all_tasks_done",
    "deadlines",
    "no_starvation",
    "progress",
)
HORIZON = 300.0  # s; the default stack delivers the last task of the day at 242 s


@pytest.fixture(scope="module")
def day() -> World:
    return dataclasses.replace(load_world("aws_hospital_day"), horizon=HORIZON)


@pytest.fixture(scope="module")
def usual(day) -> Outcome:
    """The run of the default stack."""
    return run(day)


def run(world: World, config: StackConfig = KINEMATIC) -> Outcome:
    return simulate(world, config, specifications=build_specifications(JUDGES), keep_trace=False)


def verdict(outcome: Outcome, name: str):
    return next(v for v in outcome.verdicts if v.spec == name)


def says(monkeypatch, told):
    """Let the stack say what ``told`` (time, events) gives, and that no stops are left."""
    honest = Stack.step

    def step(self, state, fleet):
        state, command, intent, events = honest(self, state, fleet)
        nothing_left = dataclasses.replace(intent, tasks_left=np.zeros_like(intent.tasks_left))
        return state, command, nothing_left, told(fleet.time, events)

    monkeypatch.setattr(Stack, "step", step)


def all_claims(time: float, tasks: int, kinds=("picked-up", "dropped-off")):
    return tuple(
        StackEvent(time=time, kind=kind, robot=task % 3, task=task)
        for task in range(tasks)
        for kind in kinds
    )


def test_the_default_stack_loses_nothing_and_breaks_no_rule(day, usual):
    outcome = usual
    assert outcome.ended == "all-tasks-done"
    assert (outcome.tasks.completed, outcome.tasks.total) == (6, 6)
    assert outcome.robots_finished == len(day.robots)
    for name in ("all_tasks_done", "honest_events", "kinematic_limits", "exclusive_use"):
        assert verdict(outcome, name).outcome == "holds", name


def test_a_dispatcher_that_never_learns_of_the_last_task_fails(day, monkeypatch):
    arrive = Dispatcher._take_arrivals

    def all_but_the_last(self, state, time):
        order = self._order
        self._order = order[:-1]
        arrived = arrive(self, state, time)
        self._order = order
        return arrived

    monkeypatch.setattr(Dispatcher, "_take_arrivals", all_but_the_last)
    outcome = run(day)
    assert (outcome.ended, outcome.tasks.completed) == ("horizon", 5)
    assert verdict(outcome, "all_tasks_done").robustness == pytest.approx(-1 / 6)
    assert outcome.robots_finished == 0


def test_a_stack_that_says_at_once_that_all_is_done_fails(day, monkeypatch):
    monkeypatch.setattr(Dispatcher, "_take_arrivals", lambda self, state, time: False)
    tasks = len(day.tasks)
    says(monkeypatch, lambda time, events: all_claims(time, tasks) if time == 0.0 else events)
    outcome = run(day)
    assert (outcome.ended, outcome.tasks.completed) == ("horizon", 0)
    assert verdict(outcome, "all_tasks_done").robustness == -1.0
    assert verdict(outcome, "deadlines").violated
    lies = verdict(outcome, "honest_events")
    assert (lies.violated_at, lies.evidence["count"]) == (0.0, 2 * tasks)
    assert outcome.robots_finished == 0


def test_refused_claims_end_no_run_and_stand_in_no_ones_way(day, usual, monkeypatch):
    says(monkeypatch, lambda t, events: (*all_claims(t, 6, ("dropped-off",)), *events))
    outcome = run(day)
    assert (outcome.ended, outcome.tasks.completed) == ("all-tasks-done", 6)
    assert outcome.sim_time == usual.sim_time
    assert not verdict(outcome, "all_tasks_done").violated
    assert verdict(outcome, "honest_events").violated


@pytest.mark.long
def test_a_task_that_no_one_claims_is_undelivered(day, monkeypatch):
    def silent(time, events):
        return tuple(e for e in events if not (e.kind == "dropped-off" and e.task == 2))

    says(monkeypatch, silent)
    outcome = run(day)
    assert (outcome.ended, outcome.tasks.completed) == ("horizon", 5)
    assert verdict(outcome, "all_tasks_done").who == ("task2",)


def test_a_stack_that_tells_no_deliveries_runs_to_the_horizon_and_is_not_judged(day):
    short = dataclasses.replace(day, horizon=60.0)
    outcome = run(short, dataclasses.replace(KINEMATIC, withheld=("deliveries",)))
    assert outcome.ended == "horizon"
    assert not outcome.tasks.told
    unjudged = {v.spec for v in outcome.verdicts if v.not_judged}
    assert unjudged == {"all_tasks_done", "deadlines", "no_starvation", "honest_events"}


def test_what_is_withheld_changes_nothing_but_what_is_seen(day):
    hidden = dataclasses.replace(KINEMATIC, withheld=("goals", "paths"))
    short = dataclasses.replace(day, horizon=30.0)
    open_run = simulate(short, KINEMATIC).trace
    closed_run = simulate(short, hidden).trace
    assert np.array_equal(open_run.columns["pose"], closed_run.columns["pose"])
    assert np.isnan(closed_run.columns["goal"]).all()
    assert not closed_run.columns["tasks_left"].any()
    assert all(len(change.points) == 0 for change in closed_run.paths)
