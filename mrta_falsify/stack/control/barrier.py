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
from mrta_falsify.stack.control.barrier_options import CbfOptions

OBSTACLE, HUMAN, ROBOT = 0, 1, 2  #: kinds of things
GRIP = 0.1  # m/s^2, rows that all inputs together move by less are left out: nothing to gain
EFFORT = 0.98  # no row asks for more than this share of what the inputs can give
NEAREST = 1e-6  # m, distances below count as this: a direction is needed
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


class Things(NamedTuple):
    """What each robot must keep clear of by itself; T entries per robot."""

    position: Array  #: (N, T, 2) [m]
    velocity: Array  #: (N, T, 2) [m/s]
    gap: Array  #: (N, T) distance to keep, centre to centre [m]
    kind: IntArray  #: (N, T) OBSTACLE, HUMAN or ROBOT; -1: no entry
    share: Array  #: (N, T) part of the demand that this robot takes
    seen_from: IntArray  #: (N, T) robot whose state enters the row: the robot itself


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
    figures = np.zeros((2, robots, things))
    return Rows(
        np.zeros((robots, things, 2)),
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
    position: Array,
    velocity: Array,
    effect: Array,
    other: Array,
    other_velocity: Array,
    gap: float,
    kind: np.record,
) -> tuple[float, float, float, float, float]:
    """Write the row of one robot against one thing.

    Args:
        position: ``(2,)`` robot [m], map frame.
        velocity: ``(2,)`` robot [m/s], map frame.
        effect: ``(2, 2)`` acceleration per input.
        other: ``(2,)`` thing [m].
        other_velocity: ``(2,)`` thing [m/s].
        gap: distance to keep [m].
        kind: of the thing.

    Returns:
        Two coefficients, the bound [m/s^2], and the unit vector from thing to robot.
    """
    dx, dy = position[0] - other[0], position[1] - other[1]
    distance = max(np.sqrt(dx * dx + dy * dy), NEAREST)
    ux, uy = dx / distance, dy / distance
    wx, wy = velocity[0] - other_velocity[0], velocity[1] - other_velocity[1]
    a, b = kind.a, kind.b
    held = min(gap, max(kind.floor, kind.share * distance))
    h_half = 0.5 * (distance * distance - held * held)
    demand = -((wx * wx + wy * wy) / distance + (a + b) * (ux * wx + uy * wy))
    bound = demand - a * b * h_half / distance
    first = ux * effect[0, 0] + uy * effect[1, 0]
    second = ux * effect[0, 1] + uy * effect[1, 1]
    return first, second, bound, ux, uy


@njit(cache=True)
def _reach(first: float, second: float, low: Array, high: Array) -> tuple[float, float]:
    """Find the smallest and largest value of a row over the box of inputs."""
    least = min(first * low[0], first * high[0]) + min(second * low[1], second * high[1])
    most = max(first * low[0], first * high[0]) + max(second * low[1], second * high[1])
    return least, most


@njit(cache=True)
def _requested(bound: float, least: float, most: float) -> float:
    """Cut the bound of a row that reaches from ``least`` to ``most`` to what can be given."""
    return float(min(bound, most - (1.0 - EFFORT) * (most - least)))


@njit(cache=True)
def fill_own_rows(
    movers: Movers, low: Array, high: Array, things: Things, kinds: Kinds, rows: Rows
) -> None:
    """Write the rows that concern one robot.

    Args:
        movers: all robots.
        low: ``(N, 2)`` smallest inputs.
        high: ``(N, 2)`` largest inputs.
        things: what they keep clear of.
        kinds: how.
        rows: none so far.
    """
    n, t = things.kind.shape
    for i in range(n):
        if movers.group[i] < 0:
            continue
        for k in range(t):
            if things.kind[i, k] < 0:
                continue
            kind = kinds[things.kind[i, k]]
            s = things.seen_from[i, k]
            first, second, bound, _, _ = barrier_row(
                movers.pose[s],
                movers.velocity[s],
                movers.effect[s],
                things.position[i, k],
                things.velocity[i, k],
                things.gap[i, k],
                kind,
            )
            bound *= things.share[i, k]
            least, most = _reach(first, second, low[i], high[i])
            if least >= bound or most - least < GRIP:
                continue
            c = rows.own_count[i]
            rows.own[i, c, 0], rows.own[i, c, 1] = first, second
            rows.own_bound[i, c] = _requested(bound, least, most)
            rows.own_coupling[i, c] = kind.coupling
            rows.own_count[i] = c + 1


@njit(cache=True)
def fill_pair_rows(
    movers: Movers, low: Array, high: Array, kind: np.record, min_gap: float, rows: Rows
) -> None:
    """Write the rows that concern two robots of one group.

    ``movers``, ``low``, ``high`` and ``rows`` are as for :func:`fill_own_rows`.
    """
    n, p = movers.group.shape[0], 0
    pair, pair_row, pair_bound = rows.pair, rows.pair_row, rows.pair_bound
    for i in range(n):
        for j in range(i + 1, n):
            if movers.group[i] < 0 or movers.group[i] != movers.group[j]:
                continue
            first, second, bound, ux, uy = barrier_row(
                movers.pose[i],
                movers.velocity[i],
                movers.effect[i],
                movers.pose[j],
                movers.velocity[j],
                min_gap,
                kind,
            )
            effect = movers.effect[j]
            third = -(ux * effect[0, 0] + uy * effect[1, 0])
            fourth = -(ux * effect[0, 1] + uy * effect[1, 1])
            least_i, most_i = _reach(first, second, low[i], high[i])
            least_j, most_j = _reach(third, fourth, low[j], high[j])
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
        i, j = rows.pair[p]
        height[rows.component[i]] += 1
        row = rows.pair_row[p]
        value = row[0] * inputs[i, 0] + row[1] * inputs[i, 1]
        value += row[2] * inputs[j, 0] + row[3] * inputs[j, 1]
        if value < rows.pair_bound[p] - BROKEN:
            broken[rows.component[i]] = True
    return bool(broken.any())
