"""When a continuation has shown enough and may end: at its bound, or once it is proven at rest."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.directives import Wait, WaitUntil
from mrta_falsify.core.fleet import Sensed
from mrta_falsify.core.protocols import SteadyRun
from mrta_falsify.core.steadiness import Memory
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.service_clock import SERVICE_FACTOR, SERVICE_SLACK

NEVER = 1e9  #: s, when people leave who do not


def longest_pause(world: World) -> float:
    """Find how long something of the world may stand by a timer of its own, at most [s].

    Services at pick-up and drop-off, at lifts and chargers, and pauses of people.
    """
    steps = [step for human in world.humans for step in human.directives]
    pauses = [step.duration for step in steps if isinstance(step, Wait)]
    pauses += [human.pause for human in world.humans]
    services = [time for task in world.tasks for time in (task.pickup_time, task.dropoff_time)]
    in_areas = [resource.service_time for resource in world.resources]
    longest = max(services, default=0.0) + max(in_areas, default=0.0)
    return max(SERVICE_FACTOR * longest + SERVICE_SLACK, *pauses, 0.0)


def timed(world: World, *, to_come: bool, deadlines: bool = True) -> Array:
    """List the moments at which something happens by the clock, sorted [s].

    Args:
        world: of the episode.
        to_come: whether tasks still arrive, and blockages and outages begin.
        deadlines: whether deadlines count, by which a stack may decide.
    """
    times = [event.end for event in world.events]
    times += [time for human in world.humans for time in (human.appears_at, human.leaves_at)]
    times += [robot.joins_at for robot in world.robots]
    if deadlines:
        times += [task.deadline for task in world.tasks]
    steps = [step for human in world.humans for step in human.directives]
    times += [step.time for step in steps if isinstance(step, WaitUntil)]
    if to_come:
        times += [event.start for event in world.events]
        times += [task.arrival for task in world.tasks]
    found = np.array(times, dtype=np.float64)
    return np.sort(found[found < NEVER])


class ProvenRest:
    """Proves that nothing moves any more, from two equal moments of the run's memory.

    Nothing that is measured changes for twice the longest timer of stack and world. In the second
    half of that time every timer that began before it has run out, and the memory at its two ends
    is the same but for clocks. So the run repeats this half until something timed happens.

    Args:
        world: of the episode.
        to_come: whether tasks still arrive, and blockages and outages begin, in what is watched.
    """

    def __init__(self, world: World, *, to_come: bool = False) -> None:
        self._pause = longest_pause(world)
        self._timed = timed(world, to_come=to_come)
        self._run: SteadyRun | None = None
        self._still: tuple[Array, ...] = ()  # what was measured when something changed last
        self._since = 0.0  # of then [s]
        self._half: tuple[float, int, Memory] | None = None  # time [s], tick and memory
        self._is_proven = False

    def take_run(self, run: SteadyRun) -> None:
        """Take the run that is watched; without one nothing is ever proven."""
        self._run = run

    def update(self, sensed: Sensed) -> None:
        """Take in a look at the run."""
        if self._run is None or not np.isfinite(self._run.longest_timer):
            return
        seen = (sensed.pose, sensed.velocity, sensed.human_position, sensed.furniture_pose)
        if not _are_equal(seen, self._still):
            self._still, self._since = tuple(part.copy() for part in seen), sensed.time
            self._half, self._is_proven = None, False
            return
        if self._is_proven:
            return
        timer = max(self._run.longest_timer, self._pause)
        began = self._since if self._half is None else self._half[0]
        if sensed.time - began < timer:
            return
        memory = self._run.memory()
        if self._half is not None:
            before, tick, earlier = self._half
            self._is_proven = memory.is_same_but_for_time(
                earlier, sensed.time - before, sensed.tick - tick
            )
        self._half = sensed.time, sensed.tick, memory

    def lasts_until(self, time: float) -> float:
        """Until when nothing moves [s]; inf: for good; ``time`` itself if that is not proven.

        Args:
            time: of the last look [s].
        """
        if self._run is None or not self._is_proven:
            return time
        moments = np.array([*self._timed, *self._run.planned_times()], dtype=np.float64)
        return float(moments[moments > time - 1e-6].min(initial=np.inf))


def _are_equal(some: tuple[Array, ...], others: tuple[Array, ...]) -> bool:
    return len(some) == len(others) and all(
        np.array_equal(one, other, equal_nan=True) for one, other in zip(some, others, strict=True)
    )
