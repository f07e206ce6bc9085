"""Stacks under test of the labelled set, and an allocator that makes robots meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.config import Choice, StackConfig

CONTROL_RATE = 10  # Hz: half the default's, and half the time
IN_TURN = Choice("benchmarks.oracle.stacks:InTurn")
#: leaders that never pass on the lead, followers that brake: MRTA-Sim's scheme
BRAKE = Choice("cluster_cbf", {"followers": "brake"})
SHARED = Choice("decentralised_cbf")  #: the lower-ranked robot gives way
SYMMETRIC = Choice("decentralised_cbf", {"share": 0.5})  #: nobody gives way
ALONE = Choice("cluster_cbf", {"neighbour_distance": 0.7})  #: leaders see robots that touch only


def stack(
    controller: Choice | None = None, *, defects: tuple[str, ...] = (), **layers: Choice
) -> StackConfig:
    """The default stack on the kinematic engine, with the layers given."""
    return StackConfig(
        engine=Choice("kinematic"),
        control_rate=CONTROL_RATE,
        controller=controller or Choice("cluster_cbf"),
        defects=tuple(sorted(defects)),
        **layers,
    )


def any_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers; the default one most often."""
    pick = int(random.integers(8))
    if pick == 0:
        return stack(priority_rule=Choice("distance_to_goal"), **layers)
    return stack(
        (None, None, None, None, BRAKE, SHARED, SYMMETRIC, ALONE)[pick],
        **layers,
    )


def weak_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """One of the controllers that do not plan for others."""
    return stack((BRAKE, SHARED, SYMMETRIC, ALONE)[int(random.integers(4))], **layers)


def mixed_stack(random: np.random.Generator, **layers: Choice) -> StackConfig:
    """Mostly one of the controllers that do not plan for others: robots get stuck more often."""
    return (weak_stack if random.random() < 0.65 else any_stack)(random, **layers)


class InTurn:
    """Task k goes to robot k modulo their number, in order of number: opposing ways at will."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        return Allocation(itineraries=tuple(_itinerary(robot, problem) for robot in problem.robots))


def _itinerary(robot: RobotPlan, problem: AllocationProblem) -> tuple[Stop, ...]:
    own = [task for task in problem.tasks if task.number % len(problem.robots) == robot.robot]
    time, room = max(problem.now, robot.free_at), robot.room
    stops: list[Stop] = []
    for task in sorted(own, key=lambda task: (task.number not in robot.onboard, task.number)):
        for stop in _stops_of(task, with_pickup=task.number not in robot.onboard):
            time += float(problem.travel_times[room, stop.room]) + stop.time
            room = stop.room
            stops.append(Stop(task=stop.task, action=stop.action, room=room, time=time))
    return tuple(stops)


def _stops_of(task: OpenTask, *, with_pickup: bool) -> list[Stop]:
    """Stops with their service times [s] in ``time``."""
    stops = [Stop(task=task.number, action="dropoff", room=task.end, time=task.dropoff_time)]
    if with_pickup:
        first = Stop(task=task.number, action="pickup", room=task.start, time=task.pickup_time)
        stops.insert(0, first)
    return stops
