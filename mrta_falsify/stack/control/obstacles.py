"""What stands around each robot: things to keep clear of, and how fast it may go near them."""

from __future__ import annotations

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.stack.control.barrier import HUMAN, OBSTACLE, ROBOT

HUMAN_RADIUS = 0.25  # m, the person that `min_gap_human` is meant for
HUMAN_RANGE = 8.0  # m
ROBOT_RANGE = 8.0  # m


@njit(cache=True)
def list_things(
    points: Array,
    humans: Array,
    human_velocity: Array,
    human_radius: Array,
    position: Array,
    velocity: Array,
    known: BoolArray,
    group: IntArray,
    share: Array,
    gaps: tuple[float, float, float],
) -> tuple[Array, Array, Array, IntArray, Array, IntArray]:
    """What each robot must keep clear of by itself; T entries per robot.

    Args:
        points: ``(N, S, 2)`` obstacle points [m], inf: none.
        humans: ``(H, 2)`` [m].
        human_velocity: ``(H, 2)`` [m/s].
        human_radius: ``(H,)`` [m].
        position: ``(N, 2)`` robots as the fleet knows them [m].
        velocity: ``(N, 2)`` [m/s].
        known: ``(N,)`` robots that are there and of which the others know.
        group: ``(N,)`` robots of one group decide together and are no things to each other.
        share: ``(N, N)`` part of a demand that a robot (row) takes against one of another group.
        gaps: distance to keep from an obstacle point, a person, a robot [m].

    Returns:
        Position [m] and velocity [m/s] ``(N, T, 2)``, distance to keep, centre to centre
        ``(N, T)`` [m], kind ``(N, T)`` (-1: no entry), part of the demand that this robot
        takes ``(N, T)``, and the robot whose state enters the row: the robot itself ``(N, T)``.
    """
    n, sectors = points.shape[0], points.shape[1]
    h = humans.shape[0]
    t = sectors + h + n
    where = np.zeros((n, t, 2))
    moving = np.zeros((n, t, 2))
    gap = np.zeros((n, t))
    kind = np.full((n, t), -1, dtype=np.int64)
    part = np.ones((n, t))
    seen_from = np.empty((n, t), dtype=np.int64)
    for i in range(n):
        seen_from[i] = i
        if group[i] < 0:
            continue
        for k in range(sectors):
            if np.isfinite(points[i, k, 0]):
                where[i, k] = points[i, k]
                gap[i, k] = gaps[0]
                kind[i, k] = OBSTACLE
        for k in range(h):
            dx, dy = humans[k, 0] - position[i, 0], humans[k, 1] - position[i, 1]
            if dx * dx + dy * dy < HUMAN_RANGE * HUMAN_RANGE:
                where[i, sectors + k] = humans[k]
                moving[i, sectors + k] = human_velocity[k]
                gap[i, sectors + k] = gaps[1] + human_radius[k] - HUMAN_RADIUS
                kind[i, sectors + k] = HUMAN
        for j in range(n):
            if j == i or not known[j] or group[j] == group[i]:
                continue
            dx, dy = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            if dx * dx + dy * dy < ROBOT_RANGE * ROBOT_RANGE:
                where[i, sectors + h + j] = position[j]
                moving[i, sectors + h + j] = velocity[j]
                gap[i, sectors + h + j] = gaps[2]
                kind[i, sectors + h + j] = ROBOT
                part[i, sectors + h + j] = share[i, j]
    return where, moving, gap, kind, part, seen_from


@njit(cache=True)
def seen_by_wrong_robot(seen_from: IntArray, kind: IntArray, group: IntArray) -> IntArray:
    """Planted defect: rows of a cluster use the state of the robot whose place equals the row.

    MRTA-Sim 1.3.1: the row number, clamped to the last robot, is taken for the robot's number.
    """
    wrong = seen_from.copy()
    n, t = kind.shape
    for head in range(n):
        count = 0
        last = head
        for i in range(n):
            if group[i] == group[head] and group[i] >= 0:
                count += 1
                last = i
        first = True
        for i in range(head):
            first = first and group[i] != group[head]
        if count < 2 or not first:
            continue
        row = 0
        for i in range(n):
            if group[i] != group[head]:
                continue
            for k in range(t):
                if kind[i, k] != OBSTACLE and kind[i, k] != HUMAN:
                    continue
                place = 0
                wrong[i, k] = last
                for j in range(n):
                    if group[j] == group[head]:
                        if place == row:
                            wrong[i, k] = j
                        place += 1
                row += 1
    return wrong


@njit(cache=True)
def _along(dx: float, dy: float, ux: float, uy: float, gap: float) -> float:
    """Way along (ux, uy) until a point at offset (dx, dy) is ``gap`` away; inf: never."""
    ahead = dx * ux + dy * uy
    aside = abs(dx * uy - dy * ux)
    held = min(gap, 0.98 * np.sqrt(dx * dx + dy * dy))
    if ahead <= 0.0 or aside >= held:
        return np.inf
    return float(max(ahead - np.sqrt(held * held - aside * aside), 0.0))


