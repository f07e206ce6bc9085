"""The one door to the solvers of quadratic programs: a program in, a point and a status out.

The answer is a pure function of the program: fixed settings, a start from the program's own
point, iteration limits and no time limits. All that is kept between calls is OSQP's
factorised structure of each size of program.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import daqp
import numpy as np
import osqp
import scipy.sparse

from mrta_falsify.core.arrays import Array

UNBOUNDED = 1e30  #: both solvers' infinity
PRIMAL_TOLERANCE = 2e-5  # of rows of unit length and of inputs [m/s^2, rad/s]
MAX_ITERATIONS = 400  # of ADMM; a program that needs more is DAQP's
STEP_SIZE = 10.0  # ADMM's rho; solves 174 of 178 programs of the recorded world closing_doors
CHECKED_EVERY = 5  # iterations, between two tests of the tolerance
NEVER = 1e9  # s, a time limit would make answers depend on the machine


class QuadraticProgram(NamedTuple):
    """Minimise 1/2 x.(hessian x) + linear.x with lower <= (matrix x, x) <= upper."""

    hessian: Array  #: (C,) diagonal, > 0
    linear: Array  #: (C,)
    matrix: Array  #: (R, C) rows of unit length; rows not in use are 0
    lower: Array  #: (R + C,) of the rows, then of x; -UNBOUNDED: no limit
    upper: Array  #: (R + C,)
    start: Array  #: (C,) where to begin


class Solution(NamedTuple):
    """What a solver found."""

    x: Array  #: (C,)
    solved: bool


class _Structure:
    """An OSQP instance for programs of one size, whose matrix has entries in given places."""

    def __init__(self, pattern: Array) -> None:
        rows, columns = pattern.shape
        whole = np.vstack([pattern, np.eye(columns)])
        matrix = scipy.sparse.csc_matrix(whole)
        matrix.sort_indices()
        column = np.repeat(np.arange(columns), np.diff(matrix.indptr))
        self._of_rows = np.flatnonzero(matrix.indices < rows)
        self._source = matrix.indices[self._of_rows] * columns + column[self._of_rows]
        self._data = np.ones(matrix.nnz)
        self._no_multipliers = np.zeros(rows + columns)
        self._solver = osqp.OSQP()
        self._solver.setup(
            scipy.sparse.csc_matrix(np.eye(columns)),
            np.zeros(columns),
            matrix,
            np.full(rows + columns, -UNBOUNDED),
            np.full(rows + columns, UNBOUNDED),
            verbose=False,
            rho=STEP_SIZE,
            sigma=1e-6,
            alpha=1.6,
            scaling=0,
            adaptive_rho=False,
            polishing=False,
            eps_abs=PRIMAL_TOLERANCE,
            eps_rel=0.0,
            check_termination=CHECKED_EVERY,
            max_iter=MAX_ITERATIONS,
            time_limit=NEVER,
        )

    def solve(self, program: QuadraticProgram) -> Solution:
        self._data[self._of_rows] = program.matrix.ravel()[self._source]
        self._solver.update(
            q=program.linear, l=program.lower, u=program.upper, Px=program.hessian, Ax=self._data
        )
        self._solver.warm_start(x=program.start, y=self._no_multipliers)
        result = self._solver.solve(raise_error=False)
        return Solution(result.x, result.info.status_val == osqp.SolverStatus.OSQP_SOLVED)


@functools.lru_cache(maxsize=64)
def _structure(n: int, m: int) -> _Structure:
    return _Structure(pattern_of(n, m))


@functools.lru_cache(maxsize=64)
def pattern_of(n: int, m: int) -> Array:
    """Mark by 1 where the matrix of ``n`` robots with ``m`` own rows each may have entries.

    Own rows come first, robot by robot, then those of pairs (0, 1), (0, 2) ...; columns are
    two inputs a robot, then the slack.
    """
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    pattern = np.zeros((n * m + len(pairs), 2 * n + 1))
    pattern[:, 2 * n] = 1.0
    for i in range(n):
        pattern[i * m : (i + 1) * m, 2 * i : 2 * i + 2] = 1.0
    for row, pair in enumerate(pairs, start=n * m):
        for i in pair:
            pattern[row, 2 * i : 2 * i + 2] = 1.0
    return pattern


def solve_by_osqp(program: QuadraticProgram, n: int, m: int) -> Solution:
    """Solve by OSQP; the matrix must have the shape and entries of :func:`pattern_of`."""
    return _structure(n, m).solve(program)


def solve_by_daqp(program: QuadraticProgram) -> Solution:
    """Solve by DAQP: exact, with an active set."""
    count = len(program.matrix)
    used = np.flatnonzero(program.lower[:count] > -UNBOUNDED)
    order = np.concatenate((np.arange(count, len(program.lower)), used))  # limits come first
    x, _, flag, _ = daqp.solve(
        np.diag(program.hessian),
        program.linear,
        program.matrix[used],
        program.upper[order],
        program.lower[order],
        np.zeros(len(order), dtype=np.int32),
    )
    return Solution(x, flag > 0)
