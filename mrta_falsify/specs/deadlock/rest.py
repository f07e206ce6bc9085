"""Will anything move any more? When a continuation has shown enough and may end."""

from __future__ import annotations

from collections import deque

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame

ALL_REST_FOR = 30.0  # s without any motion in the building: three times our stack's longest wait
ROBOTS_REST_FOR = 60.0  # s without any robot's motion, while people walk
SAME_POSE = 1e-3  # m, rad or m/s; smaller changes are no motion
LEG = 10.0  # s; a robot that moves in a leg farther than in the one before drifts off ...
DRIFT = 1e-5  # m, rad ... if it is more than this: less may be rounding or jitter
CREEPING_SPEED = 0.1  # m/s; a person who moves, but no faster than this ...
CREEPING_FOR = 5.0  # s ... for so long, is squeezing past something


class LastingRest:
    """Tells lasting rest from a pause in a run.

    Standing is not enough. Robots in an unstable balance first creep off it by micrometres, each
    leg farther than the last; a person pressed against robots takes minutes to slip past them.
    """

    def __init__(self) -> None:
        self._pose: Array | None = None
        self._robots_since = 0.0  # s
        self._crept = 0.0  # s; last time a person squeezed past something
        self._walked = 0.0  # s; last time a person moved
        self._uncrept: Array | None = None  # (H,) last time each stood or walked [s]
        self._legs: deque[Array] = deque(maxlen=3)  # poses LEG apart, since robots rest
        self._leg_began = 0.0  # s

    def update(self, frame: Frame) -> bool:
        """Take in a tick; whether the building, or at least every robot, has come to rest."""
        pose, time = frame.sensed.pose, frame.sensed.time
        if self._pose is None or np.abs(pose - self._pose).max() > SAME_POSE:
            self._pose, self._robots_since = pose.copy(), time
            self._legs.clear()
        if not self._legs or time >= self._leg_began + LEG:
            self._legs.append(pose.copy())
            self._leg_began = time
        self._watch_people(frame.sensed.human_velocity, time)
        rests = time - max(self._robots_since, self._walked) >= ALL_REST_FOR
        rests = rests or time - max(self._robots_since, self._crept) >= ROBOTS_REST_FOR
        return rests and not self._drifts()

    def _watch_people(self, velocity: Array, time: float) -> None:
        speed = np.hypot(*velocity.T)
        moves = speed > SAME_POSE
        if moves.any():
            self._walked = time
        if self._uncrept is None:
            self._uncrept = np.full(len(speed), time)
        self._uncrept[~(moves & (speed < CREEPING_SPEED))] = time
        if (time - self._uncrept > CREEPING_FOR).any():
            self._crept = time

    def _drifts(self) -> bool:
        """Whether a robot moved farther in the last leg than in the one before."""
        if len(self._legs) < 3:
            return False
        first, second, third = self._legs
        before, lately = np.abs(second - first), np.abs(third - second)
        return bool((lately > np.maximum(2.0 * before, DRIFT)).any())
