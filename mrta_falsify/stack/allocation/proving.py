"""Plan or proof: a SAT master assigns tasks, exact single-robot routes refuse.

Logic-based Benders decomposition: the master chooses a robot for every task; for each robot
:func:`search_route` finds an order or proves that there is none. Then a smallest set of its
tasks that is refused becomes a clause, for all robots that refuse it. When the master has no
choice left, that is a proof, and its failed assumptions are a core, made minimal by leaving
tasks out.

Reference: Hooker & Ottosson, "Logic-based Benders decomposition", Math. Programming 2003.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pysat.card import ITotalizer
from pysat.solvers import Solver

from mrta_falsify.core.allocation_problem import AllocationProblem, Stop
from mrta_falsify.stack.allocation.covering import Covering
from mrta_falsify.stack.allocation.single_robots import (
    Bits,
    LimitReachedError,
    SingleRobots,
    members,
)

CONFLICT = 300  # nodes of a route search that take as long as one conflict of the master
PATIENCE = 400  # conflicts of the master before the covering problem is tried


class _MasterIsSlowError(Exception):
    """The master needs more conflicts than it was given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Why there is no plan: positions of tasks that cannot all be in time."""

    core: tuple[int, ...]
    minimal: bool


class Prover:
    """Searches for a plan that keeps all, or as many as possible, of the deadlines.

    Tasks are named by their position in ``problem.tasks``, robots by theirs.
    """

    def __init__(self, problem: AllocationProblem, node_limit: int) -> None:
        """Take in a ``free`` problem; old plans do not matter.

        Args:
            problem: what is to be decided.
            node_limit: nodes of route searches, and of the master's conflicts as many as take
                as long.
        """
        self._robots = SingleRobots(problem, node_limit)
        self.m, self.n = len(problem.tasks), len(problem.robots)
        self._rounds = 0
        self._covering_tried = False
        self._cover: Covering | None = None
        farthest_first = np.argsort(-self._robots.times_to_pickups().T, axis=1, kind="stable")
        self._rank = np.argsort(farthest_first, axis=1)
        self._solver = Solver(name="glucose4")
        self._build()

    # --- the master -------------------------------------------------------------------------

    def _has(self, k: int, r: int) -> int:
        """Variable: robot r serves task k in time.

        The master sets variables to false in their order, so the nearest robot comes last.
        """
        return 1 + k * self.n + int(self._rank[k, r])

    def _lost(self, k: int) -> int:
        """Variable: the deadline of task k is given up."""
        return 1 + self.m * self.n + k

    def _build(self) -> None:
        alone = np.zeros((self.n, self.m), np.bool_)
        for k in range(self.m):
            only = self._robots.only.get(k)
            for r in range(self.n):
                alone[r, k] = only in (None, r) and self._robots.accepts(r, 1 << k)
            able = [self._has(k, r) for r in range(self.n) if alone[r, k]]
            self._solver.add_clause([self._lost(k), *able])
            for r in range(self.n):
                if not alone[r, k]:
                    self._solver.add_clause([-self._has(k, r)])
        free = alone.copy()
        for r in range(self.n):
            if self._robots.onboard[r] or self._robots.kind[r] != r:
                free[r] = False
        free[:, list(self._robots.carrier)] = False
        clash = self._robots.clashing_pairs(free)
        for r, k, j in zip(*np.nonzero(np.tril(clash)), strict=True):
            for twin in range(self.n):
                if self._robots.kind[twin] == r:
                    self._solver.add_clause([-self._has(int(k), twin), -self._has(int(j), twin)])

    def _routes_of_master(self, assumptions: Sequence[int], budget: int) -> list[Bits] | None:
        """Sets of tasks per robot that no clause forbids; None if there is no choice left."""
        if self._robots.nodes_left <= 0:
            raise LimitReachedError
        before = self._solver.accum_stats()["conflicts"]
        self._solver.conf_budget(max(1, min(self._robots.nodes_left // CONFLICT, budget)))
        found = self._solver.solve_limited(assumptions=list(assumptions))
        conflicts = self._solver.accum_stats()["conflicts"] - before
        self._robots.nodes_left -= 1 + CONFLICT * conflicts
        if found is None and self._robots.nodes_left > 0:
            raise _MasterIsSlowError
        if found is None:
            raise LimitReachedError
        if not found:
            return None
        model = self._solver.get_model()
        sets = [0] * self.n
        for k in range(self.m):
            if model[self._lost(k) - 1] > 0:
                continue
            for r in range(self.n):
                if model[self._has(k, r) - 1] > 0:
                    sets[r] |= 1 << k
                    break
        return sets

    def _solve(self, assumptions: Sequence[int], patience: int | None) -> list[Bits] | None:
        """Sets of tasks that the robots can serve; None if there are none.

        Raises:
            _MasterIsSlowError: it took more than ``patience`` conflicts and rounds.
        """
        stop_at = -1 if patience is None else self._effort() + patience
        while True:
            left = stop_at - self._effort() if patience is not None else self._robots.nodes_left
            if patience is not None and left <= 0:
                raise _MasterIsSlowError
            sets = self._routes_of_master(assumptions, left)
            self._rounds += 1
            if sets is None:
                return None
            clauses = 0
            for r in range(self.n):
                refused = self._robots.first_refused(r, sets[r])
                if refused:
                    self._forbid(r, self._robots.smallest_refused(r, refused))
                    clauses += 1
            if clauses == 0:
                return sets

    def _effort(self) -> int:
        return int(self._solver.accum_stats()["conflicts"]) + 5 * self._rounds

    def _forbid(self, r: int, tasks: Bits) -> None:
        """Clauses: these tasks are not served together, for every robot that refuses them."""
        chosen = members(tasks)
        verdict: dict[int, bool] = {self._robots.kind[r]: False}
        for other in range(self.n):
            kind = self._robots.kind[other]
            if kind not in verdict:
                alien = any(self._robots.only.get(k, other) != other for k in chosen)
                verdict[kind] = alien or self._robots.accepts(other, tasks)
            if not verdict[kind]:
                self._solver.add_clause([-self._has(k, other) for k in chosen])

    def suggest(self, owner: dict[int, int]) -> None:
        """Let the master try robot ``owner[k]`` for task ``k`` first."""
        self._solver.set_phases([self._has(k, r) for k, r in sorted(owner.items())])

    def itinerary(self, r: int, tasks: Bits) -> tuple[Stop, ...]:
        """Stops with which robot ``r`` serves ``tasks`` in time; without times."""
        return self._robots.itinerary(r, tasks)

    # --- the covering problem -----------------------------------------------------------------

    def _covering(self) -> Covering | None:
        """Covering problem over all largest sets; None if there are too many of them."""
        if not self._covering_tried:
            self._covering_tried = True
            self._cover = self._robots.covering()
        return self._cover

    def _decide(self, hard: Sequence[int]) -> list[Bits] | list[int]:
        """Sets of tasks per robot with all of ``hard`` in time, or a part of it that cannot be.

        The two are told apart by :class:`_Core`.
        """
        assumptions = [-self._lost(k) for k in hard]
        try:
            sets = self._solve(assumptions, PATIENCE)
        except _MasterIsSlowError:
            cover = self._covering()
            if cover is not None:
                core = cover.relaxed_core(hard)
                if core:
                    return _Core(core)
                found, lost = cover.best(hard)
                if lost:
                    return _Core(hard)
                if found is not None:
                    return found
            sets = self._solve(assumptions, None)
        return _Core(self._failed()) if sets is None else sets

    # --- answers ------------------------------------------------------------------------------

    def prove(self) -> list[Bits] | Proof:
        """Sets of tasks per robot with which all deadlines are kept, or a minimal core.

        Raises:
            LimitReachedError: neither was found within the limit.
        """
        found = self._decide(range(self.m))
        if not isinstance(found, _Core):
            return found
        try:
            return Proof(core=self._minimised(found), minimal=True)
        except LimitReachedError:
            return Proof(core=tuple(found), minimal=False)

    def _failed(self) -> list[int]:
        """Tasks of the assumptions that failed."""
        first = self._lost(0)
        return sorted(-literal - first for literal in self._solver.get_core() or ())

    def _minimised(self, core: Sequence[int]) -> tuple[int, ...]:
        needed: list[int] = []
        rest = list(core)
        while rest:
            k = rest.pop()
            found = self._decide(sorted((*needed, *rest)))
            if isinstance(found, _Core):
                failed = set(found)
                rest = [j for j in rest if j in failed]
            else:
                needed.append(k)
        return tuple(sorted(needed))

    def fewest_lost(self, at_least: int = 1) -> tuple[list[Bits] | None, int]:
        """Sets of tasks with as few lost deadlines as possible.

        Args:
            at_least: a number of lost deadlines that is known to be needed.

        Returns:
            The sets, or None if the limit was reached; and how many lost deadlines are proved
            to be needed.
        """
        lost = [self._lost(k) for k in range(self.m)]
        bound = at_least
        with ITotalizer(lits=lost, ubound=self.m, top_id=lost[-1]) as count:
            self._solver.append_formula(count.cnf.clauses)
            try:
                while bound < self.m:
                    sets = self._solve([-count.rhs[bound]], PATIENCE)
                    if sets is not None:
                        return sets, bound
                    bound += 1
            except _MasterIsSlowError:
                pass
            except LimitReachedError:
                return None, bound
        if bound == self.m:
            return [0] * self.n, bound
        cover = self._covering() if self._robots.nodes_left > 0 else None
        if cover is None:
            return None, bound
        found, least = cover.best(range(self.m))
        return found, max(bound, least)

    def close(self) -> None:
        """Free the solver."""
        self._solver.delete()


class _Core(list[int]):
    """Tasks that cannot all be in time."""
