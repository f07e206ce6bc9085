"""The quadratic program of a group of coupled robots.

minimise   1/2 sum w (u - u_ref)^2 + 1/2 q s^2
such that  rows @ u + coupling s >= bound,   low <= u <= high,   s >= 0

Inputs u have hard limits, the one slack s softens the barriers. Programs go through the door
of :mod:`~mrta_falsify.stack.control.solvers`; what DAQP does not solve, OSQP does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.stack.control.barrier import Rows, fill_violated
from mrta_falsify.stack.control.solvers import (
    UNBOUNDED,
    QuadraticProgram,
    Solution,
    solve_by_daqp,
    solve_by_osqp,
)

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
    solver: str = "daqp",
    always: bool = False,
) -> FleetInputs:
    """Find the inputs nearest to the reference that obey the rows, program by program.

    A component whose rows the reference obeys needs no solver: the reference is the answer.

    Args:
        rows: constraints of all robots.
        demand: what is wanted, within which limits.
        brake: gives the inputs ``(N, 2)`` used when a program has no usable answer.
        slack_weight: price of the slack, > 0.
        solver: ``daqp``, which leaves what it does not solve to OSQP, or ``osqp``.
        always: call the solver even where the reference obeys all rows (for measuring).
    """
    reference = demand.reference
    n = len(reference)
    broken, height = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.int64)
    any_broken = fill_violated(reference, tuple(rows), broken, height)
    slack, failed = np.zeros(n), np.zeros(n, dtype=np.bool_)
    if always:
        broken = rows.component == np.arange(n)
    elif not any_broken:
        return FleetInputs(inputs=reference, slack=slack, usable=~failed, solved=0)
    heads: list[int] = broken.nonzero()[0].tolist()
    inputs = reference.copy()
    # The slack variable is sqrt(q) s: all diagonal entries of the Hessian are then near 1.
    scale = 1.0 / math.sqrt(slack_weight)
    for head in heads:
        members = (rows.component == head).nonzero()[0]
        program = component_program(rows, demand, members, int(height[head]), scale)
        solution = _solve(program, solver)
        is_finite = _take_in(solution.x, members, scale, (demand.low, demand.high), (inputs, slack))
        if not (solution.solved and is_finite):
            inputs[members] = brake()[members]
            failed[members] = True
    return FleetInputs(inputs=inputs, slack=slack, usable=~failed, solved=len(heads))


def _solve(program: QuadraticProgram, solver: str) -> Solution:
    if solver == "daqp":
        solution = solve_by_daqp(program)
        if solution.solved:
            return solution
    return solve_by_osqp(program)


def component_program(
    rows: Rows, demand: Demand, members: IntArray, height: int, scale: float
) -> QuadraticProgram:
    """Write the program of one component, which has ``height`` rows.

    Rows have unit length; the last variable is the slack divided by ``scale``.
    """
    columns = 2 * len(members) + 1
    program = QuadraticProgram(
        np.zeros((columns, columns)),
        np.zeros(columns),
        np.zeros((height, columns)),
        np.zeros(columns + height),
        np.empty(columns + height),
    )
    _fill_program(tuple(rows), tuple(demand), members, scale, tuple(program))
    return program


@njit(cache=True)
def _fill_program(
    lines: tuple[Any, ...],
    requested: tuple[Any, ...],
    members: IntArray,
    scale: float,
    program: tuple[Any, ...],
) -> None:
    """Fill the fields of a program whose arrays are 0 so far.

    Args:
        lines: fields of :class:`Rows`.
        requested: fields of :class:`Demand`.
        members: robots of the program.
        scale: of the slack.
        program: fields of the :class:`QuadraticProgram`.
    """
    rows, demand = Rows(*lines), Demand(*requested)
    hessian, linear, matrix, lower, upper = program
    n = members.shape[0]
    columns, last = 2 * n + 1, 2 * n
    place = np.full(rows.own_count.shape[0], -1)  # of each robot among the members
    for k in range(n):
        place[members[k]] = k
    hessian[last, last] = 1.0
    upper[:] = UNBOUNDED
    row = 0
    for k in range(n):
        i = members[k]
        for c in range(2):
            hessian[2 * k + c, 2 * k + c] = demand.weight[i]
            linear[2 * k + c] = -demand.weight[i] * demand.reference[i, c]
            lower[2 * k + c] = demand.low[i, c]
            upper[2 * k + c] = demand.high[i, c]
        for c in range(rows.own_count[i]):
            matrix[row, 2 * k : 2 * k + 2] = rows.own[i, c]
            matrix[row, last] = rows.own_coupling[i, c] * scale
            lower[columns + row] = rows.own_bound[i, c]
            row += 1
    for p in range(rows.pair_count[0]):
        a, b = place[rows.pair[p, 0]], place[rows.pair[p, 1]]
        if a < 0 or b < 0:
            continue
        matrix[row, 2 * a : 2 * a + 2] = rows.pair_row[p, :2]
        matrix[row, 2 * b : 2 * b + 2] = rows.pair_row[p, 2:]
        matrix[row, last] = scale
        lower[columns + row] = rows.pair_bound[p]
        row += 1
    for row in range(matrix.shape[0]):
        size = np.sqrt(np.sum(matrix[row] ** 2))
        matrix[row] /= size
        lower[columns + row] /= size


@njit(cache=True)
def _take_in(
    x: Array,
    members: IntArray,
    scale: float,
    limits: tuple[Array, Array],
    result: tuple[Array, Array],
) -> bool:
    """Take in a solution.

    Args:
        x: ``(2 n + 1,)``.
        members: ``(n,)`` robots of the program.
        scale: of the slack.
        limits: smallest and largest inputs ``(N, 2)``.
        result: inputs ``(N, 2)`` and slacks ``(N,)``, filled for members.

    Returns:
        Whether all of it is finite.
    """
    low, high = limits
    inputs, slack = result
    needed = max(0.0, x[x.shape[0] - 1] * scale)
    if not np.isfinite(x).all():
        return False
    for k in range(members.shape[0]):
        i = members[k]
        for c in range(2):
            inputs[i, c] = min(max(x[2 * k + c], low[i, c]), high[i, c])
        slack[i] = needed if needed > NO_SLACK else 0.0
    return True
