"""How fast each robot may go, so that it can always stop in time.

Barriers of second order ask for more deceleration than a robot has when it meets a wall at
full speed; these limits keep them feasible.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
from mrta_falsify.stack.control.barrier import Movers
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.obstacles import ROBOT_RANGE, Clearances, Things, is_in_sight

#: of the present distance: a robot inside a gap may come no nearer, but may leave sideways
HELD_SHARE = 0.98
NEAREST = 1e-6  # m, distances below count as this: a direction is needed
WALKING = 0.05  # m/s, slower people stand
#: cosine; who walks past or away may turn, and counts with 0.3 / 1.3, a quarter of its speed
TURNING = 0.3
BESIDE = 0.17  # cosine of 80 degrees: a person farther round is beside the robot
TOUCH = 0.05  # m, from nearer people, and from those who walk, a robot creeps away
CREEP = 0.04  # m/s, slower than WALKING: who touches the robot touches one that stands
NO_BRAKING = 1e-9  # m per (m/s)^2, less way to brake is none


class SpeedMargins(NamedTuple):
    """What keeps robots able to stop."""

    body_radius: float  #: [m]
    human_clearance: float  #: a robot is at rest before this gap to a person [m]
    human_stop: float  #: it stops at once if a person comes nearer than this [m]
    reaction_time: float  #: beyond one period [s]
    braking_share: float  #: of the acceleration limit
    reverse_speed: float  #: [m/s]


class SpeedRange(NamedTuple):
    """Speeds ``(N,)`` allowed along the direction of travel, and how near things are."""

    low: Array  #: most negative [m/s]
    high: Array  #: largest [m/s]
    halt: BoolArray  #: must stop at once for a person
    nearest: Array  #: distance of the nearest obstacle point or person's body [m], inf: none


class _Offset(NamedTuple):
    dx: float  #: of a thing from the robot [m]
    dy: float
    vx: float  #: of the thing [m/s]
    vy: float


def margins_of(options: CbfOptions) -> SpeedMargins:
    """Take the margins from a controller's options."""
    return SpeedMargins(
        body_radius=options.body_radius,
        human_clearance=options.human_clearance,
        human_stop=options.human_stop,
        reaction_time=options.reaction_time,
        braking_share=options.braking_share,
        reverse_speed=options.reverse_speed,
    )


@njit(cache=True)
def _along(dx: float, dy: float, ux: float, uy: float, gap: float) -> float:
    """Measure the way along (ux, uy) until a point at (dx, dy) is ``gap`` away; inf: never."""
    ahead = dx * ux + dy * uy
    aside = abs(dx * uy - dy * ux)
    held = min(gap, HELD_SHARE * np.sqrt(dx * dx + dy * dy))
    if ahead <= 0.0 or aside >= held:
        return np.inf
    return float(max(ahead - np.sqrt(held * held - aside * aside), 0.0))


@njit(cache=True)
def _human_limit(
    person: _Offset,
    ux: float,
    uy: float,
    contact: float,
    clearance: float,
    braking: float,
    reaction: float,
) -> float:
    """Find the speed along (ux, uy) from which the robot stops before it meets the person.

    The person is taken to walk on at its speed, and may turn towards the robot. The robot is at
    rest at a gap of ``clearance`` beyond ``contact``; inside it, it may leave.
    """
    dx, dy, hvx, hvy = person
    distance = max(np.sqrt(dx * dx + dy * dy), NEAREST)
    rx, ry = dx / distance, dy / distance
    gap = distance - contact
    pace = np.sqrt(hvx * hvx + hvy * hvy)
    approach = 0.0
    if pace > WALKING:
        cosine = -(hvx * rx + hvy * ry) / pace
        approach = pace * (max(0.0, cosine) + TURNING) / (1.0 + TURNING)
    ahead = max(0.0, ux * rx + uy * ry)
    quadratic = 0.5 * ahead / braking
    linear = approach / braking + reaction * ahead
    spare = gap - clearance - reaction * approach
    if spare <= 0.0:
        # A person beside or behind does not keep the robot from leaving.
        if ahead > BESIDE:
            return 0.0
        return CREEP if approach > 0.0 or gap < TOUCH else np.inf
    if quadratic < NO_BRAKING:
        return spare / linear if linear > NO_BRAKING else np.inf
    root = np.sqrt(linear * linear + 4.0 * quadratic * spare)
    return float((root - linear) / (2.0 * quadratic))


