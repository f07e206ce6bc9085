"""The one door to the solvers of quadratic programs: a program in, a point and a status out.

The answer is a pure function of the program: fixed settings, nothing kept between calls, iteration
limits and no time limits.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from mrta_falsify.core.arrays import Array

UNBOUNDED = 1e30  #: both solvers' infinity
OSQP_TOLERANCE = 2e-5  # of rows of unit length and of inputs [m/s^2, rad/s]
OSQP_ITERATIONS = 400
OSQP_STEP_SIZE = 10.0  # ADMM's rho; solves 174 of 178 programs of the recorded world closing_doors
NEVER = 1e9  # s, a time limit would make answers depend on the machine


class QuadraticProgram(NamedTuple):
    """Minimise 1/2 x.(hessian x) + linear.x with lower <= (x, matrix x) <= upper."""

    hessian: Array  #: (C, C) diagonal, > 0
    linear: Array  #: (C,)
    matrix: Array  #: (R, C) rows of unit length
    lower: Array  #: (C + R,) of x, then of the rows; -UNBOUNDED: no limit
    upper: Array  #: (C + R,)


class Solution(NamedTuple):
    """What a solver found."""

    x: Array  #: (C,)
    solved: bool


def solve_by_daqp(program: QuadraticProgram) -> Solution:
    """Solve by DAQP: exact, by a dual active set (Arnstrom et al., 2022)."""
    sense = np.zeros(len(program.lower), dtype=np.int32)
    x, _, flag, _ = daqp.solve(
        program.hessian, program.linear, program.matrix, program.upper, program.lower, sense
    )
    return Solution(x, flag > 0)


def solve_by_osqp(program: QuadraticProgram) -> Solution:
    """Solve by OSQP: to a tolerance, by splitting (Stellato et al., 2020)."""
    import osqp  # noqa: PLC0415 - takes 0.1 s, and DAQP solves nearly all programs
    import scipy.sparse  # noqa: PLC0415 - as above

    solver = osqp.OSQP()
    solver.setup(
        scipy.sparse.csc_matrix(program.hessian),
        program.linear,
        scipy.sparse.csc_matrix(np.vstack([np.eye(len(program.linear)), program.matrix])),
        program.lower,
        program.upper,
        verbose=False,
        rho=OSQP_STEP_SIZE,
        sigma=1e-6,
        alpha=1.6,
        scaling=0,
        adaptive_rho=False,
        polishing=False,
        eps_abs=OSQP_TOLERANCE,
        eps_rel=0.0,
        check_termination=5,
        max_iter=OSQP_ITERATIONS,
        time_limit=NEVER,
    )
    unconstrained = -program.linear / np.diag(program.hessian)
    solver.warm_start(x=unconstrained, y=np.zeros(len(program.lower)))
    result = solver.solve(raise_error=False)
    return Solution(result.x, result.info.status_val == osqp.SolverStatus.OSQP_SOLVED)
