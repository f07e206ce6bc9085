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

from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.stack.control.barrier_options import CbfOptions

OBSTACLE, HUMAN, ROBOT = 0, 1, 2  #: kinds of things
KIND_FIELDS = 5  #: a, b [1/s], floor of the gap [m], share of the distance, slack coupling
GRIP = 0.1  # m/s^2, rows that all inputs together move by less are left out: nothing to gain
EFFORT = 0.98  # no row asks for more than this share of what the inputs can give


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Linear constraints on the inputs; those that no input could violate are left out."""

    own: Array  #: (N, T, 2) coefficients of rows that concern one robot
    own_bound: Array  #: (N, T) row @ input + coupling * slack >= bound [m/s^2]
    own_coupling: Array  #: (N, T)
    own_count: IntArray  #: (N,) rows in use
    pair: IntArray  #: (P, 2) robot numbers of rows that concern two
    pair_row: Array  #: (P, 4) coefficients of the first and of the second robot's inputs
    pair_bound: Array  #: (P,)
    component: IntArray  #: (N,) smallest number of the robots coupled by rows


def kind_table(options: CbfOptions) -> Array:
    """Constants ``(3, 5)`` of the kinds, in the order OBSTACLE, HUMAN, ROBOT.

    Inside its gap a robot is never asked to hold a distance it does not have: the gap shrinks
    to ``share`` of the distance, down to ``floor``. Below the floor it is asked to leave.
    Obstacle rows give way to the common slack least, so that nobody is pushed into a wall.
    """
    body = options.body_radius
    return np.array(
        [
            [*options.gains_obstacle, min(body + 0.01, options.min_gap_obstacle), 0.95, 0.25],
            [*options.gains_human, 0.0, 1.0, 1.0],
            [*options.gains_robot, min(2.0 * body + 0.04, options.min_gap_robot), 1.0, 1.0],
        ]
    )


@njit(cache=True)
def barrier_row(
    position: Array,
    velocity: Array,
    effect: Array,
    other: Array,
    other_velocity: Array,
    gap: float,
    constants: Array,
) -> tuple[float, float, float, float, float]:
    """Row of one robot against one thing.

    Args:
        position: ``(2,)`` robot [m], map frame.
        velocity: ``(2,)`` robot [m/s], map frame.
        effect: ``(2, 2)`` acceleration per input.
        other: ``(2,)`` thing [m].
        other_velocity: ``(2,)`` thing [m/s].
        gap: distance to keep [m].
        constants: a row of :func:`kind_table`.

    Returns:
        Two coefficients, the bound [m/s^2], and the unit vector from thing to robot.
    """
    dx, dy = position[0] - other[0], position[1] - other[1]
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-6)
    ux, uy = dx / distance, dy / distance
    wx, wy = velocity[0] - other_velocity[0], velocity[1] - other_velocity[1]
    a, b = constants[0], constants[1]
    held = min(gap, max(constants[2], constants[3] * distance))
    h_half = 0.5 * (distance * distance - held * held)
    demand = -((wx * wx + wy * wy) / distance + (a + b) * (ux * wx + uy * wy))
    bound = demand - a * b * h_half / distance
    first = ux * effect[0, 0] + uy * effect[1, 0]
    second = ux * effect[0, 1] + uy * effect[1, 1]
    return first, second, bound, ux, uy


@njit(cache=True)
def _reach(first: float, second: float, low: Array, high: Array) -> tuple[float, float]:
    """Smallest and largest value of a row over the box of inputs."""
    least = min(first * low[0], first * high[0]) + min(second * low[1], second * high[1])
    most = max(first * low[0], first * high[0]) + max(second * low[1], second * high[1])
    return least, most


@njit(cache=True)
def assemble_rows(
    position: Array,
    velocity: Array,
    effect: Array,
    low: Array,
    high: Array,
    group: IntArray,
    thing_position: Array,
    thing_velocity: Array,
    thing_gap: Array,
    thing_kind: IntArray,
    thing_share: Array,
    seen_from: IntArray,
    kinds: Array,
    min_gap_robot: float,
) -> tuple[Array, Array, IntArray, IntArray, Array, Array]:
    """Fields of :class:`Rows` for all robots, in few arrays: each that leaves compiled code costs.

    Args:
        position: ``(N, 2)`` [m].
        velocity: ``(N, 2)`` [m/s].
        effect: ``(N, 2, 2)``.
        low: ``(N, 2)`` smallest inputs.
        high: ``(N, 2)`` largest inputs.
        group: ``(N,)`` robots of equal number >= 0 decide together; < 0: no rows at all.
        thing_position: ``(N, T, 2)``, as from ``surroundings.list_things``, like the next five.
        thing_velocity: ``(N, T, 2)``.
        thing_gap: ``(N, T)``.
        thing_kind: ``(N, T)``.
        thing_share: ``(N, T)``.
        seen_from: ``(N, T)``.
        kinds: see :func:`kind_table`.
        min_gap_robot: [m].

    Returns:
        ``own``; ``own_bound`` and ``own_coupling`` ``(2, N, T)``; ``own_count`` and
        ``component`` ``(2, N)``; ``pair``, ``pair_row``, ``pair_bound``.
    """
    n, t = thing_kind.shape
    own = np.zeros((n, t, 2))
    figures = np.zeros((2, n, t))
    own_bound, own_coupling = figures
    numbers = np.zeros((2, n), dtype=np.int64)
    own_count, component = numbers
    for i in range(n):
        if group[i] < 0:
            continue
        for k in range(t):
            kind = thing_kind[i, k]
            if kind < 0:
                continue
            s = seen_from[i, k]
            first, second, bound, _, _ = barrier_row(
                position[s],
                velocity[s],
                effect[s],
                thing_position[i, k],
                thing_velocity[i, k],
                thing_gap[i, k],
                kinds[kind],
            )
            bound *= thing_share[i, k]
            least, most = _reach(first, second, low[i], high[i])
            if least >= bound or most - least < GRIP:
                continue
            c = own_count[i]
            own[i, c, 0], own[i, c, 1] = first, second
            own_bound[i, c] = min(bound, most - (1.0 - EFFORT) * (most - least))
            own_coupling[i, c] = kinds[kind, 4]
            own_count[i] = c + 1
    pair = np.empty((n * (n - 1) // 2, 2), dtype=np.int64)
    pair_row = np.empty((n * (n - 1) // 2, 4))
    pair_bound = np.empty(n * (n - 1) // 2)
    component[:] = np.arange(n)
    p = 0
    for i in range(n):
        for j in range(i + 1, n):
            if group[i] < 0 or group[i] != group[j]:
                continue
            first, second, bound, ux, uy = barrier_row(
                position[i],
                velocity[i],
                effect[i],
                position[j],
                velocity[j],
                min_gap_robot,
                kinds[ROBOT],
            )
            third = -(ux * effect[j, 0, 0] + uy * effect[j, 1, 0])
            fourth = -(ux * effect[j, 0, 1] + uy * effect[j, 1, 1])
            least_i, most_i = _reach(first, second, low[i], high[i])
            least_j, most_j = _reach(third, fourth, low[j], high[j])
            least, most = least_i + least_j, most_i + most_j
            if least >= bound or most - least < GRIP:
                continue
            pair[p, 0], pair[p, 1] = i, j
            pair_row[p, 0], pair_row[p, 1] = first, second
            pair_row[p, 2], pair_row[p, 3] = third, fourth
            pair_bound[p] = min(bound, most - (1.0 - EFFORT) * (most - least))
            p += 1
            a, b = min(component[i], component[j]), max(component[i], component[j])
            if a != b:
                for k in range(n):
                    if component[k] == b:
                        component[k] = a
    return own, figures, numbers, pair[:p], pair_row[:p], pair_bound[:p]


@njit(cache=True)
def input_box(
    limit: Array, speed: Array, low_speed: Array, high_speed: Array, dt: float, along: bool
) -> tuple[Array, Array]:
    """Smallest and largest inputs ``(N, 2)``: the limits, and the speed range if it binds."""
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
def violated_components(
    inputs: Array,
    own: Array,
    own_bound: Array,
    own_count: IntArray,
    pair: IntArray,
    pair_row: Array,
    pair_bound: Array,
    component: IntArray,
) -> BoolArray:
    """Whether ``inputs`` ``(N, 2)`` break a row of the component of that number ``(N,)``."""
    n = inputs.shape[0]
    broken = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        for k in range(own_count[i]):
            value = own[i, k, 0] * inputs[i, 0] + own[i, k, 1] * inputs[i, 1]
            if value < own_bound[i, k] - 1e-9:
                broken[component[i]] = True
                break
    for p in range(pair.shape[0]):
        i, j = pair[p]
        value = pair_row[p, 0] * inputs[i, 0] + pair_row[p, 1] * inputs[i, 1]
        value += pair_row[p, 2] * inputs[j, 0] + pair_row[p, 3] * inputs[j, 1]
        if value < pair_bound[p] - 1e-9:
            broken[component[i]] = True
    return broken
