"""From commands to set points: latency, speed and acceleration limits, wheel slip.

Shared by the engines, so that both robots obey a command in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import RobotSpec
from simulator_interface.engines.bodies import Fleet

SLIP_TIME = 0.5  # s; slip changes over this time, whatever the control rate
MAX_LOSS = 0.95  # share of its speed a wheel can lose
NOW = 1e-9  # s; a sub-step's time is a product of floats


#: what a robot's drive can do, one record a robot
MOTOR = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("joins_at", np.float64),  # no command is obeyed before [s]
                ("max_speed", np.float64),  # [m/s]
                ("max_turn_rate", np.float64),  # [rad/s]
                ("speed_change", np.float64),  # at most, per sub-step [m/s]
                ("turn_change", np.float64),  # at most, per sub-step [rad/s]
                ("delay", np.int64),  # sub-steps until a command arrives
                ("holonomic", np.int64),  # 1: moves in every direction
            ],
            align=True,
        ),
    )
)


class Motors(NamedTuple):
    """The drives of all robots, with what they are about to do."""

    motor: NDArray[np.void]  #: (N,) of ``MOTOR``
    pipeline: Array  #: (D, N, 3) commands on their way, a ring
    set_point: Array  #: (N, 3) twist to be had now: forward, left [m/s], turn rate [rad/s]


class Actuation:
    """Set points of all robots; advance it once per sub-step."""

    def __init__(self, fleet: Fleet, robots: Sequence[RobotSpec], seed: int, step: float) -> None:
        """Robots at rest; ``step`` is the sub-step [s]."""
        n = len(robots)
        motor = np.zeros(n, dtype=MOTOR)
        motor["joins_at"] = fleet.joins_at
        motor["max_speed"] = fleet.max_speed
        motor["max_turn_rate"] = fleet.max_turn_rate
        motor["speed_change"] = fleet.max_acceleration * step
        motor["turn_change"] = fleet.max_turn_acceleration * step
        motor["delay"] = [round(robot.command_latency / step) for robot in robots]
        motor["holonomic"] = fleet.holonomic
        pipeline = np.zeros((int(motor["delay"].max(initial=0)) + 1, n, 3))
        self.motors = Motors(motor, pipeline, np.zeros((n, 3)))
        self.count = 0  #: sub-steps that set points were moved for; to be counted on by the engine
        self._spread = np.array([robot.wheel_slip for robot in robots])
        self._slipping = np.flatnonzero(self._spread).tolist()
        self._random = [stream(seed, f"wheel_slip/{robot.name}") for robot in robots]
        self._slip = np.zeros((n, 2))
        #: (N, 2) share of speed lost: left and right wheel, or translation and rotation
        self.loss = np.zeros((n, 2))

    def begin_tick(self, dt: float) -> None:
        """Draw the wheel slip of the next control period ``dt`` [s]."""
        keep = math.exp(-dt / SLIP_TIME)
        for i in self._slipping:
            fresh = self._random[i].normal(size=2) * self._spread[i]
            self._slip[i] = keep * self._slip[i] + math.sqrt(1.0 - keep**2) * fresh
            self.loss[i] = np.minimum(np.abs(self._slip[i]), MAX_LOSS)


@njit(cache=True)
def move_set_points(command: Array, time: float, motors: Motors, count: int) -> None:
    """Take in a command and move the set points towards the one that is due.

    Args:
        command: ``(N, 3)`` body twists that arrive now.
        time: when the sub-step begins [s]; robots that join later stand still.
        motors: their pipeline and set points are brought up to date.
        count: sub-steps before this one.
    """
    pipeline, set_point = motors.pipeline, motors.set_point
    slots = len(pipeline)
    for i in range(len(command)):
        motor = motors.motor[i]
        for k in range(3):
            pipeline[count % slots, i, k] = command[i, k]
        forward, left, turn = 0.0, 0.0, 0.0
        if time >= motor.joins_at - NOW:
            due = pipeline[(count + slots - motor.delay) % slots, i]
            forward, left, turn = due[0], due[1], due[2]
        if motor.holonomic == 0:
            left = 0.0
        speed = math.sqrt(forward * forward + left * left)
        if speed > motor.max_speed:
            forward, left = forward * motor.max_speed / speed, left * motor.max_speed / speed
        turn = min(motor.max_turn_rate, max(-motor.max_turn_rate, turn))
        df, dl = forward - set_point[i, 0], left - set_point[i, 1]
        change = math.sqrt(df * df + dl * dl)
        share = 1.0 if change <= motor.speed_change else motor.speed_change / change
        set_point[i, 0] += share * df
        set_point[i, 1] += share * dl
        dw = turn - set_point[i, 2]
        set_point[i, 2] += min(motor.turn_change, max(-motor.turn_change, dw))


@njit(cache=True)
def slipping(forward: float, turn: float, separation: float, loss: Array) -> tuple[float, float]:
    """Give the speed and turn rate left when the wheels lose shares ``loss`` ``(2,)``."""
    left = (forward - 0.5 * turn * separation) * (1.0 - loss[0])
    right = (forward + 0.5 * turn * separation) * (1.0 - loss[1])
    return 0.5 * (left + right), (right - left) / separation
