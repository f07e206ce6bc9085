"""From commands to set points: latency, speed and acceleration limits, wheel slip.

Shared by the engines, so that both robots obey a command in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import RobotSpec
from simulator_interface.engines.bodies import Fleet

SLIP_TIME = 0.5  # s; slip changes over this time, whatever the control rate
MAX_LOSS = 0.95  # share of its speed a wheel can lose


class Actuation:
    """Set points of all robots; advance it once per sub-step."""

    def __init__(self, fleet: Fleet, robots: Sequence[RobotSpec], seed: int, step: float) -> None:
        """Robots at rest; ``step`` is the sub-step [s]."""
        n = len(robots)
        self._fleet = fleet
        self._step = step
        self._delay = np.array(
            [round(robot.command_latency / step) for robot in robots], dtype=np.int64
        )
        self._pipeline = np.zeros((int(self._delay.max(initial=0)) + 1, n, 3))
        self._count = 0
        self._limits = np.stack(
            [
                fleet.max_speed,
                fleet.max_turn_rate,
                fleet.max_acceleration * step,
                fleet.max_turn_acceleration * step,
            ],
            axis=1,
        ).reshape(n, 4)
        self._spread = np.array([robot.wheel_slip for robot in robots])
        self._slipping = np.flatnonzero(self._spread).tolist()
        self._random = [stream(seed, f"wheel_slip/{robot.name}") for robot in robots]
        self._slip = np.zeros((n, 2))
        #: (N, 3) twist to be had now: forward, left [m/s], turn rate [rad/s]
        self.set_point = np.zeros((n, 3))
        #: (N, 2) share of speed lost: left and right wheel, or translation and rotation
        self.loss = np.zeros((n, 2))

    def begin_tick(self, dt: float) -> None:
        """Draw the wheel slip of the next control period ``dt`` [s]."""
        keep = math.exp(-dt / SLIP_TIME)
        for i in self._slipping:
            fresh = self._random[i].normal(size=2) * self._spread[i]
            self._slip[i] = keep * self._slip[i] + math.sqrt(1.0 - keep**2) * fresh
            self.loss[i] = np.minimum(np.abs(self._slip[i]), MAX_LOSS)

    def advance(self, command: Array, time: float) -> Array:
        """Move the set points for the sub-step that begins at ``time`` [s].

        Args:
            command: ``(N, 3)`` body twists that arrive now.
            time: robots that join later stand still.

        Returns:
            ``set_point``.
        """
        fleet = self._fleet
        _advance(
            command,
            time,
            fleet.joins_at,
            fleet.holonomic,
            self._limits,
            self._delay,
            self._pipeline,
            self._count,
            self.set_point,
        )
        self._count += 1
        return self.set_point


@njit(cache=True)
def _advance(
    command: Array,
    time: float,
    joins_at: Array,
    holonomic: IntArray,
    limits: Array,
    delay: IntArray,
    pipeline: Array,
    count: int,
    set_point: Array,
) -> None:
    """Take in ``command`` and move ``set_point`` towards the one that is due."""
    slots = len(pipeline)
    for i in range(len(command)):
        for k in range(3):
            pipeline[count % slots, i, k] = command[i, k]
        forward, left, turn = 0.0, 0.0, 0.0
        if time >= joins_at[i] - 1e-9:
            due = pipeline[(count + slots - delay[i]) % slots, i]
            forward, left, turn = due[0], due[1], due[2]
        if holonomic[i] == 0:
            left = 0.0
        speed = math.sqrt(forward * forward + left * left)
        if speed > limits[i, 0]:
            forward, left = forward * limits[i, 0] / speed, left * limits[i, 0] / speed
        turn = min(limits[i, 1], max(-limits[i, 1], turn))
        df, dl = forward - set_point[i, 0], left - set_point[i, 1]
        change = math.sqrt(df * df + dl * dl)
        share = 1.0 if change <= limits[i, 2] else limits[i, 2] / change
        set_point[i, 0] += share * df
        set_point[i, 1] += share * dl
        dw = turn - set_point[i, 2]
        set_point[i, 2] += min(limits[i, 3], max(-limits[i, 3], dw))


@njit(cache=True)
def slipping(forward: float, turn: float, separation: float, loss: Array) -> tuple[float, float]:
    """Forward speed and turn rate that are left when the wheels lose shares ``loss`` ``(2,)``."""
    left = (forward - 0.5 * turn * separation) * (1.0 - loss[0])
    right = (forward + 0.5 * turn * separation) * (1.0 - loss[1])
    return 0.5 * (left + right), (right - left) / separation
