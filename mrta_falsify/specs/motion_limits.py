"""Robots keep to the speed, acceleration and turn rate that the world gives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.halts import SHOVED_FOR
from mrta_falsify.specs.running_min import RunningMin

WINDOW = 0.5  # s over which motion is averaged; what a solver adds for a tick or two averages out
LIMITS = ("speed", "acceleration", "turn_rate")
UNITS = ("m/s", "m/s^2", "rad/s")
NEVER = -1e9  # s; before any episode


class KinematicLimits:
    """No robot is faster, accelerates harder or turns faster than its world says.

    Only poses count: displacements of ticks, averaged over half a second. A robot that was
    touched within this time, or the half second before, is not judged, since it may have been
    pushed. Of a robot whose wheels slip only the speed is judged: each wheel that finds its grip
    again accelerates and turns it. Robustness: the tolerance minus the largest excess, as a share
    of the limit.
    """

    profile = SpecProfile(
        meaning="a robot moved faster than it can", scale=0.1, tie=3, layer="controller"
    )

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What an engine may add."""

        #: Share of the limit. Under random full commands Bullet's holonomic base exceeds its
        #: acceleration by 6.4 % while it turns, wheeled robots exceed any limit by 0.5 %.
        tolerance: float = quantity(low=0.0, high=1.0, default=0.1)

    def __init__(self, options: Options) -> None:
        self._tolerance = options.tolerance

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._names = tuple(robot.name for robot in world.robots)
        self._limit = np.array(
            [[r.max_speed, r.max_acceleration, r.max_turn_rate] for r in world.robots]
        ).reshape(-1, 3)
        slips = np.array([r.wheel_slip > 0.0 for r in world.robots], dtype=np.bool_)
        self._limit[slips, 1:] = np.inf
        ticks = max(1, round(WINDOW / dt))
        twists = np.zeros((ticks + 1, len(world.robots), 3))
        self._ring = _Ring(twists, self._limit, dt)
        self._pose = np.zeros((len(world.robots), 3))
        self._touched = np.full(len(world.robots), NEVER)
        self._seen = 0  #: ticks
        self._share = np.zeros((len(world.robots), 3))
        self._least = RunningMin("kinematic_limits", self._tolerance)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed, share = frame.sensed, self._share
        pose, before = np.ascontiguousarray(sensed.pose, dtype=np.float64), self._pose
        ring, contact, touched = self._ring, sensed.contact, self._touched
        worst = _take_in(pose, before, contact, sensed.time, ring, self._seen, touched, share)
        self._pose = pose
        self._seen += 1
        if worst < 0:
            return
        robot, kind = divmod(worst, len(LIMITS))
        margin = self._tolerance - max(0.0, float(share[robot, kind]) - 1.0)
        if margin >= self._least.margin:
            return
        over = (self._tolerance - (share - 1.0) < 0.0).any(axis=1)
        who = tuple(self._names[i] for i in np.flatnonzero(over))
        limit = float(self._limit[robot, kind])
        evidence = {
            "robot": self._names[robot],
            "limit": LIMITS[kind],
            "unit": UNITS[kind],
            "allowed": limit,
            "measured": limit * float(share[robot, kind]),
            "time": sensed.time,
            "x": float(pose[robot, 0]),
            "y": float(pose[robot, 1]),
        }
        self._least.note(margin, sensed.time, who, evidence)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return self._least.verdict()


class _Ring(NamedTuple):
    """The last twists of all robots, and what they are judged by."""

    twists: Array  #: (K + 1, N, 3) between ticks, body frame
    limit: Array  #: (N, 3) speed [m/s], acceleration [m/s^2], turn rate [rad/s]
    dt: float  #: control period [s]


@njit(cache=True)
def _take_in(
    pose: Array,
    before: Array,
    contact: BoolArray,
    time: float,
    ring: _Ring,
    last: int,
    touched: Array,
    share: Array,
) -> int:
    """Take in a tick: twists, touches, and what the robots use of their limits.

    Args:
        pose: ``(N, 3)``.
        before: ``(N, 3)`` of the tick before.
        contact: ``(N, 3)``.
        time: [s].
        ring: gets the twists of this tick.
        last: number of the twist of this tick, counted from 1.
        touched: ``(N,)`` last time each was touched [s]; brought up to date.
        share: ``(N, 3)`` receives the shares, 0 of robots that are not judged.

    Returns:
        The largest of ``share``, flat; -1: nobody is judged.
    """
    if last:
        _fill_twists(pose, before, ring.dt, ring.twists[last % len(ring.twists)])
    is_full = _fill_shares(ring.twists, last, ring.dt, ring.limit, share)
    is_any = False
    for i in range(len(touched)):
        if contact[i, 0] or contact[i, 1] or contact[i, 2]:
            touched[i] = time
        if time - touched[i] > WINDOW + SHOVED_FOR:
            is_any = True
        else:
            share[i] = 0.0
    return int(share.argmax()) if is_full and is_any else -1


@njit(cache=True)
def _fill_twists(pose: Array, before: Array, dt: float, twist: Array) -> None:
    """Write the mean twist ``(N, 3)`` between two ticks, in the body frame halfway."""
    for i in range(len(pose)):
        turn = (pose[i, 2] - before[i, 2] + np.pi) % (2.0 * np.pi) - np.pi
        yaw = before[i, 2] + 0.5 * turn
        dx, dy = pose[i, 0] - before[i, 0], pose[i, 1] - before[i, 1]
        twist[i, 0] = (np.cos(yaw) * dx + np.sin(yaw) * dy) / dt
        twist[i, 1] = (np.cos(yaw) * dy - np.sin(yaw) * dx) / dt
        twist[i, 2] = turn / dt


@njit(cache=True)
def _fill_shares(twists: Array, last: int, dt: float, limit: Array, share: Array) -> bool:
    """Write what the robots use of their limits ``(N, 3)``, averaged over the ring.

    Args:
        twists: ``(K + 1, N, 3)``, a ring.
        last: number of the twist written last, counted from 1.
        dt: control period [s].
        limit: ``(N, 3)`` speed [m/s], acceleration [m/s^2], turn rate [rad/s].
        share: ``(N, 3)``, 1: all of the limit.

    Returns:
        Whether the ring is full.
    """
    slots = len(twists)
    ticks = slots - 1
    if last < slots:
        return False
    now, first = last % slots, (last + 1) % slots
    for i in range(len(limit)):
        forward, left, turn = 0.0, 0.0, 0.0
        for k in range(slots):
            if k != first:
                forward += twists[k, i, 0] / ticks
                left += twists[k, i, 1] / ticks
                turn += twists[k, i, 2] / ticks
        df = twists[now, i, 0] - twists[first, i, 0]
        dl = twists[now, i, 1] - twists[first, i, 1]
        share[i, 0] = np.hypot(forward, left) / limit[i, 0]
        share[i, 1] = np.hypot(df, dl) / (ticks * dt) / limit[i, 1]
        share[i, 2] = abs(turn) / limit[i, 2]
    return True
