"""The quadratic program of a group of coupled robots.

minimise   1/2 sum w (u - u_ref)^2 + 1/2 q s^2
such that  rows @ u + coupling s >= bound,   low <= u <= high,   s >= 0

Inputs u have hard limits, the one slack s softens the barriers. Programs go through the door
of :mod:`~mrta_falsify.stack.control.solvers`; what OSQP does not solve, DAQP does.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.stack.control.barrier import Rows, violated_components
from mrta_falsify.stack.control.solvers import (
    UNBOUNDED,
    QuadraticProgram,
    Solution,
    pattern_of,
    solve_by_daqp,
    solve_by_osqp,
)

OWN_SIZES = (4, 8, 16, 32, 64, 128)  #: rows per robot; a problem takes the next larger size
NO_SLACK = 1e-4  # m/s^2, less slack than that is the solvers' tolerance


class Demand(NamedTuple):
    """What all robots would like, and the hard limits."""

    reference: Array  #: (N, 2) wanted inputs, inside the limits
    low: Array  #: (N, 2) smallest inputs
    high: Array  #: (N, 2) largest inputs
    weight: Array  #: (N,) price of moving a robot away from its reference


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetInputs:
    """Inputs of all robots."""

    inputs: Array  #: (N, 2)
    slack: Array  #: (N,) of the robot's program, 0: none needed [m/s^2]
    usable: BoolArray  #: (N,) false: the solver failed, `inputs` is the brake
    solved: int  #: programs that needed the solver


def solve_fleet(
    rows: Rows,
    demand: Demand,
    brake: Callable[[], Array],
    *,
    slack_weight: float,
    solver: str = "osqp",
    always: bool = False,
) -> FleetInputs:
    """Find the inputs nearest to the reference that obey the rows, program by program.

    A component whose rows the reference obeys needs no solver: the reference is the answer.

    Args:
        rows: constraints of all robots.
        demand: what is wanted, within which limits.
        brake: gives the inputs ``(N, 2)`` used when a program has no usable answer.
        slack_weight: price of the slack, > 0.
        solver: ``osqp``, which leaves what it does not solve to DAQP, or ``daqp``.
        always: call the solver even where the reference obeys all rows (for measuring).
    """
    reference = demand.reference
    n = len(reference)
    broken = violated_components(reference, rows)
    if always:
        broken = rows.component == np.arange(n)
    heads = [robot for robot, is_broken in enumerate(broken.tolist()) if is_broken]
    if not heads:
        return FleetInputs(inputs=reference, slack=np.zeros(n), usable=~broken, solved=0)
    inputs = reference.copy()
    slack = np.zeros(n)
    usable = np.ones(n, dtype=np.bool_)
    # The slack variable is sqrt(q) s: all diagonal entries of the Hessian are then near 1.
    scale = 1.0 / math.sqrt(slack_weight)
    for head in heads:
        members = (rows.component == head).nonzero()[0]
        solution = _solve_component(rows, demand, members, scale, solver)
        u, finite = _within_limits(solution.x, members, demand.low, demand.high)
        good = solution.solved and finite
        inputs[members] = u if good else brake()[members]
        needed = max(0.0, float(solution.x[-1]) * scale)
        slack[members] = needed if finite and needed > NO_SLACK else 0.0
        usable[members] = good
    return FleetInputs(inputs=inputs, slack=slack, usable=usable, solved=len(heads))


def _solve_component(
    rows: Rows, demand: Demand, members: IntArray, scale: float, solver: str
) -> Solution:
    wanted = max(rows.own_count[members].tolist())
    m = next((size for size in OWN_SIZES if size >= wanted), wanted)
    program = component_program(rows, demand, members, scale, m)
    if solver == "osqp":
        solution = solve_by_osqp(program, len(members), m)
        if solution.solved:
            return solution
    return solve_by_daqp(program)


def component_program(
    rows: Rows, demand: Demand, members: IntArray, scale: float, m: int
) -> QuadraticProgram:
    """Write the program of one component, with room for ``m`` own rows a robot.

    Rows have unit length; the last variable is the slack divided by ``scale``. The arrays are
    valid until the next call.
    """
    program = _blank(len(members), m)
    _fill_program(rows, demand, members, scale, m, program)
    return program


@functools.lru_cache(maxsize=64)
def _blank(n: int, m: int) -> QuadraticProgram:
    """Allocate the arrays of a program; they are kept only to save time."""
    height, columns = pattern_of(n, m).shape
    return QuadraticProgram(
        hessian=np.ones(columns),
        linear=np.zeros(columns),
        matrix=np.zeros((height, columns)),
        lower=np.full(height + columns, -UNBOUNDED),
        upper=np.full(height + columns, UNBOUNDED),
        start=np.zeros(columns),
    )


@njit(cache=True)
def _fill_program(
    rows: Rows,
    demand: Demand,
    members: IntArray,
    scale: float,
    m: int,
    program: QuadraticProgram,
) -> None:
    """Fill ``program`` as :func:`component_program` says."""
    n = members.shape[0]
    last, first_limit = 2 * n, program.matrix.shape[0]
    program.matrix[:] = 0.0
    program.lower[:] = -UNBOUNDED
    for k in range(n):
        i = members[k]
        for c in range(rows.own_count[i]):
            row = k * m + c
            first, second = rows.own[i, c]
            soft = rows.own_coupling[i, c] * scale
            size = np.sqrt(first**2 + second**2 + soft * soft)
            program.matrix[row, 2 * k] = first / size
            program.matrix[row, 2 * k + 1] = second / size
            program.matrix[row, last] = soft / size
            program.lower[row] = rows.own_bound[i, c] / size
        for c in range(2):
            program.hessian[2 * k + c] = demand.weight[i]
            program.linear[2 * k + c] = -demand.weight[i] * demand.reference[i, c]
            program.start[2 * k + c] = demand.reference[i, c]
            program.lower[first_limit + 2 * k + c] = demand.low[i, c]
            program.upper[first_limit + 2 * k + c] = demand.high[i, c]
    _fill_pair_rows(rows, members, scale, n * m, program)
    program.lower[first_limit + last] = 0.0


@njit(cache=True)
def _fill_pair_rows(
    rows: Rows, members: IntArray, scale: float, first_row: int, program: QuadraticProgram
) -> None:
    """Fill in the rows of pairs of members; pair (a, b) has one place, in use or not."""
    n = members.shape[0]
    for p in range(rows.pair.shape[0]):
        a = b = -1
        for k in range(n):
            if members[k] == rows.pair[p, 0]:
                a = k
            elif members[k] == rows.pair[p, 1]:
                b = k
        if a < 0 or b < 0:
            continue
        row = first_row + a * (2 * n - a - 1) // 2 + b - a - 1
        size = scale * scale
        for c in range(4):
            size += rows.pair_row[p, c] ** 2
        size = np.sqrt(size)
        for c in range(2):
            program.matrix[row, 2 * a + c] = rows.pair_row[p, c] / size
            program.matrix[row, 2 * b + c] = rows.pair_row[p, 2 + c] / size
        program.matrix[row, 2 * n] = scale / size
        program.lower[row] = rows.pair_bound[p] / size


@njit(cache=True)
def _within_limits(x: Array, members: IntArray, low: Array, high: Array) -> tuple[Array, bool]:
    """Clip the inputs ``(n, 2)`` of a solution ``(2 n + 1,)``; says whether all of it is finite."""
    n = members.shape[0]
    u = np.empty((n, 2))
    finite = bool(np.isfinite(x[2 * n]))
    for k in range(n):
        for c in range(2):
            value = x[2 * k + c]
            finite = finite and np.isfinite(value)
            u[k, c] = min(max(value, low[members[k], c]), high[members[k], c])
    return u, finite
