"""What a crowded world will cost to run, told from how much is in it before anything runs.

The law is fitted to fleets of 6 to 1,000 robots with the shipped stack and all default
specifications (docs/evaluation.md), by CPU time of all processes on an idle machine. It is no
promise: a fleet that jams costs several times as much, since copies of the run vote on who stands.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World

# a world with less of each is ordinary, and nothing is said of it
MANY_ROBOTS, MANY_PEOPLE, MANY_TASKS, MANY_PIECES = 50, 50, 200, 300

# s of CPU per simulated second
OF_TICKS = 0.01
OF_ROBOT = 6e-4  # each: its mission, view and way
OF_PAIR = 7e-6  # of robots: who is near whom
OF_MEETING = 6e-6  # of a person with a robot or another person
# s of CPU once, before or with the first ticks
OF_START = 1.0
OF_BID = 1.2e-4  # for each robot and task
OF_FIRST_WAY = 0.02  # of each robot
OF_PIECE = 2e-3  # of furniture: its shape and its mark on the costmap
PHYSICS = 2.0  # times as much on an engine with contacts


@dataclass(frozen=True, slots=True, kw_only=True)
class CrowdCost:
    """What a run will cost, roughly."""

    robots: int
    people: int
    tasks: int
    pieces: int  #: of furniture
    start_s: float  #: CPU time before the first simulated second is over [s]
    second_s: float  #: CPU time of each simulated second [s]
    horizon: float  #: simulated time that the run may last [s]

    @property
    def total_s(self) -> float:
        """CPU time of a run to the horizon [s]."""
        return self.start_s + self.second_s * self.horizon

    @property
    def is_crowd(self) -> bool:
        """Whether there is so much of anything that a user should know before the run."""
        return (
            self.robots >= MANY_ROBOTS
            or self.people >= MANY_PEOPLE
            or self.tasks >= MANY_TASKS
            or self.pieces >= MANY_PIECES
        )

    def __str__(self) -> str:
        """Write it in one sentence."""
        return (
            f"a crowd: {self.robots} robots, {self.people} people, {self.tasks} tasks, "
            f"{self.pieces} pieces of furniture; about {duration(self.start_s)} of CPU to set out "
            f"and {self.second_s:.2g} s for each simulated second, {duration(self.total_s)} to the "
            f"horizon of {self.horizon:g} s, and several times as much where robots jam"
        )


def cost_of(world: World, config: StackConfig) -> CrowdCost:
    """Estimate what a run of a world costs by how much is in it."""
    robots, people, tasks = len(world.robots), len(world.humans), len(world.tasks)
    pieces = len(world.furniture)
    second = OF_TICKS + OF_ROBOT * robots + OF_PAIR * robots**2
    second += OF_MEETING * people * (people + robots)
    factor = 1.0 if config.engine.name == "kinematic" else PHYSICS
    start = OF_START + OF_BID * robots * tasks + OF_FIRST_WAY * robots + OF_PIECE * pieces
    return CrowdCost(
        robots=robots,
        people=people,
        tasks=tasks,
        pieces=pieces,
        start_s=start,
        second_s=factor * second,
        horizon=world.horizon,
    )


def duration(seconds: float) -> str:
    """Write a time with one unit."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
