"""How inputs move a robot: what the barrier controllers need to know about a base.

A robot's position obeys ``p'' = effect @ input``; that is all a barrier of second order asks.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.core.renamed import renamed_attribute


class Motion(NamedTuple):
    """The robots' motion now, and what their inputs do to it."""

    velocity: Array  #: (N, 2) [m/s], map frame
    direction: Array  #: (N, 2) unit vector of travel, map frame; speed limits apply along it
    speed: Array  #: (N,) along ``direction`` [m/s]
    effect: Array  #: (N, 2, 2) acceleration of the position per input, map frame
    limit: Array  #: (N, 2) largest absolute inputs
    drives_along: bool  #: the first input is the acceleration along ``direction``


class NominalInput(NamedTuple):
    """What the robots would do if nothing stood in their way."""

    target: Array  #: (N, 2) point to drive to [m], nan: brake
    speed: Array  #: (N,) not to be exceeded [m/s]
    reverse: BoolArray  #: (N,) drive backwards to the target
    turn_first: Array  #: (N,) heading error above which it turns on the spot [rad]


class UnicycleGains(NamedTuple):
    """Gains of the unicycle's nominal law."""

    k_x: float  #: [1/s]
    k_v: float  #: [1/s]
    k_omega: float  #: [1/s]
    stop_distance: float  #: [m]


@runtime_checkable
class Dynamics(Protocol):
    """A kind of base: inputs ``(N, 2)`` in, twists out."""

    def linearise(self, view: ControlView) -> Motion:
        """Describe the motion of all robots at this tick."""

    def reference(self, view: ControlView, nominal: NominalInput) -> Array:
        """Compute inputs ``(N, 2)`` that pursue ``nominal``, within the limits."""

    def twist(self, view: ControlView, inputs: Array, low: Array, high: Array) -> Array:
        """Compute body twists ``(N, 3)`` after one period of ``inputs``.

        ``low`` and ``high`` ``(N,)`` [m/s] bound the speed along ``Motion.direction``; a
        speed beyond them is brought back at the acceleration limit.
        """


class Unicycle:
    """State x, y, yaw, v; inputs acceleration [m/s^2] and turn rate [rad/s].

    The nominal law is MRTA-Sim's: speed k_x times the distance to the look-ahead point,
    acceleration k_v times the missing speed, turn rate k_omega times the heading error.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Gains of the nominal law."""

        k_x: float = quantity(above=0.0, unit="1/s", default=1.5)
        k_v: float = quantity(above=0.0, unit="1/s", default=3.0)
        k_omega: float = quantity(above=0.0, unit="1/s", default=1.5)
        stop_distance: float = quantity(low=0.0, unit="m", default=0.1)

    def __init__(self, options: Options) -> None:
        self._gains = UnicycleGains(
            options.k_x, options.k_v, options.k_omega, options.stop_distance
        )

    def linearise(self, view: ControlView) -> Motion:
        """See :class:`Dynamics`."""
        n = len(view.pose)
        velocity, direction, limit = np.empty((3, n, 2))
        motion = Motion(
            velocity=velocity,
            direction=direction,
            speed=np.empty(n),
            effect=np.empty((n, 2, 2)),
            limit=limit,
            drives_along=True,
        )
        _fill_unicycle_motion(
            (view.pose, view.velocity, view.max_acceleration, view.max_turn_rate),
            velocity,
            direction,
            limit,
            motion.speed,
            motion.effect,
        )
        return motion

    def reference(self, view: ControlView, nominal: NominalInput) -> Array:
        """See :class:`Dynamics`."""
        inputs = np.zeros((len(view.pose), 2))
        _fill_unicycle_reference(
            (view.pose, view.velocity, view.max_acceleration, view.max_turn_rate),
            tuple(nominal),
            view.dt,
            tuple(self._gains),
            inputs,
        )
        return inputs

    def twist(self, view: ControlView, inputs: Array, low: Array, high: Array) -> Array:
        """See :class:`Dynamics`."""
        after = np.zeros((len(view.pose), 3))
        _fill_unicycle_twist(
            view.velocity,
            inputs,
            (low, high),
            view.max_speed,
            view.max_acceleration,
            view.max_turn_rate,
            view.dt,
            after,
        )
        return after


