"""A faithful SMT allocator in SMrTa's spirit, with z3 (optional extra).

Per robot and action point an integer names the action; uninterpreted functions give room,
change of load and travel time; times follow by equality. Action points are raised until every
robot could serve every task, so that its "infeasible" is a proof, which SMrTa's is not. Effort
is limited by z3's own resource counter, never by time.

Reference: Tuck et al., "SMT-based dynamic multi-robot task allocation" (SMrTa).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem, Infeasible, Stop
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.stack.allocation.exact import without_plans, without_robots
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.timing import (
    append_only,
    dropoff_of,
    pickup_of,
    timed_allocation,
    with_kept_plans,
)

IDLE = -1  # action of a robot that has nothing more to do
FIRST_POINTS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class SmtOptions:
    """How long is searched."""

    resource_limit: int = quantity(low=0, high=4_000_000_000, default=0)  #: of z3; 0: none


class Smt:
    """First plan that an SMT solver finds, or a proof that there is none; no objective."""

    Options = SmtOptions

    def __init__(self, options: SmtOptions) -> None:
        self._options = options
        self._insertion = Insertion(InsertionOptions())

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`.

        Raises:
            ConfigError: z3 is not installed.
        """
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        if not problem.tasks:
            return timed_allocation(problem, [()] * len(problem.robots))
        if not problem.robots:
            return without_robots(problem)
        query = _Query(problem, self._options.resource_limit)
        found = query.solve()
        if isinstance(found, list):
            return timed_allocation(problem, found)
        rest = self._insertion.allocate(without_plans(problem))
        if rest.status == "plan":  # only where the resource limit was reached
            return rest
        if found is None:
            return dataclasses.replace(rest, reason=f"z3 reached its limit; {rest.reason}")
        names = ", ".join(map(str, found))
        reason = f"no plan has tasks {names} in time, with any number of action points"
        return dataclasses.replace(
            rest,
            reason=f"{rest.reason}: {reason}",
            infeasible=Infeasible(core=found, reason=reason, minimal=False),
            least_lost=1,
        )


