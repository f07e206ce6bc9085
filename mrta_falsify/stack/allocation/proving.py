"""Plan or proof: CP-SAT gives tasks to robots, exact single-robot routes refuse.

Logic-based Benders decomposition: CP-SAT chooses a robot for every task; for each robot
:func:`search_route` finds an order or proves that there is none. Then a smallest set of its
tasks that is refused becomes a clause, for all robots that refuse it. When no choice is left,
that is a proof, and the assumptions that failed are a core, made minimal by leaving tasks out.
Where clauses would have to count, each robot takes one of the largest sets that it can serve:
that is one question, with a linear relaxation that counts well.

One worker, a fixed seed, and limits in CP-SAT's deterministic time: the same answer every time.

Reference: Hooker & Ottosson, "Logic-based Benders decomposition", Math. Programming 2003.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.allocation_problem import AllocationProblem, Stop
from mrta_falsify.stack.allocation.single_robots import (
    Bits,
    LimitReachedError,
    SingleRobots,
    members,
)

NODES = 2_500_000  # of a route search that count as one unit of deterministic time
ROUND = 2_000  # nodes that a question costs at least
PATIENCE = 0.05  # deterministic time before largest sets are listed
MAX_ROUNDS = 80  # of one question, likewise
ROUNDING = 1e-6  # of a bound on a whole number


class _ClausesAreSlowError(Exception):
    """A question took more rounds, or more time, than it was given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Why there is no plan: positions of tasks that cannot all be in time."""

    core: tuple[int, ...]
    minimal: bool


class _Core(list[int]):
    """Tasks that cannot all be in time."""


class _Question:
    """A CP-SAT model in which the deadlines of some tasks are kept and the others may be lost."""

    def __init__(self, m: int, *, names_core: bool, **parameters: object) -> None:
        """Begin a model.

        Args:
            m: number of tasks.
            names_core: have CP-SAT name the deadlines that clash; it counts badly then.
            parameters: of CP-SAT.
        """
        from ortools.sat.python import cp_model  # noqa: PLC0415 - 0.4 s; few problems need proof

        self._cp, self._names_core = cp_model, names_core
        self.model: Any = cp_model.CpModel()
        self.lost = [self.model.new_bool_var("") for _ in range(m)]
        self.bound = 0  #: of the last answer: no smaller objective is possible
        self.solver = cp_model.CpSolver()
        for name, value in {
            "num_workers": 1,
            "random_seed": 0,
            "catch_sigint_signal": False,  # else Ctrl-C is taken for the end of the search
            "cp_model_probing_level": 0,
            "symmetry_level": 0,
            **parameters,
        }.items():
            setattr(self.solver.parameters, name, value)

    def ask(self, hard: Sequence[int] | None, effort: float) -> bool | None:
        """Look for a solution that keeps the ``hard`` deadlines, or with as few lost as possible.

        Args:
            hard: tasks; None: any may be lost, as few as possible.
            effort: deterministic time.

        Returns:
            Whether there is one; None if the limit was reached.
        """
        model, lost = self.model, self.lost
        model.clear_assumptions()
        model.clear_objective()
        if hard is not None and self._names_core:
            model.add_assumptions([~lost[k] for k in hard])
        else:
            kept = frozenset(hard or ())
            dear = 1 + len(lost) - len(kept)
            model.minimize(sum(dear * x if k in kept else x for k, x in enumerate(lost)))
        self.solver.parameters.max_deterministic_time = effort
        status = self.solver.solve(model)
        self.bound = 0
        if status == self._cp.INFEASIBLE:
            return False
        if status not in (self._cp.OPTIMAL, self._cp.FEASIBLE):
            return None
        if model.has_objective():
            self.bound = math.ceil(self.solver.best_objective_bound - ROUNDING)
        is_kept = not any(self.holds(lost[k]) for k in hard or ())
        if status == self._cp.FEASIBLE and (hard is None or not is_kept):
            return None
        return is_kept

    @property
    def spent(self) -> float:
        """Deterministic time of the last answer."""
        return float(self.solver.response_proto.deterministic_time)

    def failed(self, hard: Sequence[int] | None) -> _Core:
        """Tasks of ``hard`` that the last answer refused."""
        if not self._names_core:
            return _Core(hard or ())
        position = {variable.index: k for k, variable in enumerate(self.lost)}
        found = self.solver.sufficient_assumptions_for_infeasibility()
        return _Core(sorted(position[i if i >= 0 else -i - 1] for i in found) or hard or ())

    def holds(self, variable: Any) -> bool:
        """Whether a variable is true in the last solution."""
        return bool(self.solver.boolean_value(variable))


class Prover:
    """Searches for a plan that keeps all, or as many as possible, of the deadlines.

    Tasks are named by their position in ``problem.tasks``, robots by theirs.
    """

    def __init__(self, problem: AllocationProblem, node_limit: int) -> None:
        """Take in a ``free`` problem; old plans do not matter.

        Args:
            problem: what is to be decided.
            node_limit: nodes of route searches, and for CP-SAT as many as take as long.
        """
        self._robots = SingleRobots(problem, node_limit)
        self.m, self.n = len(problem.tasks), len(problem.robots)
        self._alone = self._robots.alone()
        self._clauses = _Question(self.m, names_core=True, cp_model_presolve=False)
        #: per task, by robot: that robot serves it in time
        self._has: list[dict[int, Any]] = []
        self._sets_listed = False
        self._sets: _Question | None = None
        self._columns: list[tuple[int, Bits, Any]] = []  #: kind, largest set, whether it is used
        self._bound = 0
        self._build()

    # --- clauses ------------------------------------------------------------------------------

    def _build(self) -> None:
        model = self._clauses.model
        for k in range(self.m):
            able = np.flatnonzero(self._alone[:, k]).tolist()
            self._has.append({r: model.new_bool_var("") for r in able})
            model.add_exactly_one([self._clauses.lost[k], *self._has[k].values()])
        free = self._alone.copy()
        for r in range(self.n):
            if self._robots.onboard[r] or self._robots.kind[r] != r:
                free[r] = False
        free[:, list(self._robots.carrier)] = False
        clash = self._robots.clashing_pairs(free)
        for r, k, j in np.argwhere(np.tril(clash)).tolist():
            for twin in self._robots.twins(r):
                model.add_bool_or([~self._has[k][twin], ~self._has[j][twin]])

    def suggest(self, owner: dict[int, int]) -> None:
        """Let CP-SAT try robot ``owner[k]`` for task ``k`` first."""
        model = self._clauses.model
        for k, variables in enumerate(self._has):
            for r, variable in variables.items():
                model.add_hint(variable, owner.get(k) == r)
            model.add_hint(self._clauses.lost[k], k not in owner)

    def itinerary(self, r: int, tasks: Bits) -> tuple[Stop, ...]:
        """Stops with which robot ``r`` serves ``tasks`` in time; without times."""
        return self._robots.itinerary(r, tasks)

    def _by_clauses(
        self, hard: Sequence[int] | None, *, patience: float, rounds: int
    ) -> list[Bits] | _Core:
        """See :meth:`_solve`.

        Raises:
            LimitReachedError: the limit of nodes was reached.
            _ClausesAreSlowError: it took more ``rounds``, or more deterministic time.
        """
        while True:
            answer = self._ask(self._clauses, hard, patience)
            patience -= self._clauses.spent
            rounds -= 1
            if answer is None or patience <= 0.0 or rounds <= 0:
                raise _ClausesAreSlowError
            if not answer:
                return self._clauses.failed(hard)
            sets = [0] * self.n
            for k, variables in enumerate(self._has):
                for r, variable in variables.items():
                    if self._clauses.holds(variable):
                        sets[r] |= 1 << k
            refused = [(r, self._robots.first_refused(r, sets[r])) for r in range(self.n)]
            for r, tasks in refused:
                if tasks:
                    self._forbid(r, members(self._robots.smallest_refused(r, tasks)))
            if not any(tasks for _, tasks in refused):
                return sets

    def _forbid(self, r: int, tasks: Sequence[int]) -> None:
        """Clauses: these tasks are not served together, for every robot that refuses them."""
        bits = sum(1 << k for k in tasks)
        for kind in sorted(set(self._robots.kind)):
            if kind != self._robots.kind[r]:
                is_able = all(kind in self._has[k] for k in tasks)
                if not is_able or self._robots.accepts(kind, bits):
                    continue
            for twin in self._robots.twins(kind):
                self._clauses.model.add_bool_or([~self._has[k][twin] for k in tasks])

    # --- largest sets -------------------------------------------------------------------------

    def _list_sets(self) -> None:
        """Build the question in which every robot takes one of its largest sets, if it can be."""
        self._sets_listed = True
        found = self._robots.largest_sets()
        if found is None:
            return
        self._sets = _Question(
            self.m, names_core=False, linearization_level=2, add_lp_constraints_lazily=False
        )
        model = self._sets.model
        covers = [[lost] for lost in self._sets.lost]
        for kind, sets in found.items():
            used = [model.new_bool_var("") for _ in sets]
            model.add(sum(used) <= len(self._robots.twins(kind)))
            for tasks, variable in zip(sets, used, strict=True):
                self._columns.append((kind, tasks, variable))
                for k in members(tasks):
                    covers[k].append(variable)
        for options in covers:
            model.add_bool_or(options)

    def _by_sets(self, question: _Question, hard: Sequence[int] | None) -> list[Bits] | _Core:
        """See :meth:`_solve`."""
        answer = self._ask(question, hard, math.inf)
        if answer is None:
            raise LimitReachedError
        if not answer:
            return question.failed(hard)
        chosen = [0] * self.n
        free = {kind: self._robots.twins(kind) for kind in set(self._robots.kind)}
        for kind, tasks, variable in self._columns:
            if question.holds(variable):
                chosen[free[kind].pop()] = tasks
        return chosen

    # --- answers ------------------------------------------------------------------------------

    def _ask(self, question: _Question, hard: Sequence[int] | None, effort: float) -> bool | None:
        left = self._robots.nodes_left
        if left <= 0:
            raise LimitReachedError
        answer = question.ask(hard, min(effort, left / NODES))
        self._robots.nodes_left -= ROUND + int(NODES * question.spent)
        if hard is None:
            self._bound = max(self._bound, question.bound)
        return answer

    def _solve(self, hard: Sequence[int] | None) -> list[Bits] | _Core:
        """Sets of tasks per robot with all of ``hard`` in time, or a part of it that cannot be.

        Args:
            hard: tasks; None: as many of all as can be.

        Raises:
            LimitReachedError: neither was found within the limit.
        """
        if not self._sets_listed:
            try:
                return self._by_clauses(hard, patience=PATIENCE, rounds=MAX_ROUNDS)
            except _ClausesAreSlowError:
                self._list_sets()
        if self._sets is not None:
            return self._by_sets(self._sets, hard)
        try:
            return self._by_clauses(hard, patience=math.inf, rounds=sys.maxsize)
        except _ClausesAreSlowError:
            raise LimitReachedError from None

    def prove(self) -> list[Bits] | Proof:
        """Sets of tasks per robot with which all deadlines are kept, or a minimal core.

        Raises:
            LimitReachedError: neither was found within the limit.
        """
        for k in range(self.m):
            if not self._has[k]:
                return Proof(core=(k,), minimal=True)
        found = self._solve(range(self.m))
        if not isinstance(found, _Core):
            return found
        try:
            return Proof(core=self._minimised(found), minimal=True)
        except LimitReachedError:
            return Proof(core=tuple(found), minimal=False)

    def _minimised(self, core: Sequence[int]) -> tuple[int, ...]:
        needed: list[int] = []
        rest = list(core)
        while rest:
            k = rest.pop()
            found = self._solve(sorted((*needed, *rest)))
            if isinstance(found, _Core):
                failed = set(found)
                rest = [j for j in rest if j in failed]
            else:
                needed.append(k)
        return tuple(sorted(needed))

    def fewest_lost(self) -> tuple[list[Bits] | None, int]:
        """Sets of tasks with as few lost deadlines as possible.

        Returns:
            The sets, or None if the limit was reached; and how many lost deadlines are proved
            to be needed.
        """
        try:
            sets = self._solve(None)
        except LimitReachedError:
            return None, self._bound
        assert not isinstance(sets, _Core), "all deadlines may be lost"
        return sets, self._bound
