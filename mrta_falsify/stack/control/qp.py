"""The quadratic program of a group of coupled robots, and its solvers.

minimise   1/2 sum w (u - u_ref)^2 + 1/2 q s^2
such that  rows @ u + coupling s >= bound,   low <= u <= high,   s >= 0

Inputs u have hard limits, the one slack s softens the barriers. The solver is a pure
function of the problem: fixed step settings, a cold start from the reference each time,
iteration limits and no time limits. What is kept between calls is only the factorised
structure of each problem size.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import osqp
import scipy.sparse
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.stack.control.barrier import Rows, violated_components

OWN_SIZES = (4, 8, 16, 32, 64, 128)  #: rows per robot; a problem takes the next larger size
UNBOUNDED = 1e30
MAX_ITERATIONS = 400  # per step size
STEP_SIZES = (10.0, 1.0, 100.0, 0.3)  # ADMM's rho; the next is tried where one stalls
SOLVED = 1  # OSQP's status
TOLERANCE = 1e-3  # m/s^2, a row broken by more makes the answer unusable


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """One program; n robots, C rows."""

    rows: Array  #: (C, 2 n) coefficients
    coupling: Array  #: (C,) of the slack
    bound: Array  #: (C,) row @ u + coupling * s >= bound
    low: Array  #: (2 n,)
    high: Array  #: (2 n,)
    reference: Array  #: (2 n,)
    weight: Array  #: (2 n,)
    slack_weight: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetInputs:
    """Inputs of all robots."""

    inputs: Array  #: (N, 2)
    slack: Array  #: (N,) of the robot's program, 0: none needed [m/s^2]
    usable: BoolArray  #: (N,) false: the solver failed, `inputs` is the brake
    solved: int  #: programs that needed the solver


def solve_fleet(
    rows: Rows,
    reference: Array,
    brake: Callable[[], Array],
    low: Array,
    high: Array,
    weight: Array,
    *,
    slack_weight: float,
    solver: str = "osqp",
    always: bool = False,
) -> FleetInputs:
    """Inputs nearest to the reference that obey the rows, program by program.

    A component whose rows the reference obeys needs no solver: the reference is the answer.

    Args:
        rows: constraints of all robots.
        reference: ``(N, 2)`` wanted inputs, inside the limits.
        brake: gives the inputs ``(N, 2)`` used when a program has no usable answer.
        low: ``(N, 2)`` smallest inputs.
        high: ``(N, 2)`` largest inputs.
        weight: ``(N,)`` price of moving a robot away from its reference.
        slack_weight: price of the slack, > 0.
        solver: ``osqp`` or ``daqp``.
        always: call the solver even where the reference obeys all rows (for measuring).
    """
    broken = violated_components(reference, rows)
    n = len(reference)
    if always:
        broken = rows.component == np.arange(n)
    heads = [robot for robot, is_broken in enumerate(broken.tolist()) if is_broken]
    if not heads:
        return FleetInputs(inputs=reference, slack=np.zeros(n), usable=~broken, solved=0)
    inputs = reference.copy()
    slack = np.zeros(n)
    usable = np.ones(n, dtype=np.bool_)
    solve = _solve_osqp if solver == "osqp" else _solve_daqp
    for head in heads:
        members = (rows.component == head).nonzero()[0]
        u, s, good = solve(rows, members, reference, low, high, weight, slack_weight)
        inputs[members] = u if good else brake()[members]
        slack[members] = s
        usable[members] = good
    return FleetInputs(inputs=inputs, slack=slack, usable=usable, solved=len(heads))


# --- OSQP ------------------------------------------------------------------------------


class _Structure:
    """An OSQP instance for n robots with m own rows each and all pairs of robots."""

    def __init__(self, n: int, m: int) -> None:
        pairs = n * (n - 1) // 2
        self.columns = 2 * n + 1
        self.height = n * m + pairs + self.columns
        pattern = np.zeros((self.height, self.columns))
        for i in range(n):
            pattern[i * m : (i + 1) * m, 2 * i : 2 * i + 2] = 1.0
        self.pair_row = np.full((n, n), -1, dtype=np.int64)
        row = n * m
        for i in range(n):
            for j in range(i + 1, n):
                self.pair_row[i, j] = row
                pattern[row, 2 * i : 2 * i + 2] = 1.0
                pattern[row, 2 * j : 2 * j + 2] = 1.0
                row += 1
        pattern[:row, 2 * n] = 1.0
        pattern[row:, :] = np.eye(self.columns)
        matrix = scipy.sparse.csc_matrix(pattern)
        matrix.sort_indices()
        #: where in the matrix data each entry (row, column) lives, -1: nowhere
        self.place = np.full(pattern.shape, -1, dtype=np.int64)
        column = np.repeat(np.arange(self.columns), np.diff(matrix.indptr))
        self.place[matrix.indices, column] = np.arange(matrix.nnz)
        self.template = np.zeros(matrix.nnz)
        self.template[self.place[np.arange(row, self.height), np.arange(self.columns)]] = 1.0
        self.first_limit = row
        # Written anew for each program; kept only to save their allocation.
        self.data = self.template.copy()
        self.hessian = np.ones(self.columns)
        self.linear = np.zeros(self.columns)
        self.lower = np.full(self.height, -UNBOUNDED)
        self.upper = np.full(self.height, UNBOUNDED)
        self.start = np.zeros(self.columns)
        self.no_multipliers = np.zeros(self.height)
        self.solver = osqp.OSQP()
        hessian = scipy.sparse.csc_matrix(np.eye(self.columns))
        self.solver.setup(
            hessian,
            np.zeros(self.columns),
            matrix,
            np.full(self.height, -UNBOUNDED),
            np.full(self.height, UNBOUNDED),
            verbose=False,
            rho=STEP_SIZES[0],
            sigma=1e-6,
            alpha=1.6,
            scaling=0,
            adaptive_rho=False,
            polishing=False,
            eps_abs=2e-5,
            eps_rel=0.0,
            check_termination=5,
            max_iter=MAX_ITERATIONS,
            time_limit=1e9,
        )


@functools.lru_cache(maxsize=64)
def _structure(n: int, m: int) -> _Structure:
    return _Structure(n, m)


@njit(cache=True)
def _fill_program(
    own: Array,
    own_bound: Array,
    own_coupling: Array,
    own_count: IntArray,
    pair: IntArray,
    pair_row: Array,
    pair_bound: Array,
    members: IntArray,
    low: Array,
    high: Array,
    reference: Array,
    weight: Array,
    slack_scale: float,
    m: int,
    place: IntArray,
    pair_place: IntArray,
    first_limit: int,
    template: Array,
    data: Array,
    hessian: Array,
    linear: Array,
    lower: Array,
    upper: Array,
    start: Array,
) -> None:
    """Write one component into OSQP's arrays: rows of unit length, slack_scale times x[-1] = s."""
    n = members.shape[0]
    last = 2 * n
    data[:] = template
    lower[:] = -UNBOUNDED
    for k in range(n):
        i = members[k]
        for c in range(own_count[i]):
            row = k * m + c
            soft = own_coupling[i, c] * slack_scale
            size = np.sqrt(own[i, c, 0] ** 2 + own[i, c, 1] ** 2 + soft * soft)
            data[place[row, 2 * k]] = own[i, c, 0] / size
            data[place[row, 2 * k + 1]] = own[i, c, 1] / size
            data[place[row, last]] = soft / size
            lower[row] = own_bound[i, c] / size
        for c in range(2):
            hessian[2 * k + c] = weight[i]
            linear[2 * k + c] = -weight[i] * reference[i, c]
            start[2 * k + c] = reference[i, c]
            lower[first_limit + 2 * k + c] = low[i, c]
            upper[first_limit + 2 * k + c] = high[i, c]
    for p in range(pair.shape[0]):
        a = b = -1
        for k in range(n):
            if members[k] == pair[p, 0]:
                a = k
            elif members[k] == pair[p, 1]:
                b = k
        if a < 0 or b < 0:
            continue
        row = pair_place[a, b]
        size = slack_scale * slack_scale
        for c in range(4):
            size += pair_row[p, c] ** 2
        size = np.sqrt(size)
        for c in range(2):
            data[place[row, 2 * a + c]] = pair_row[p, c] / size
            data[place[row, 2 * b + c]] = pair_row[p, 2 + c] / size
        data[place[row, last]] = slack_scale / size
        lower[row] = pair_bound[p] / size
    lower[first_limit + last] = 0.0