@njit(cache=True)
def _must_halt(person: _Offset, contact: float, stop_gap: float) -> bool:
    """Whether a person comes towards the robot from near by."""
    dx, dy, hvx, hvy = person
    distance = np.sqrt(dx * dx + dy * dy)
    closing = -(hvx * dx + hvy * dy) / max(distance, NEAREST)
    return bool(distance < contact + stop_gap and closing > WALKING)


@njit(cache=True)
def _fill_limits_by_robots(
    i: int, movers: Movers, limits: SpeedRange, min_gap: float, share: float, near: Neighbours
) -> None:
    """Lower the limits of robot ``i`` by the ways that it and the others brake."""
    pose, velocity = movers.pose, movers.velocity
    ux, uy = movers.direction[i, 0], movers.direction[i, 1]
    braking = share * movers.max_acceleration[i]
    low, high = limits.low[i], limits.high[i]
    for m in range(near.first[i], near.first[i + 1]):
        j = near.number[m]
        dx, dy = pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1]
        if not movers.known[j] or dx * dx + dy * dy > ROBOT_RANGE * ROBOT_RANGE:
            continue
        other = velocity[j, 0] * ux + velocity[j, 1] * uy
        rest = other * abs(other) / (2.0 * share * movers.max_acceleration[j])
        way = _along(dx, dy, ux, uy, min_gap)
        high = min(high, np.sqrt(2.0 * braking * max(way + rest, 0.0)))
        way = _along(dx, dy, -ux, -uy, min_gap)
        low = max(low, -np.sqrt(2.0 * braking * max(way - rest, 0.0)))
    limits.low[i], limits.high[i] = low, high


@njit(cache=True)
def speed_limits(
    movers: Movers, things: Things, clearances: Clearances, margins: SpeedMargins, dt: float
) -> SpeedRange:
    """Find how fast each robot may go.

    Args:
        movers: all robots.
        things: what they keep clear of.
        clearances: by how much.
        margins: what keeps them able to stop.
        dt: control period [s].
    """
    point, people, seen_from, pose = things.point, things.people, things.seen_from, movers.pose
    n, sectors = point.shape[0], point.shape[1]
    limits = SpeedRange(
        -np.minimum(movers.max_speed, margins.reverse_speed),
        movers.max_speed.copy(),
        np.zeros(n, dtype=np.bool_),
        np.full(n, np.inf),
    )
    delay, clear = margins.reaction_time + dt, margins.human_clearance
    for i in range(n):
        braking = margins.braking_share * movers.max_acceleration[i]
        ux, uy = movers.direction[i, 0], movers.direction[i, 1]
        low, high, nearest = limits.low[i], limits.high[i], np.inf
        for k in range(sectors):
            if movers.group[i] < 0 or not np.isfinite(point[i, k, 0]):
                continue
            s = seen_from[i, k] if len(seen_from) else i
            dx, dy = point[i, k, 0] - pose[s, 0], point[i, k, 1] - pose[s, 1]
            nearest = min(nearest, np.sqrt(dx * dx + dy * dy))
            front = _along(dx, dy, ux, uy, clearances.obstacle)
            back = _along(dx, dy, -ux, -uy, clearances.obstacle)
            high = min(high, np.sqrt(2.0 * braking * front))
            low = max(low, -np.sqrt(2.0 * braking * back))
        for k in range(people.radius.shape[0]):
            if movers.group[i] < 0 or not is_in_sight(people.position, i, pose, k):
                continue
            s = seen_from[i, sectors + k] if len(seen_from) else i
            dx, dy = people.position[k, 0] - pose[s, 0], people.position[k, 1] - pose[s, 1]
            person = _Offset(dx, dy, people.velocity[k, 0], people.velocity[k, 1])
            contact = margins.body_radius + people.radius[k]
            nearest = min(nearest, np.sqrt(dx * dx + dy * dy) - people.radius[k])
            front = _human_limit(person, ux, uy, contact, clear, braking, delay)
            back = _human_limit(person, -ux, -uy, contact, clear, braking, delay)
            high, low = min(high, front), max(low, -back)
            if _must_halt(person, contact, margins.human_stop):
                limits.halt[i] = True
        limits.low[i], limits.high[i], limits.nearest[i] = low, high, nearest
        _fill_limits_by_robots(
            i, movers, limits, clearances.robot, margins.braking_share, things.near
        )
    return limits
