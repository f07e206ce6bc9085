"""Which tasks can be in time together, as a covering problem over all largest routes.

Where the master of :mod:`proving` would have to count, clauses are a poor proof and a linear
program is a good one: every robot takes one of the largest sets of tasks that it can serve,
and the duals of the relaxation name the tasks that cannot all be covered.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

POSITIVE = 1e-6  # a relaxed number of lost deadlines above this proves that one is lost
NODES = 5_000  # of one integer program


class Covering:
    """All ways to cover tasks by the largest sets of each kind of robot."""

    def __init__(
        self, sets: Sequence[Sequence[int]], robots: Sequence[Sequence[int]], m: int
    ) -> None:
        """Take in the sets.

        Args:
            sets: per kind of robot, its largest sets of tasks as bits.
            robots: per kind, its robots.
            m: number of tasks.
        """
        import scipy.sparse  # noqa: PLC0415 - takes 0.3 s, and most problems do without

        self._kind = np.array([i for i, group in enumerate(sets) for _ in group], np.int64)
        self._sets = [tasks for group in sets for tasks in group]
        self._robots, self._m = robots, m
        rows = [k for tasks in self._sets for k in range(m) if tasks >> k & 1]
        columns = [j for j, tasks in enumerate(self._sets) for _ in range(tasks.bit_count())]
        size = (m, len(self._sets))
        covers = scipy.sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=size)
        self._covers = scipy.sparse.hstack([covers, scipy.sparse.eye(m)]).tocsr()
        members = scipy.sparse.csr_matrix(
            (np.ones(size[1]), (self._kind, np.arange(size[1]))),
            shape=(len(robots), size[1] + m),
        )
        self._uses = members.tocsr()
        self._fleet = np.array([len(group) for group in robots], np.float64)

    def relaxed_core(self, tasks: Sequence[int]) -> list[int]:
        """Some of ``tasks`` that provably cannot all be in time; empty if that is not shown."""
        import scipy.sparse  # noqa: PLC0415 - as above
        from scipy.optimize import linprog  # noqa: PLC0415

        cost = np.zeros(self._covers.shape[1])
        cost[len(self._sets) + np.array(tasks)] = 1.0
        answer = linprog(
            cost,
            A_ub=scipy.sparse.vstack([-self._covers, self._uses]),
            b_ub=np.concatenate([-np.ones(self._m), self._fleet]),
            bounds=(0.0, 1.0),
            method="highs-ds",
        )
        if answer.status != 0 or answer.fun <= POSITIVE:
            return []
        duals = answer.ineqlin.marginals[: self._m]
        return [k for k in tasks if duals[k] < -POSITIVE]

    def best(self, tasks: Collection[int]) -> tuple[list[int] | None, int]:
        """Sets per robot that leave as few of ``tasks`` uncovered as possible.

        Returns:
            Sets as bits by robot, None if the search was cut off; and how many tasks of
            ``tasks`` are certainly left.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - as above

        wanted = np.zeros(self._m, np.bool_)
        wanted[list(tasks)] = True
        cost = np.concatenate([np.zeros(len(self._sets)), wanted.astype(np.float64)])
        answer = milp(
            cost,
            constraints=[
                LinearConstraint(self._covers, lb=np.ones(self._m)),
                LinearConstraint(self._uses, ub=self._fleet),
            ],
            integrality=np.ones(len(cost)),
            bounds=Bounds(0.0, 1.0),
            options={"node_limit": NODES, "mip_rel_gap": 0.0},
        )
        bound = answer.mip_dual_bound if answer.mip_dual_bound is not None else 0.0
        if answer.status != 0:
            return None, int(np.ceil(bound - POSITIVE))
        free = [list(group) for group in self._robots]
        chosen = [0] * sum(len(group) for group in self._robots)
        for j in np.flatnonzero(answer.x[: len(self._sets)] > 0.5):
            chosen[free[self._kind[j]].pop(0)] = self._sets[j]
        return chosen, round(answer.fun)
