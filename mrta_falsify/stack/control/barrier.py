"""Barrier rows: what each robot's inputs must obey to keep clear of things and of each other.

For a robot at p and a thing at o with relative velocity w, offset d = p - o and
h = |d|^2 - gap^2, a control barrier of second order asks h'' + (a + b) h' + a b h >= 0 with
h' = 2 d.w and h'' = 2 |w|^2 + 2 d.p''. Divided by 2 |d| that is a bound on the relative
acceleration along the line of centres [m/s^2]: rows are normalised by distance, never by
their own length, so a row that loses its grip (a unicycle at rest beside a wall) fades out
instead of blowing up.

Reference: Xiao & Belta, "High-order control barrier functions", IEEE TAC 2022.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.obstacles import (
    HUMAN_RADIUS,
    ROBOT_RANGE,
    Clearances,
    Things,
    is_in_sight,
)

OBSTACLE, HUMAN, ROBOT = 0, 1, 2  #: kinds of things
GRIP = 0.1  # m/s^2, rows that all inputs together move by less are left out: nothing to gain
EFFORT = 0.98  # no row asks for more than this share of what the inputs can give
NEAREST = 1e-6  # m, distances below count as this: a direction is needed
ROUNDING = 1e-6  # m
BROKEN = 1e-9  # m/s^2, by how much a row must be broken to count: rounding is less

BODY_MARGIN = 0.01  # m, beyond the body, the least gap to an obstacle that is asked for
PAIR_MARGIN = 0.04  # m, beyond two bodies, the least gap to a robot that is asked for
OBSTACLE_SHARE = 0.95  # of the distance: inside its gap a robot may drive along a wall
OBSTACLE_COUPLING = 0.25  # obstacle rows take a quarter of the slack that the others take


class Movers(NamedTuple):
    """All robots, as rows and speed limits see them."""

    pose: Array  #: (N, 3) as the fleet knows it
    velocity: Array  #: (N, 2) [m/s], map frame
    direction: Array  #: (N, 2) unit vectors of travel
    speed: Array  #: (N,) along ``direction`` [m/s]
    effect: Array  #: (N, 2, 2) acceleration per input
    limit: Array  #: (N, 2) largest absolute inputs
    max_speed: Array  #: (N,) [m/s]
    max_acceleration: Array  #: (N,) [m/s^2]
    known: BoolArray  #: (N,) robots that are there and of which the others know
    group: IntArray  #: (N,) robots of equal number >= 0 decide together; < 0: no rows at all


class Rows(NamedTuple):
    """Linear constraints on the inputs; those that no input could violate are left out."""

    own: Array  #: (N, T, 2) coefficients of rows that concern one robot
    own_bound: Array  #: (N, T) row @ input + coupling * slack >= bound [m/s^2]
    own_coupling: Array  #: (N, T)
    own_count: IntArray  #: (N,) rows in use
    pair: IntArray  #: (P, 2) robot numbers of rows that concern two
    pair_row: Array  #: (P, 4) coefficients of the first and of the second robot's inputs
    pair_bound: Array  #: (P,)
    pair_count: IntArray  #: (1,) rows in use
    component: IntArray  #: (N,) smallest number of the robots coupled by rows


def room_for_rows(robots: int, things: int) -> Rows:
    """Make rows that can be filled, for so many robots that keep clear of so many things."""
    pairs = robots * (robots - 1) // 2
    figures = np.empty((2, robots, things))
    return Rows(
        np.empty((robots, things, 2)),
        figures[0],
        figures[1],
        np.zeros(robots, dtype=np.int64),
        np.empty((pairs, 2), dtype=np.int64),
        np.empty((pairs, 4)),
        np.empty(pairs),
        np.zeros(1, dtype=np.int64),
        np.arange(robots),
    )


#: how a kind of thing is kept clear of
KIND = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("a", np.float64),  # gain [1/s]
                ("b", np.float64),  # gain [1/s]
                ("floor", np.float64),  # gap that is asked for from however near [m]
                ("share", np.float64),  # of the present distance, to which a larger gap shrinks
                ("coupling", np.float64),  # of the slack in its rows
            ]
        ),
    )
)
Kinds = NDArray[np.void]  #: (3,) of KIND, in the order OBSTACLE, HUMAN, ROBOT


def kind_table(options: CbfOptions) -> Kinds:
    """Tabulate how each kind of thing is kept clear of.

    Inside its gap a robot is never asked to hold a distance it does not have: the gap shrinks
    to ``share`` of the distance, down to ``floor``. Below the floor it is asked to leave.
    Obstacle rows give way to the common slack least, so that no robot is pushed into a wall.
    """
    body = options.body_radius
    obstacle_floor = min(body + BODY_MARGIN, options.min_gap_obstacle)
    robot_floor = min(2.0 * body + PAIR_MARGIN, options.min_gap_robot)
    rows = [
        (*options.gains_obstacle, obstacle_floor, OBSTACLE_SHARE, OBSTACLE_COUPLING),
        (*options.gains_human, 0.0, 1.0, 1.0),
        (*options.gains_robot, robot_floor, 1.0, 1.0),
    ]
    return np.array(rows, dtype=KIND)


@njit(cache=True)
def barrier_row(
    movers: Movers, i: int, x: float, y: float, vx: float, vy: float, gap: float, kind: np.record
) -> tuple[float, float, float, float, float]:
    """Write the row of robot ``i`` against one thing.

    Args:
        movers: all robots.
        i: number of the robot.
        x: of the thing [m], map frame.
        y: of the thing [m].
        vx: velocity of the thing [m/s].
        vy: velocity of the thing [m/s].
        gap: distance to keep [m].
        kind: of the thing.

    Returns:
        Two coefficients, the bound [m/s^2], and the unit vector from thing to robot.
    """
    dx, dy = movers.pose[i, 0] - x, movers.pose[i, 1] - y
    distance = max(np.sqrt(dx * dx + dy * dy), NEAREST)
    ux, uy = dx / distance, dy / distance
    wx, wy = movers.velocity[i, 0] - vx, movers.velocity[i, 1] - vy
    a, b = kind.a, kind.b
    held = min(gap, max(kind.floor, kind.share * distance))
    h_half = 0.5 * (distance * distance - held * held)
    demand = -((wx * wx + wy * wy) / distance + (a + b) * (ux * wx + uy * wy))
    bound = demand - a * b * h_half / distance
    effect = movers.effect
    first = ux * effect[i, 0, 0] + uy * effect[i, 1, 0]
    second = ux * effect[i, 0, 1] + uy * effect[i, 1, 1]
    return first, second, bound, ux, uy


@njit(cache=True)
def _reach(i: int, first: float, second: float, low: Array, high: Array) -> tuple[float, float]:
    """Find the smallest and largest value of a row over the box of inputs of robot ``i``."""
    one, other = first * low[i, 0], first * high[i, 0]
    third, fourth = second * low[i, 1], second * high[i, 1]
    return min(one, other) + min(third, fourth), max(one, other) + max(third, fourth)


@njit(cache=True)
def _requested(bound: float, least: float, most: float) -> float:
    """Cut the bound of a row that reaches from ``least`` to ``most`` to what can be given."""
    return float(min(bound, most - (1.0 - EFFORT) * (most - least)))


@njit(cache=True)
def _add_row(
    i: int,
    row: tuple[float, float, float, float, float],
    part: float,
    coupling: float,
    box: tuple[Array, Array],
    rows: Rows,
) -> None:
    """Add a row of :func:`barrier_row` to those of robot ``i``, if its inputs can violate it."""
    first, second, bound, _, _ = row
    bound *= part
    low, high = box
    least, most = _reach(i, first, second, low, high)
    if least >= bound or most - least < GRIP:
        return
    c = rows.own_count[i]
    rows.own[i, c, 0], rows.own[i, c, 1] = first, second
    rows.own_bound[i, c] = _requested(bound, least, most)
    rows.own_coupling[i, c] = coupling
    rows.own_count[i] = c + 1


@njit(cache=True)
def fill_own_rows(
    movers: Movers,
    low: Array,
    high: Array,
    things: Things,
    clearances: Clearances,
    kinds: Kinds,
    rows: Rows,
) -> None:
    """Write the rows that concern one robot.

    Args:
        movers: all robots.
        low: ``(N, 2)`` smallest inputs.
        high: ``(N, 2)`` largest inputs.
        things: what they keep clear of.
        clearances: by how much.
        kinds: how.
        rows: none so far.
    """
    point, people, near, seen_from = things.point, things.people, things.near, things.seen_from
    n, sectors = point.shape[0], point.shape[1]
    pose, group, box = movers.pose, movers.group, (low, high)
    for i in range(n):
        if group[i] < 0:
            continue
        kind = kinds[OBSTACLE]
        for k in range(sectors):
            if np.isfinite(point[i, k, 0]):
                s = seen_from[i, k] if len(seen_from) else i
                x, y = point[i, k, 0], point[i, k, 1]
                row = barrier_row(movers, s, x, y, 0.0, 0.0, clearances.obstacle, kind)
                _add_row(i, row, 1.0, kind.coupling, box, rows)
        kind = kinds[HUMAN]
        for k in range(people.radius.shape[0]):
            if is_in_sight(people.position, i, pose, k):
                s = seen_from[i, sectors + k] if len(seen_from) else i
                x, y = people.position[k, 0], people.position[k, 1]
                vx, vy = people.velocity[k, 0], people.velocity[k, 1]
                gap = clearances.human + people.radius[k] - HUMAN_RADIUS
                row = barrier_row(movers, s, x, y, vx, vy, gap, kind)
                _add_row(i, row, 1.0, kind.coupling, box, rows)
        kind = kinds[ROBOT]
        for m in range(near.first[i], near.first[i + 1]):
            j = near.number[m]
            if not movers.known[j] or group[j] == group[i]:
                continue
            dx, dy = pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1]
            if dx * dx + dy * dy < ROBOT_RANGE * ROBOT_RANGE:
                vx, vy = movers.velocity[j, 0], movers.velocity[j, 1]
                row = barrier_row(movers, i, pose[j, 0], pose[j, 1], vx, vy, clearances.robot, kind)
                part = 1.0 if things.loads[j] else things.share[i, j]
                _add_row(i, row, part, kind.coupling, box, rows)


@njit(cache=True)
def reach_of_pairs(movers: Movers, kind: np.record, min_gap: float) -> float:
    """Say beyond which distance no inputs of two robots can violate their row [m].

    At distance d a row asks for at most (a + b) times the speed at which the two come nearer,
    less a b (d^2 - gap^2) / (2 d); all inputs together change its value by no more than what they
    can do to both robots. The root of the quadratic between the two is returned.
    """
    speed, push = 0.0, 0.0
    effect, limit, velocity = movers.effect, movers.limit, movers.velocity
    for i in range(movers.group.shape[0]):
        speed = max(speed, np.hypot(velocity[i, 0], velocity[i, 1]))
        first = np.hypot(effect[i, 0, 0], effect[i, 1, 0]) * limit[i, 0]
        second = np.hypot(effect[i, 0, 1], effect[i, 1, 1]) * limit[i, 1]
        push = max(push, first + second)
    asked = 2.0 * ((kind.a + kind.b) * speed + push)
    product = kind.a * kind.b
    if product <= 0.0:
        return np.inf
    root = np.sqrt(asked * asked + product * product * min_gap * min_gap)
    return float((asked + root) / product) + ROUNDING


@njit(cache=True)
def fill_pair_rows(
    movers: Movers,
    low: Array,
    high: Array,
    kind: np.record,
    min_gap: float,
    near: Neighbours,
    rows: Rows,
) -> None:
    """Write the rows that concern two robots of one group.

    ``movers``, ``low``, ``high`` and ``rows`` are as for :func:`fill_own_rows`, ``near`` lists
    robots within :func:`reach_of_pairs` or farther.
    """
    p, pose, velocity, group = 0, movers.pose, movers.velocity, movers.group
    pair, pair_row, pair_bound = rows.pair, rows.pair_row, rows.pair_bound
    effect = movers.effect
    for i in range(group.shape[0]):
        for m in range(near.first[i], near.first[i + 1]):
            j = near.number[m]
            if j < i or group[i] < 0 or group[i] != group[j]:
                continue
            first, second, bound, ux, uy = barrier_row(
                movers, i, pose[j, 0], pose[j, 1], velocity[j, 0], velocity[j, 1], min_gap, kind
            )
            third = -(ux * effect[j, 0, 0] + uy * effect[j, 1, 0])
            fourth = -(ux * effect[j, 0, 1] + uy * effect[j, 1, 1])
            least_i, most_i = _reach(i, first, second, low, high)
            least_j, most_j = _reach(j, third, fourth, low, high)
            least, most = least_i + least_j, most_i + most_j
            if least >= bound or most - least < GRIP:
                continue
            pair[p, 0], pair[p, 1] = i, j
            pair_row[p, 0], pair_row[p, 1] = first, second
            pair_row[p, 2], pair_row[p, 3] = third, fourth
            pair_bound[p] = _requested(bound, least, most)
            p += 1
            _fill_joined(rows.component, i, j)
    rows.pair_count[0] = p


@njit(cache=True)
def _fill_joined(component: IntArray, i: int, j: int) -> None:
    """Give the components of robots ``i`` and ``j`` the smaller of their numbers."""
    a, b = min(component[i], component[j]), max(component[i], component[j])
    if a != b:
        for k in range(component.shape[0]):
            if component[k] == b:
                component[k] = a


@njit(cache=True)
def input_box(
    limit: Array, speed: Array, low_speed: Array, high_speed: Array, dt: float, along: bool
) -> tuple[Array, Array]:
    """Bound the inputs ``(N, 2)`` by the limits, and by the speed range if it binds."""
    n = limit.shape[0]
    low, high = -limit, limit.copy()
    if along:
        for i in range(n):
            top = limit[i, 0]
            high[i, 0] = min(top, max(-top, (high_speed[i] - speed[i]) / dt))
            low[i, 0] = max(-top, min(top, (low_speed[i] - speed[i]) / dt))
            low[i, 0] = min(low[i, 0], high[i, 0])
    return low, high


@njit(cache=True)
def fill_violated(
    inputs: Array, lines: tuple[Any, ...], broken: BoolArray, height: IntArray
) -> bool:
    """Say whether inputs break a row of any component.

    Args:
        inputs: ``(N, 2)``.
        lines: fields of :class:`Rows`.
        broken: ``(N,)``, false so far; filled with whether a row of the component of that number
            is broken.
        height: ``(N,)``, 0 so far; filled with the number of its rows.
    """
    rows = Rows(*lines)
    for i in range(inputs.shape[0]):
        height[rows.component[i]] += rows.own_count[i]
        for k in range(rows.own_count[i]):
            value = rows.own[i, k, 0] * inputs[i, 0] + rows.own[i, k, 1] * inputs[i, 1]
            if value < rows.own_bound[i, k] - BROKEN:
                broken[rows.component[i]] = True
                break
    for p in range(rows.pair_count[0]):
        i, j, row = rows.pair[p, 0], rows.pair[p, 1], rows.pair_row
        height[rows.component[i]] += 1
        value = row[p, 0] * inputs[i, 0] + row[p, 1] * inputs[i, 1]
        value += row[p, 2] * inputs[j, 0] + row[p, 3] * inputs[j, 1]
        if value < rows.pair_bound[p] - BROKEN:
            broken[rows.component[i]] = True
    return bool(broken.any())
