"""Labels by continuation: what never resolves is a deadlock, whoever may claim what.

Nothing here uses blocked-by edges or the oracle. From the moment under question no outside
event happens any more (no new task, blockage or outage; those in force run their course,
people walk on) and the same run goes on for 600 s. Robots that then still have a goal and
have stood in one place for the last nine minutes are stuck. One of them is a *member* if
the others it is stuck with go free once it is gone; the rest are victims.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Command, Frame, Sensed
from mrta_falsify.core.world import World
from mrta_falsify.specs.motion import Standstill
from simulator_interface.simulate import Episode

CONTINUE = 600.0  # s
FREE_WITHIN = 150.0  # s in which the rest must go free once a member is gone
PLACE = 0.5  # m, a robot that stays within this of one place stands
LEFT = 1.0  # m, a robot farther from its place than this went free
SETTLED = 60.0  # s in which a deadlock may still shift before it stands for good


@dataclass(frozen=True)
class Label:
    """What became of a moment."""

    stuck: tuple[int, ...]  #: robots that never went on
    deadlocks: tuple[tuple[int, ...], ...]  #: members of each separate deadlock

    @property
    def is_deadlock(self) -> bool:
        """Whether anything never resolved."""
        return bool(self.stuck)


def label(world: World, config: StackConfig, moment: float) -> Label:
    """Label of the run of ``world`` at ``moment`` [s]."""
    still = stopped(world, moment)
    stuck = _stuck_after(still, config, moment)
    if not stuck:
        return Label((), ())
    freed = {i: _freed_without(i, still, config, moment, stuck) for i in stuck}
    return Label(tuple(sorted(stuck)), _deadlocks(stuck, freed))


def stopped(world: World, moment: float) -> World:
    """``world`` in which nothing new comes from outside after ``moment`` [s]."""
    arrivals = [task.arrival for task in world.tasks]
    assert arrivals == sorted(arrivals), "dropping later tasks must not renumber earlier ones"
    tasks = tuple(task for task in world.tasks if task.arrival <= moment)
    events = tuple(event for event in world.events if event.start <= moment)
    return dataclasses.replace(world, tasks=tasks, events=events, horizon=moment + CONTINUE)


def _stuck_after(world: World, config: StackConfig, moment: float) -> set[int]:
    episode = Episode(world, config)
    still = Standstill(len(world.robots), radius=PLACE)
    for frame in episode.frames():
        time = frame.sensed.time
        since = still.update(frame.sensed.pose, time)
        with_goal = np.isfinite(frame.intent.goal).all(axis=1)
        if time >= world.horizon:
            break
        if time >= moment and episode.all_done and not with_goal.any():
            break
    return set(np.flatnonzero(with_goal & (since <= moment + SETTLED)).tolist())


def _in_place(frame: Frame, place: Array) -> set[int]:
    away = np.hypot(*(frame.sensed.pose[:, :2] - place).T)
    return set(np.flatnonzero(away <= LEFT).tolist())


def _freed_without(
    gone: int, world: World, config: StackConfig, moment: float, stuck: set[int]
) -> set[int]:
    """Stuck robots that leave their place once ``gone`` has vanished."""
    ghost = Choice("benchmarks.oracle.labels:GhostEngine", {"robot": gone, "vanishes_at": moment})
    rest = stuck - {gone}
    freed: set[int] = set()
    place: Array | None = None
    for frame in Episode(world, dataclasses.replace(config, engine=ghost)).frames():
        time = frame.sensed.time
        if time < moment:
            continue
        if place is None:
            place = frame.sensed.pose[:, :2].copy()
        served = {i for i in rest if not np.isfinite(frame.intent.goal[i]).all()}
        freed |= (rest - _in_place(frame, place)) | served
        if freed == rest or time >= moment + FREE_WITHIN:
            break
    return freed


def _deadlocks(stuck: set[int], freed: dict[int, set[int]]) -> tuple[tuple[int, ...], ...]:
    """Members of each deadlock: those without whom all others of their group go free."""
    groups: list[set[int]] = []
    for i in sorted(stuck):
        joined = {i} | freed[i]
        for group in [group for group in groups if group & joined]:
            joined |= group
            groups.remove(group)
        groups.append(joined)
    found = []
    for group in groups:
        members = tuple(i for i in sorted(group) if freed[i] >= group - {i})
        # No single robot frees the rest: then all of them hold it together.
        found.append(members or tuple(sorted(group)))
    return tuple(found)


class GhostEngine:
    """The kinematic engine, in which one robot vanishes at a given time.

    Its body stays where it is, but nobody perceives it there: poses say it is far outside the
    map. Bodies of the kinematic engine do not hinder each other.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Which robot vanishes when."""

        robot: int = quantity(low=0)
        vanishes_at: float = quantity(low=0.0, unit="s")

    def __init__(self, options: Options) -> None:
        self._options = options
        self._engine = registry.build("engine", Choice("kinematic"))

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """As the engine's."""
        x_min, y_min = world.bounds[:2]
        self._limbo = np.array([x_min - 50.0, y_min - 50.0, 0.0])
        return self._hidden(self._engine.start(world, dt, human_position))

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """As the engine's; the ghost does not move."""
        twist = np.array(command.twist)
        if self._gone:
            twist[self._options.robot] = 0.0
        return self._hidden(self._engine.step(Command(twist=twist), human_velocity))

    def close(self) -> None:
        """Free everything."""
        self._engine.close()

    def _hidden(self, sensed: Sensed) -> Sensed:
        self._gone = sensed.time >= self._options.vanishes_at
        if not self._gone:
            return sensed
        robot = self._options.robot
        pose, velocity = np.array(sensed.pose), np.array(sensed.velocity)
        points = np.array(sensed.obstacle_points)
        pose[robot], velocity[robot], points[robot] = self._limbo, 0.0, np.inf
        return dataclasses.replace(sensed, pose=pose, velocity=velocity, obstacle_points=points)
