"""The deadlock oracle on a log: frames are made of what was recorded, nothing can be asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mrta_falsify.commands.incident.legs import ARRIVED, Leg
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Command, Frame, Intent, Sensed, Tells, no_intent, nothing_sensed
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from simulator_interface.formats.fleet_log import FleetLog

DT = 0.25  # s between frames
NO_PATH = np.zeros((0, 2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Suspicion:
    """A deadlock that a log shows."""

    verdict: Verdict  #: of the oracle when it lasted longest; never a violation
    until: float  #: when it was last seen [s]


def suspicion_in(
    log: FleetLog, legs: tuple[tuple[Leg, ...], ...], world: World
) -> Suspicion | None:
    """Find the last deadlock that is suspected in a log; None: there is none.

    Args:
        log: of the fleet.
        legs: of its robots.
        world: floor, with the log's robots.
    """
    oracle = NoDeadlock(NoDeadlock.Options())
    oracle.start(world, DT)
    found: Suspicion | None = None
    for frame in frames_of_log(log, legs, world):
        oracle.update(frame)
        verdict = oracle.verdict()
        if verdict.who:
            found = Suspicion(verdict=verdict, until=frame.sensed.time)
    return found


def frames_of_log(
    log: FleetLog, legs: tuple[tuple[Leg, ...], ...], world: World
) -> Iterator[Frame]:
    """Make a frame of every 0.25 s of a log."""
    times = np.arange(0.0, log.duration + DT, DT)
    poses = np.stack([robot.at(times) for robot in log.robots], axis=1)  # (T, N, 3)
    tracker = BlockedByTracker(world, DT)
    ways = [_Way(rows, robot.paths) for rows, robot in zip(legs, log.robots, strict=True)]
    tells = Tells(deliveries=False, goals=True, paths=all(robot.paths for robot in log.robots))
    for tick, time in enumerate(times.tolist()):
        for way, pose in zip(ways, poses[tick], strict=True):
            way.advance(time, pose[:2])
        served = np.array([way.served for way in ways], dtype=np.int64)
        sensed = _sensed(tick, time, poses[tick], poses[max(tick - 1, 0)])
        intent = _intent(ways)
        yield Frame(
            sensed=sensed,
            command=Command(twist=np.zeros((len(ways), 3))),
            intent=intent,
            events=(),
            served=served,
            blocked_by=tracker.update(sensed, intent, served, tells),
            tells=tells,
        )


class _Way:
    """Where one robot is going, as time passes."""

    def __init__(self, legs: tuple[Leg, ...], paths: tuple[tuple[float, Array], ...]) -> None:
        self._legs, self._paths = list(legs), list(paths)
        self.goal: Array | None = None
        self.path: Array = NO_PATH
        self.served = 0  #: goals reached

    def advance(self, time: float, place: Array) -> None:
        while self._legs and self._legs[0].begin <= time:
            self.goal = self._legs.pop(0).goal
        while self._paths and self._paths[0][0] <= time:
            self.path = self._paths.pop(0)[1]
        if self.goal is not None and np.hypot(*(self.goal - place)) <= ARRIVED:
            self.goal, self.path, self.served = None, NO_PATH, self.served + 1


def _intent(ways: list[_Way]) -> Intent:
    goal = np.array([(np.nan, np.nan) if way.goal is None else way.goal for way in ways])
    return dataclasses.replace(
        no_intent(len(ways)),
        goal=goal,
        tasks_left=np.isfinite(goal[:, 0]).astype(np.int64),
        path=tuple(way.path for way in ways),
    )


def _sensed(tick: int, time: float, pose: Array, before: Array) -> Sensed:
    robots = len(pose)
    moved = (pose - before) / DT
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    forward = cos * moved[:, 0] + sin * moved[:, 1]
    left = cos * moved[:, 1] - sin * moved[:, 0]
    return dataclasses.replace(
        nothing_sensed(robots),
        tick=tick,
        time=time,
        pose=pose,
        velocity=np.stack([forward, left, moved[:, 2]], axis=-1),
    )