class Holonomic:
    """State x, y, yaw and both velocities; inputs are the accelerations in the map frame.

    The base turns slowly towards its direction of travel; the barriers do not use that.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Gains of the nominal law."""

        k_x: float = quantity(above=0.0, unit="1/s", default=1.5)
        k_v: float = quantity(above=0.0, unit="1/s", default=3.0)
        k_omega: float = quantity(low=0.0, unit="1/s", default=0.5)
        stop_distance: float = quantity(low=0.0, unit="m", default=0.1)

    SLOW: ClassVar[float] = 0.05  # m/s, below which the velocity has no meaningful direction

    def __init__(self, options: Options) -> None:
        self._options = options

    def linearise(self, view: ControlView) -> Motion:
        """See :class:`Dynamics`."""
        velocity = _to_map(view.pose[:, 2], view.velocity)
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        offset = view.target - view.pose[:, :2]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        heading = np.column_stack((np.cos(view.pose[:, 2]), np.sin(view.pose[:, 2])))
        usable = np.isfinite(distance) & (distance > 1e-9)
        towards = np.where(
            usable[:, None], offset / np.where(usable, distance, 1.0)[:, None], heading
        )
        moving = speed > self.SLOW
        direction = np.where(
            moving[:, None], velocity / np.where(moving, speed, 1.0)[:, None], towards
        )
        limit = np.repeat(view.max_acceleration[:, None] / np.sqrt(2.0), 2, axis=1)
        effect = np.broadcast_to(np.eye(2), (len(speed), 2, 2)).copy()
        return Motion(
            velocity=velocity,
            direction=np.ascontiguousarray(direction),
            speed=np.einsum("ij,ij->i", velocity, direction),
            effect=effect,
            limit=limit,
            drives_along=False,
        )

    def reference(self, view: ControlView, nominal: NominalInput) -> Array:
        """See :class:`Dynamics`."""
        gains = self._options
        velocity = _to_map(view.pose[:, 2], view.velocity)
        offset = nominal.target - view.pose[:, :2]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        stop = ~np.isfinite(distance) | (distance < gains.stop_distance)
        speed = np.minimum(gains.k_x * distance, nominal.speed)
        with np.errstate(invalid="ignore", divide="ignore"):
            requested = offset / distance[:, None] * speed[:, None]
        requested = np.where(stop[:, None], 0.0, requested)
        # At rest no later than the next tick, if the limit allows it.
        gain = np.where(stop, 1.0 / view.dt, gains.k_v)[:, None]
        limit = view.max_acceleration[:, None] / np.sqrt(2.0)
        return np.asarray(np.clip(gain * (requested - velocity), -limit, limit))

    def twist(self, view: ControlView, inputs: Array, low: Array, high: Array) -> Array:
        """See :class:`Dynamics`."""
        yaw = view.pose[:, 2]
        velocity = _to_map(yaw, view.velocity)
        after = velocity + inputs * view.dt
        speed = np.hypot(after[:, 0], after[:, 1])
        slowest = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 0.0)
        slowest = np.maximum(slowest - view.max_acceleration * view.dt, 0.0)
        ceiling = np.minimum(np.maximum(high, slowest), view.max_speed)
        scale = np.where(speed > ceiling, ceiling / np.where(speed > 0, speed, 1.0), 1.0)
        after = after * scale[:, None]
        course = np.arctan2(after[:, 1], after[:, 0])
        error = (course - yaw + np.pi) % (2 * np.pi) - np.pi
        turn = np.where(np.hypot(after[:, 0], after[:, 1]) > self.SLOW, error, 0.0)
        turn = np.clip(self._options.k_omega * turn, -view.max_turn_rate, view.max_turn_rate)
        cos, sin = np.cos(yaw), np.sin(yaw)
        forward = cos * after[:, 0] + sin * after[:, 1]
        left = -sin * after[:, 0] + cos * after[:, 1]
        return np.column_stack((forward, left, turn))