class _Query:
    """The formula, grown by action points."""

    def __init__(self, problem: AllocationProblem, resource_limit: int) -> None:
        try:
            import z3  # noqa: PLC0415
        except ImportError:
            raise ConfigError(
                "allocator smt needs z3; in the checkout: pip install '.[smt]'"
            ) from None
        self._z3: Any = z3
        self._problem = problem
        self._ctx = z3.Context()  # the default one remembers earlier queries
        self._solver = z3.SolverFor("QF_UFLIA", ctx=self._ctx)
        self._solver.set("ctrl_c", False)  # else z3 takes Ctrl-C for the end of its search
        if resource_limit:
            self._solver.set("rlimit", resource_limit)
        self._m, self._n = len(problem.tasks), len(problem.robots)
        position = {task.number: k for k, task in enumerate(problem.tasks)}
        self._onboard = [[position[k] for k in plan.onboard] for plan in problem.robots]
        self._carrier = {k: i for i, carried in enumerate(self._onboard) for k in carried}
        self._points = 0
        self._variables()
        self._facts()

    def _variables(self) -> None:
        z3 = self._z3
        integer = z3.IntSort(self._ctx)
        self._room = z3.Function("room", integer, integer)
        self._change = z3.Function("change", integer, integer)
        self._service = z3.Function("service", integer, integer)
        self._travel = z3.Function("travel", integer, integer, integer)
        self._action: list[list[Any]] = []
        self._time: list[list[Any]] = []
        self._load: list[list[Any]] = []
        for i, plan in enumerate(self._problem.robots):
            self._action.append([z3.IntVal(-2 - i, self._ctx)])
            free_at = math.ceil(max(plan.free_at, self._problem.now))
            self._time.append([z3.IntVal(free_at, self._ctx)])
            self._load.append([z3.IntVal(len(plan.onboard), self._ctx)])
        tasks = range(self._m)
        self._robot_of = [z3.Int(f"robot{k}", self._ctx) for k in tasks]
        self._pick_at = [z3.Int(f"pick{k}", self._ctx) for k in tasks]
        self._drop_at = [z3.Int(f"drop{k}", self._ctx) for k in tasks]
        self._wanted = [z3.Bool(f"wanted{k}", self._ctx) for k in tasks]

    def _facts(self) -> None:
        problem, add = self._problem, self._solver.add
        rooms = set()
        numbers = [plan.robot for plan in problem.robots]
        for i, plan in enumerate(problem.robots):
            add(self._room(-2 - i) == plan.room)
            rooms.add(plan.room)
        for k, task in enumerate(problem.tasks):
            for action, room, change, service in (
                (2 * k, task.start, 1, task.pickup_time),
                (2 * k + 1, task.end, -1, task.dropoff_time),
            ):
                add(self._room(action) == room, self._change(action) == change)
                add(self._service(action) == math.ceil(service))
                rooms.add(room)
            add(self._robot_of[k] >= 0, self._robot_of[k] < self._n)
            if task.robot >= 0:
                add(self._robot_of[k] == numbers.index(task.robot))
            if k in self._carrier:
                add(self._robot_of[k] == self._carrier[k], self._pick_at[k] == 0)
            else:
                add(self._pick_at[k] >= 1)
                for i in self._too_far(k):
                    add(self._z3.Implies(self._wanted[k], self._robot_of[k] != i))
            add(self._drop_at[k] > self._pick_at[k])
        for a in sorted(rooms):
            for b in sorted(rooms):
                seconds = math.ceil(float(problem.travel_times[a, b]))
                add(self._travel(a, b) == seconds)

    def _too_far(self, k: int) -> list[int]:
        """Robots that miss a deadline even if they go for the task at once."""
        task, travel = self._problem.tasks[k], self._problem.travel_times
        ride = math.ceil(float(travel[task.start, task.end])) + math.ceil(task.dropoff_time)
        far = []
        for i, plan in enumerate(self._problem.robots):
            leaves = math.ceil(max(plan.free_at, self._problem.now, task.arrival))
            picks = leaves + math.ceil(float(travel[plan.room, task.start]))
            if picks + math.ceil(task.pickup_time) + ride > math.floor(task.deadline):
                far.append(i)
        return far

    def _add_point(self) -> None:
        z3, add, problem = self._z3, self._solver.add, self._problem
        self._points += 1
        p = self._points
        for i, plan in enumerate(problem.robots):
            act, time, load = (z3.Int(f"{name}{i}_{p}", self._ctx) for name in ("act", "t", "load"))
            last, before = self._action[i][-1], self._time[i][-1]
            idle = act == IDLE
            add(act >= IDLE, act < 2 * self._m)
            if p > 1:
                add(z3.Implies(last == IDLE, idle))
            legs = self._travel(self._room(last), self._room(act)) + self._service(act)
            leaves = self._leaves(act, before)
            add(z3.Implies(z3.Not(idle), time == leaves + legs))
            add(z3.Implies(idle, time == before))
            add(z3.Implies(z3.Not(idle), load == self._load[i][-1] + self._change(act)))
            add(z3.Implies(idle, load == self._load[i][-1]))
            add(load >= 0, load <= plan.capacity)
            for k, task in enumerate(problem.tasks):
                mine = self._robot_of[k] == i
                if k in self._carrier:
                    add(act != 2 * k)
                else:
                    add((act == 2 * k) == z3.And(mine, self._pick_at[k] == p))
                add((act == 2 * k + 1) == z3.And(mine, self._drop_at[k] == p))
                due = math.floor(task.deadline)
                add(z3.Implies(z3.And(self._wanted[k], act == 2 * k + 1), time <= due))
            self._action[i].append(act)
            self._time[i].append(time)
            self._load[i].append(load)

    def _leaves(self, act: Any, before: Any) -> Any:
        """When a leg starts: not before the task of its pickup has arrived."""
        leaves = before
        for k, task in enumerate(self._problem.tasks):
            arrival = math.ceil(task.arrival)
            if arrival > self._problem.now and k not in self._carrier:
                waits = self._z3.And(act == 2 * k, before < arrival)
                leaves = self._z3.If(waits, arrival, leaves)
        return leaves

    def solve(self) -> list[list[Stop]] | tuple[int, ...] | None:
        """Stops per robot; or the numbers of tasks that no plan has in time; or None."""
        z3 = self._z3
        complete = 2 * self._m
        points = min(complete, max(FIRST_POINTS, 2 * math.ceil(self._m / self._n)))
        while True:
            while self._points < points:
                self._add_point()
            within = z3.Bool(f"within{points}", self._ctx)
            self._solver.add(z3.Implies(within, z3.And(*(d <= points for d in self._drop_at))))
            answer = self._solver.check(within, *self._wanted)
            if answer == z3.sat:
                return self._plan()
            if answer != z3.unsat:
                return None
            failed = {str(literal) for literal in self._solver.unsat_core()}
            if str(within) not in failed or points >= complete:
                core = [k for k in range(self._m) if str(self._wanted[k]) in failed]
                return tuple(sorted(self._problem.tasks[k].number for k in core))
            points = min(complete, points + 2)

    def _plan(self) -> list[list[Stop]]:
        model = self._solver.model()
        routes = []
        for actions in self._action:
            route = []
            for action in actions[1:]:
                value = model.eval(action, model_completion=True).as_long()
                if value != IDLE:
                    task = self._problem.tasks[value >> 1]
                    route.append(dropoff_of(task) if value & 1 else pickup_of(task))
            routes.append(route)
        return routes