def _solve_osqp(
    rows: Rows,
    members: IntArray,
    reference: Array,
    low: Array,
    high: Array,
    weight: Array,
    slack_weight: float,
) -> tuple[Array, float, bool]:
    """Inputs ``(n, 2)``, slack and usability of one component."""
    wanted = max(rows.own_count[members].tolist())
    m = next((size for size in OWN_SIZES if size >= wanted), wanted)
    structure = _structure(len(members), m)
    # The slack variable is sqrt(q) s: all diagonal entries of the Hessian are then near 1.
    scale = 1.0 / math.sqrt(slack_weight)
    _fill_program(
        rows.own,
        rows.own_bound,
        rows.own_coupling,
        rows.own_count,
        rows.pair,
        rows.pair_row,
        rows.pair_bound,
        members,
        low,
        high,
        reference,
        weight,
        scale,
        m,
        structure.place,
        structure.pair_row,
        structure.first_limit,
        structure.template,
        structure.data,
        structure.hessian,
        structure.linear,
        structure.lower,
        structure.upper,
        structure.start,
    )
    inner = structure.solver._solver
    inner.update_data_vec(q=structure.linear, l=structure.lower, u=structure.upper)
    inner.update_data_mat(P_x=structure.hessian, P_i=None, A_x=structure.data, A_i=None)
    inner.warm_start(structure.start, structure.no_multipliers)
    for attempt, step_size in enumerate(STEP_SIZES):
        if attempt:
            inner.update_rho(step_size)
        inner.solve()
        solved = inner.info.status_val == SOLVED
        if solved:
            break
    if attempt:
        inner.update_rho(STEP_SIZES[0])
    x = inner.solution.x
    u, finite = _within_limits(x, members, low, high)
    if not finite:
        return reference[members], 0.0, False
    slack = max(0.0, float(x[-1]) * scale)
    good = solved or _worst_break(rows, members, u, slack) < TOLERANCE
    return u, slack if slack > 1e-4 else 0.0, good