@njit(cache=True)
def _human_limit(
    dx: float,
    dy: float,
    hvx: float,
    hvy: float,
    ux: float,
    uy: float,
    contact: float,
    braking: float,
    reaction: float,
) -> float:
    """Speed along (ux, uy) from which the robot is at rest before it meets the person.

    The person is taken to walk on at its speed, and may turn towards the robot: one that
    passes at right angles counts with a quarter of its speed, one that walks away with none.
    """
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-6)
    rx, ry = dx / distance, dy / distance
    gap = distance - contact
    pace = np.sqrt(hvx * hvx + hvy * hvy)
    approach = 0.0
    if pace > 0.05:
        cosine = -(hvx * rx + hvy * ry) / pace
        approach = pace * max(0.0, (cosine + 0.3) / 1.3)
    ahead = max(0.0, ux * rx + uy * ry)
    quadratic = 0.5 * ahead / braking
    linear = approach / braking + reaction * ahead
    spare = gap - reaction * approach
    if spare <= 0.0:
        # A person at rest beside or behind does not keep the robot from leaving.
        return 0.0 if approach > 0.0 or ahead > 0.17 else np.inf
    if quadratic < 1e-9:
        return spare / linear if linear > 1e-9 else np.inf
    root = np.sqrt(linear * linear + 4.0 * quadratic * spare)
    return float((root - linear) / (2.0 * quadratic))


@njit(cache=True)
def speed_limits(
    position: Array,
    velocity: Array,
    direction: Array,
    known: BoolArray,
    max_speed: Array,
    max_acceleration: Array,
    thing_position: Array,
    thing_velocity: Array,
    thing_gap: Array,
    thing_kind: IntArray,
    seen_from: IntArray,
    human_radius: Array,
    min_gap_robot: float,
    constants: tuple[float, float, float, float, float, float],
    dt: float,
) -> tuple[Array, Array, BoolArray, Array]:
    """How fast each robot may go, so that it can always stop in time.

    Barriers of second order ask for more deceleration than a robot has when it meets a wall
    at full speed; these limits keep them feasible.

    Args:
        position: ``(N, 2)`` [m].
        velocity: ``(N, 2)`` [m/s].
        direction: ``(N, 2)`` unit vectors of travel.
        known: ``(N,)`` robots that are there and of which the others know.
        max_speed: ``(N,)`` [m/s].
        max_acceleration: ``(N,)`` [m/s^2].
        thing_position: ``(N, T, 2)``, as from :func:`list_things`, like the next four.
        thing_velocity: ``(N, T, 2)``.
        thing_gap: ``(N, T)``.
        thing_kind: ``(N, T)``.
        seen_from: ``(N, T)``.
        human_radius: ``(H,)`` [m].
        min_gap_robot: [m].
        constants: body radius, human clearance, human stop [m], reaction [s], braking share,
            reverse speed [m/s].
        dt: control period [s].

    Returns:
        Most negative and largest speed ``(N,)`` along ``direction`` [m/s], who must stop at
        once for a person ``(N,)``, and the distance of the nearest obstacle point ``(N,)`` [m].
    """
    body, clearance, stop_gap, reaction, share, reverse = constants
    n, t = thing_kind.shape
    h = human_radius.shape[0]
    sectors = t - h - n
    low, high = -np.minimum(max_speed, reverse), max_speed.copy()
    halt = np.zeros(n, dtype=np.bool_)
    nearest = np.full(n, np.inf)
    for i in range(n):
        braking = share * max_acceleration[i]
        ux, uy = direction[i]
        for k in range(t):
            kind = thing_kind[i, k]
            if kind < 0 or kind == ROBOT:
                continue
            s = seen_from[i, k]
            dx = thing_position[i, k, 0] - position[s, 0]
            dy = thing_position[i, k, 1] - position[s, 1]
            if kind == OBSTACLE:
                nearest[i] = min(nearest[i], np.sqrt(dx * dx + dy * dy))
                way = _along(dx, dy, ux, uy, thing_gap[i, k])
                high[i] = min(high[i], np.sqrt(2.0 * braking * way))
                way = _along(dx, dy, -ux, -uy, thing_gap[i, k])
                low[i] = max(low[i], -np.sqrt(2.0 * braking * way))
                continue
            hvx, hvy = thing_velocity[i, k]
            contact = body + human_radius[k - sectors]
            held = contact + clearance
            delay = reaction + dt
            front = _human_limit(dx, dy, hvx, hvy, ux, uy, held, braking, delay)
            back = _human_limit(dx, dy, hvx, hvy, -ux, -uy, held, braking, delay)
            high[i] = min(high[i], front)
            low[i] = max(low[i], -back)
            distance = np.sqrt(dx * dx + dy * dy)
            closing = -(hvx * dx + hvy * dy) / max(distance, 1e-6)
            pace = np.sqrt(hvx * hvx + hvy * hvy)
            touching = distance < contact + 0.05 and pace > 0.05
            if touching or (distance < contact + stop_gap and closing > 0.05):
                halt[i] = True
        for j in range(n):
            if j == i or not known[j]:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            if dx * dx + dy * dy > ROBOT_RANGE * ROBOT_RANGE:
                continue
            other = velocity[j, 0] * ux + velocity[j, 1] * uy
            rest = other * abs(other) / (2.0 * share * max_acceleration[j])
            way = _along(dx, dy, ux, uy, min_gap_robot)
            high[i] = min(high[i], np.sqrt(2.0 * braking * max(way + rest, 0.0)))
            way = _along(dx, dy, -ux, -uy, min_gap_robot)
            low[i] = max(low[i], -np.sqrt(2.0 * braking * max(way - rest, 0.0)))
    return low, high, halt, nearest
