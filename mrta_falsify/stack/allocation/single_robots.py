"""What single robots can do: which sets of tasks each can serve in time, and in which order.

Answers of :func:`search_route` are remembered per set and kind of robot.
"""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.allocation_problem import AllocationProblem, Stop
from mrta_falsify.core.arrays import BoolArray, IntArray
from mrta_falsify.stack.allocation.route_search import (
    CUT_OFF,
    FEASIBLE,
    INFEASIBLE,
    MAX_TASKS,
    Jobs,
    Starts,
    clashing_pairs,
    feasible_sets,
    search_route,
)

Bits = int  # a set of tasks, one bit each

MAX_SETS = 400_000  # sets looked at for the list of all largest ones
MAX_BITS = 62  # tasks of such a set


class LimitReachedError(Exception):
    """The node limit ended the search without an answer."""


class SingleRobots:
    """The robots of a problem, each on its own.

    Tasks are named by their position in ``problem.tasks``, robots by theirs.
    """

    def __init__(self, problem: AllocationProblem, node_limit: int) -> None:
        """Take in a problem; old plans do not matter.

        Args:
            problem: what is to be decided.
            node_limit: nodes of route searches.
        """
        self._problem = problem
        self.nodes_left = node_limit
        tasks, robots = problem.tasks, problem.robots
        self.m, self.n = len(tasks), len(robots)
        position = {task.number: k for k, task in enumerate(tasks)}
        self._jobs = Jobs(
            start=np.array([task.start for task in tasks], np.int64),
            end=np.array([task.end for task in tasks], np.int64),
            load=np.array([task.pickup_time for task in tasks], np.float64),
            unload=np.array([task.dropoff_time for task in tasks], np.float64),
            release=np.array([task.arrival for task in tasks], np.float64),
            due=np.array([task.deadline for task in tasks], np.float64),
        )
        self._starts = Starts(
            room=np.array([plan.room for plan in robots], np.int64),
            time=np.array([max(plan.free_at, problem.now) for plan in robots], np.float64),
            capacity=np.array([plan.capacity for plan in robots], np.int64),
        )
        self._travel = np.ascontiguousarray(problem.travel_times, dtype=np.float64)
        self.onboard = [tuple(sorted(position[k] for k in plan.onboard)) for plan in robots]
        self.carrier = {k: r for r, carried in enumerate(self.onboard) for k in carried}
        numbers = {plan.robot: r for r, plan in enumerate(robots)}
        named = {k: numbers[task.robot] for k, task in enumerate(tasks) if task.robot >= 0}
        #: robot by task, where only one robot may serve it: it carries it, or is named
        self.only = {**named, **self.carrier}
        self.kind = self._kinds()
        self._by_due = sorted(range(self.m), key=lambda k: (tasks[k].deadline, k))
        self._known: dict[tuple[int, Bits], bool] = {}

    def _kinds(self) -> list[int]:
        """Robots that cannot be told apart share a number: their first one's."""
        seen: dict[object, int] = {}
        s, apart = self._starts, set(self.only.values())
        return [
            seen.setdefault(
                (
                    s.room[r],
                    s.time[r],
                    s.capacity[r],
                    self.onboard[r],
                    r if r in apart else -1,
                ),
                r,
            )
            for r in range(self.n)
        ]

    def twins(self, kind: int) -> list[int]:
        """Robots of a kind."""
        return [r for r in range(self.n) if self.kind[r] == kind]

    def alone(self) -> BoolArray:
        """Whether each robot can serve each task in time if it serves no other, ``(n, m)``."""
        jobs, starts = self._jobs, self._starts
        # Summed as the route search does: else the last bit could make a plan of its impossible.
        picked = np.maximum(starts.time[:, None], jobs.release)
        picked = picked + self._travel[np.ix_(starts.room, jobs.start)]
        picked = picked + jobs.load
        able = (picked + self._travel[jobs.start, jobs.end]) + jobs.unload <= jobs.due
        able &= starts.capacity[:, None] > 0
        for r in range(self.n):
            for k in range(self.m):
                if self.only.get(k, r) != r:
                    able[r, k] = False
                elif self.onboard[r]:
                    able[r, k] = self.accepts(r, 1 << k)
        return able

    def clashing_pairs(self, alone: BoolArray) -> BoolArray:
        """Pairs of tasks that a robot cannot both serve; arguments as of the function."""
        return clashing_pairs(self._travel, self._jobs, self._starts, alone)

    def first_refused(self, r: int, tasks: Bits) -> Bits:
        """A part of ``tasks`` that the robot refuses, 0 if it accepts them all.

        Grown task by task, since small sets are decided quickly.
        """
        part = 0
        for k in self._by_due:
            if tasks >> k & 1:
                part |= 1 << k
                if not self.accepts(r, part):
                    return part
        return 0

    def smallest_refused(self, r: int, tasks: Bits) -> Bits:
        """A part of refused ``tasks`` that is accepted as soon as any one of it is left out."""
        for k in sorted(members(tasks), key=lambda k: (-self._jobs.due[k], k)):
            less = tasks & ~(1 << k)
            if not self.accepts(r, less):
                tasks = less
        return tasks

    def accepts(self, r: int, tasks: Bits) -> bool:
        """Whether robot ``r`` can serve all ``tasks`` in time, and deliver its load some time."""
        key = (self.kind[r], tasks)
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = self._search(r, tasks)[0] == FEASIBLE
        return known

    def _search(self, r: int, tasks: Bits) -> tuple[int, IntArray, IntArray]:
        carried = self.onboard[r]
        fresh = [k for k in members(tasks) if k not in carried]
        chosen = np.array([*fresh, *carried], np.int64)
        state = np.array([0] * len(fresh) + [1] * len(carried), np.int64)
        soft = np.array([not tasks >> int(k) & 1 for k in chosen], np.bool_)
        if len(chosen) > MAX_TASKS:
            raise LimitReachedError
        answer, nodes, order = search_route(
            self._travel, self._jobs, self._starts, r, chosen, state, soft, self.nodes_left
        )
        self.nodes_left -= nodes
        if answer == CUT_OFF:
            raise LimitReachedError
        return answer, chosen, order

    def itinerary(self, r: int, tasks: Bits) -> tuple[Stop, ...]:
        """Stops with which robot ``r`` serves ``tasks`` in time; without times."""
        answer, chosen, order = self._search(r, tasks)
        assert answer != INFEASIBLE
        stops = []
        for x in order:
            task = self._problem.tasks[chosen[x >> 1]]
            if x & 1:
                stops.append(Stop(task=task.number, action="dropoff", room=task.end, time=0.0))
            else:
                stops.append(Stop(task=task.number, action="pickup", room=task.start, time=0.0))
        return tuple(stops)

    def largest_sets(self) -> dict[int, list[Bits]] | None:
        """All largest sets that each kind of robot serves; None if there are too many of them."""
        if self.m > MAX_BITS:
            return None
        sets, looks, able = {}, MAX_SETS, self.alone()
        for kind in sorted(set(self.kind)):
            complete, found, nodes = feasible_sets(
                self._travel,
                self._jobs,
                self._starts,
                kind,
                np.array(self.onboard[kind], np.int64),
                np.flatnonzero(able[kind]),
                looks,
            )
            self.nodes_left -= nodes
            looks -= len(found)
            if not complete or self.nodes_left <= 0:
                return None
            sets[kind] = [int(tasks) for tasks in found]
        return sets


def members(tasks: Bits) -> list[int]:
    """Positions of the tasks in a set, sorted."""
    return [k for k in range(tasks.bit_length()) if tasks >> k & 1]