@njit(cache=True)
def _within_limits(x: Array, members: IntArray, low: Array, high: Array) -> tuple[Array, bool]:
    """Inputs ``(n, 2)`` of a solution ``(2 n + 1,)``, clipped; and whether all of it is finite."""
    n = members.shape[0]
    u = np.empty((n, 2))
    finite = bool(np.isfinite(x[2 * n]))
    for k in range(n):
        for c in range(2):
            value = x[2 * k + c]
            finite = finite and np.isfinite(value)
            u[k, c] = min(max(value, low[members[k], c]), high[members[k], c])
    return u, finite


def _worst_break(rows: Rows, members: IntArray, u: Array, slack: float) -> float:
    """Largest amount by which ``u`` and ``slack`` break a row [m/s^2]."""
    problem = component_problem(rows, members, u, u, u, np.ones(len(rows.own_count)), 1.0)
    value = problem.rows @ u.ravel() + problem.coupling * slack
    return float(np.max(problem.bound - value, initial=0.0))


# --- dense form, DAQP -------------------------------------------------------------------


def component_problem(
    rows: Rows,
    members: IntArray,
    reference: Array,
    low: Array,
    high: Array,
    weight: Array,
    slack_weight: float,
) -> Problem:
    """Dense form of one component's program.

    ``reference``, ``low`` and ``high`` are ``(n, 2)``, for the members only.
    """
    n = len(members)
    lines: list[Array] = []
    coupling: list[float] = []
    bound: list[float] = []
    for k, i in enumerate(members):
        for c in range(rows.own_count[i]):
            line = np.zeros(2 * n)
            line[2 * k : 2 * k + 2] = rows.own[i, c]
            lines.append(line)
            coupling.append(float(rows.own_coupling[i, c]))
            bound.append(float(rows.own_bound[i, c]))
    number = {int(i): k for k, i in enumerate(members)}
    for p, (i, j) in enumerate(rows.pair):
        if int(i) not in number or int(j) not in number:
            continue
        line = np.zeros(2 * n)
        a, b = number[int(i)], number[int(j)]
        line[2 * a : 2 * a + 2] = rows.pair_row[p, :2]
        line[2 * b : 2 * b + 2] = rows.pair_row[p, 2:]
        lines.append(line)
        coupling.append(1.0)
        bound.append(float(rows.pair_bound[p]))
    return Problem(
        rows=np.array(lines).reshape(-1, 2 * n),
        coupling=np.array(coupling),
        bound=np.array(bound),
        low=low.ravel(),
        high=high.ravel(),
        reference=reference.ravel(),
        weight=np.repeat(weight[members], 2),
        slack_weight=slack_weight,
    )


def _solve_daqp(
    rows: Rows,
    members: IntArray,
    reference: Array,
    low: Array,
    high: Array,
    weight: Array,
    slack_weight: float,
) -> tuple[Array, float, bool]:
    """As :func:`_solve_osqp`, by DAQP (an optional dependency)."""
    try:
        import daqp  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            "controller.solver is 'daqp', which is not installed; `pip install daqp` or use 'osqp'"
        ) from None
    problem = component_problem(
        rows, members, reference[members], low[members], high[members], weight, slack_weight
    )
    size = len(problem.reference) + 1
    hessian = np.diag(np.append(problem.weight, problem.slack_weight))
    linear = np.append(-problem.weight * problem.reference, 0.0)
    matrix = np.column_stack((problem.rows, problem.coupling))
    upper = np.concatenate((problem.high, [UNBOUNDED], np.full(len(matrix), UNBOUNDED)))
    lower = np.concatenate((problem.low, [0.0], problem.bound))
    sense = np.zeros(len(upper), dtype=np.int32)
    x, _, flag, _ = daqp.solve(hessian, linear, np.ascontiguousarray(matrix), upper, lower, sense)
    u = np.clip(x[: size - 1].reshape(-1, 2), low[members], high[members])
    slack = float(x[-1])
    return u, slack if slack > 1e-4 else 0.0, flag > 0
