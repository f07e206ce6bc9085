"""When a continuation may end: at its bound, or once it is proven to be at rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.directives import Wait, WaitUntil
from mrta_falsify.core.steadiness import Memory, memory_of
from mrta_falsify.core.world import Blockage, Task
from mrta_falsify.specs.deadlock.rest import ProvenRest, longest_pause, timed
from mrta_falsify.stack.timers import LONGEST_OF_STAGES, longest_timer
from tests.specs.frames import Human, Robot, Script

TIMER = 10.0  # s


class FakeRun:
    """A run whose memory is made up."""

    longest_timer = TIMER
    plan: tuple[float, ...] = ()  #: moments ahead at which the stack decides anew [s]

    def __init__(self, memory) -> None:
        self._memory = memory
        self.time = 0.0

    def memory(self) -> Memory:
        return self._memory(self.time)

    def planned_times(self) -> tuple[float, ...]:
        return (5.0, *self.plan)


def at_rest_from(memory, *, robot=(1.0, 1.0), seconds=60.0, **more) -> float:
    """When rest is proven first [s]; inf: never."""
    script = Script(robots=[Robot(at=robot, goal=(9.0, 1.0))], seconds=seconds, **more)
    world = script.world()
    rest, run = ProvenRest(world), FakeRun(memory)
    rest.take_run(run)
    for frame in script.frames(world):
        run.time = frame.sensed.time
        if frame.sensed.tick % 5 == 0:
            rest.update(frame.sensed)
            if rest.lasts_until(run.time) > run.time:
                return run.time
    return np.inf


def constant(time: float) -> Memory:
    return memory_of([1.0, 2.0])


def test_rest_is_proven_by_equal_memory_over_twice_the_longest_timer():
    assert at_rest_from(constant) == pytest.approx(2.0 * TIMER, abs=0.6)


def test_a_clock_and_a_counter_of_ticks_may_go_on():
    assert at_rest_from(lambda time: memory_of([time, round(time * 20)])) < 30.0


def test_a_countdown_is_not_rest():
    assert at_rest_from(lambda time: memory_of([100.0 - time])) == np.inf


def test_memory_that_changes_otherwise_is_not_rest():
    assert at_rest_from(lambda time: memory_of([np.sin(time)])) == np.inf
    assert at_rest_from(lambda time: memory_of(np.random.default_rng(int(time)))) == np.inf


def test_a_robot_that_creeps_is_not_at_rest():
    assert at_rest_from(constant, robot=lambda time: (1e-9 * time, 0.0, 0.0)) == np.inf


def test_a_service_longer_than_the_stack_s_timers_is_waited_for():
    task = Task(arrival=0.0, start=0, end=0, deadline=np.inf, pickup_time=15.0)
    more = {"rooms": [(9.0, 1.0)], "tasks": [task]}
    assert at_rest_from(constant, **more) >= 2.0 * 15.0


@pytest.mark.parametrize(("plan", "until"), [((), np.inf), ((500.0,), 500.0)])
def test_rest_lasts_to_the_moment_at_which_the_stack_decides_anew(plan, until):
    script = Script(robots=[Robot(at=(1.0, 1.0))], humans=[Human((4.0, 4.0))], seconds=30.0)
    world = script.world()
    rest, run = ProvenRest(world), FakeRun(constant)
    run.plan = plan
    rest.take_run(run)
    for frame in script.frames(world):
        rest.update(frame.sensed)
    assert rest.lasts_until(30.0) == until


def test_people_who_appear_and_leave_end_rest_and_those_who_stay_do_not():
    world = Script(robots=[Robot(at=(1.0, 1.0))], humans=[Human((4.0, 4.0))]).world()
    assert not len(timed(world, to_come=False)[timed(world, to_come=False) > 0.0])
    passing = dataclasses.replace(world.humans[0], appears_at=200.0, leaves_at=400.0)
    world = dataclasses.replace(world, humans=(passing,))
    assert {200.0, 400.0} <= set(timed(world, to_come=False).tolist())


def test_what_happens_by_the_clock_ends_rest():
    cart = Blockage(name="cart", polygon=np.eye(3, 2), start=0.0, end=200.0)
    script = Script(robots=[Robot(at=(1.0, 1.0))], humans=[Human((4.0, 4.0))])
    world = dataclasses.replace(script.world(), events=(cart,))
    steps = (Wait(duration=50.0), WaitUntil(time=300.0))
    human = dataclasses.replace(world.humans[0], directives=steps, route=world.humans[0].route[:1])
    world = dataclasses.replace(world, humans=(human,))
    assert {200.0, 300.0} <= set(timed(world, to_come=False).tolist())
    assert longest_pause(world) >= 50.0


def test_the_longest_timer_is_known_of_our_own_layers_only():
    assert longest_timer(StackConfig()) == LONGEST_OF_STAGES
    patient = StackConfig(controller=Choice("cluster_cbf", {"patience": 70.0}))
    assert longest_timer(patient) == 70.0
    foreign = StackConfig(allocator=Choice("exec:python3 allocator.py"))
    assert longest_timer(foreign) == np.inf
    named = StackConfig(queue_policy=Choice("mrta_falsify.stack.resources.policies:Fifo"))
    assert longest_timer(named) == np.inf