def _to_map(yaw: Array, twist: Array) -> Array:
    """Turn body twists ``(N, 3)`` to velocities ``(N, 2)`` in the map frame."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack(
        (cos * twist[:, 0] - sin * twist[:, 1], sin * twist[:, 0] + cos * twist[:, 1])
    )


@njit(cache=True)
def _fill_unicycle_motion(
    sensed: tuple[Array, Array, Array, Array],
    velocity: Array,
    direction: Array,
    limit: Array,
    speed: Array,
    effect: Array,
) -> None:
    """Fill the fields of a :class:`Motion` from poses, twists and limits."""
    pose, twist, max_acceleration, max_turn_rate = sensed
    for i in range(pose.shape[0]):
        cos, sin, v = np.cos(pose[i, 2]), np.sin(pose[i, 2]), twist[i, 0]
        speed[i] = v
        limit[i, 0], limit[i, 1] = max_acceleration[i], max_turn_rate[i]
        direction[i, 0], direction[i, 1] = cos, sin
        velocity[i, 0], velocity[i, 1] = v * cos, v * sin
        effect[i, 0, 0], effect[i, 1, 0] = cos, sin
        effect[i, 0, 1], effect[i, 1, 1] = -v * sin, v * cos


@njit(cache=True)
def _fill_unicycle_reference(
    sensed: tuple[Array, Array, Array, Array],
    requested: tuple[Any, ...],
    dt: float,
    law: tuple[Any, ...],
    inputs: Array,
) -> None:
    """Fill nominal inputs ``(N, 2)``, 0 so far; who brakes stops within a tick if it can.

    Args:
        sensed: poses, twists and limits, as for the motion.
        requested: fields of :class:`NominalInput`.
        dt: control period [s].
        law: fields of :class:`UnicycleGains`.
        inputs: filled.
    """
    pose, twist, max_acceleration, max_turn_rate = sensed
    nominal, gains = NominalInput(*requested), UnicycleGains(*law)
    for i in range(pose.shape[0]):
        v = twist[i, 0]
        limit, turn_limit = max_acceleration[i], max_turn_rate[i]
        brake = min(limit, max(-limit, -v / dt))
        inputs[i, 0] = brake
        dx, dy = nominal.target[i, 0] - pose[i, 0], nominal.target[i, 1] - pose[i, 1]
        distance = np.sqrt(dx * dx + dy * dy)
        if not distance >= gains.stop_distance:  # also when the target is nan
            continue
        heading = np.arctan2(dy, dx)
        if nominal.reverse[i]:
            heading += np.pi
        error = (heading - pose[i, 2] + np.pi) % (2.0 * np.pi) - np.pi
        inputs[i, 1] = min(turn_limit, max(-turn_limit, gains.k_omega * error))
        if abs(error) > nominal.turn_first[i]:
            continue
        speed = min(gains.k_x * distance * np.cos(error), nominal.speed[i])
        speed = max(speed, 0.0)
        if nominal.reverse[i]:
            speed = -speed
        inputs[i, 0] = min(limit, max(-limit, gains.k_v * (speed - v)))


@njit(cache=True)
def _fill_unicycle_twist(
    twist: Array,
    inputs: Array,
    speeds: tuple[Array, Array],
    max_speed: Array,
    max_acceleration: Array,
    max_turn_rate: Array,
    dt: float,
    after: Array,
) -> None:
    """Fill the twist ``(N, 3)``, 0 so far, one period later: within ``speeds`` and limits."""
    low, high = speeds
    for i in range(twist.shape[0]):
        v, step = twist[i, 0], max_acceleration[i] * dt
        requested = v + min(step, max(-step, inputs[i, 0] * dt))
        if requested > high[i]:
            requested = max(high[i], v - step)
        if requested < low[i]:
            requested = min(low[i], v + step)
        after[i, 0] = min(max_speed[i], max(-max_speed[i], requested))
        after[i, 2] = min(max_turn_rate[i], max(-max_turn_rate[i], inputs[i, 1]))


def __getattr__(name: str) -> Any:
    return renamed_attribute(sys.modules[__name__], name, {"Wish": "NominalInput"})
