"""Routes of a whole fleet as arrays, that live on from batch to batch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mrta_falsify.core.allocation_problem import (
    Allocation,
    AllocationProblem,
    Commitment,
    OpenTask,
    RobotPlan,
    Stop,
)
from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.stack.allocation.route_kernels import (
    FREE,
    GONE,
    NODE,
    NONE,
    TASK,
    Routes,
    Weights,
    refresh,
)
from mrta_falsify.stack.allocation.ruin_and_recreate import (
    board,
    commit_until,
    link_last,
    relieve,
    strip_route,
)

COMPLETION = Weights(completion=1.0, travel=0.0, makespan=0.0, own=0.0)


def _empty_routes(travel: Array, capacity: IntArray, m: int) -> Routes:
    node, task = np.zeros(len(capacity) + 2 * m, NODE), np.zeros(m, TASK)
    for field in ("latest", "due"):
        node[field] = np.inf
    for field in ("after", "before"):
        node[field] = NONE
    task["owner"], task["only"] = GONE, FREE
    return Routes(travel=travel, capacity=capacity, node=node, task=task)


class RouteTable:
    """The fleet's routes: who serves which open task, in which order, and when.

    Tasks have an index k in the order in which they were added, and the number of
    their :class:`OpenTask`.
    """

    def __init__(
        self, travel_times: Array, rooms: Sequence[int], capacities: Sequence[int], *, room_for: int
    ) -> None:
        """Idle robots, free at time 0.

        Args:
            travel_times: ``(R, R)`` [s], closed under shortest paths.
            rooms: room number per robot.
            capacities: per robot.
            room_for: tasks that fit before the arrays have to grow.
        """
        self.n = len(rooms)
        travel = np.ascontiguousarray(travel_times, dtype=np.float64)
        self.w = _empty_routes(travel, np.array(capacities, np.int64), max(1, room_for))
        self.w.node["room"][: self.n] = rooms
        self.tasks: list[OpenTask] = []
        self.index: dict[int, int] = {}
        self._position = {robot: robot for robot in range(self.n)}  # of a robot, by its number
        self._log = self._empty_log(max(1, room_for))
        self._logged = 0

    # --- from and to the values of the protocol ------------------------------------------

    @classmethod
    def of(cls, problem: AllocationProblem) -> RouteTable:
        """Table of a ``free`` problem; the old plans are kept as far as they can be driven."""
        table = cls(
            problem.travel_times,
            [plan.room for plan in problem.robots],
            [plan.capacity for plan in problem.robots],
            room_for=len(problem.tasks),
        )
        table._position = {plan.robot: r for r, plan in enumerate(problem.robots)}
        table.add(problem.tasks)
        w = table.w
        for r, plan in enumerate(problem.robots):
            w.node["time"][r] = max(plan.free_at, problem.now)
            w.node["load"][r] = len(plan.onboard)
            for number in plan.onboard:
                w.task["aboard"][table.index[number]] = 1
        for r, plan in enumerate(problem.robots):
            table.load_route(r, plan.planned, plan.onboard)
        return table

    def load_route(self, r: int, stops: Sequence[Stop], onboard: Iterable[int]) -> None:
        """Set the route of robot ``r``; stops that make no sense are left out.

        Args:
            r: robot.
            stops: in order; times are ignored.
            onboard: numbers of the tasks it carries; drops that are missing are added.
        """
        w, n = self.w, self.n
        owner, aboard = w.task["owner"], w.task["aboard"]
        carried = {self.index[number] for number in onboard}
        picked: set[int] = set()
        visits: list[int] = []

        def allows(k: int) -> bool:
            return bool(w.task["only"][k] in (FREE, r))

        for stop in stops:
            k = self.index.get(stop.task, NONE)
            if k == NONE:
                continue
            if stop.action == "pickup" and owner[k] == FREE and aboard[k] == 0 and allows(k):
                picked.add(k)
                visits.append(n + 2 * k)
                owner[k] = r
            elif stop.action == "dropoff" and k in picked | carried:
                picked.discard(k)
                carried.discard(k)
                visits.append(n + 2 * k + 1)
                owner[k] = r
        for k in sorted(picked):  # a pickup whose drop the old plan does not have
            visits.remove(n + 2 * k)
            owner[k] = FREE
        for x in visits:
            link_last(w, x, r)
        refresh(w, r)
        if visits and w.node["load"][visits].max() > w.capacity[r]:
            strip_route(w, r)
        missing = sorted(carried, key=lambda k: (self.tasks[k].deadline, k))
        for k in missing:
            board(w, k, r, COMPLETION)

    def problem(
        self, now: float, *, commitment: Commitment = "free", names: Sequence[int] | None = None
    ) -> AllocationProblem:
        """What is not committed, as a problem.

        Args:
            now: [s].
            commitment: of the problem.
            names: robot numbers, by default their positions.
        """
        w, n = self.w, self.n
        owner, aboard = w.task["owner"].tolist(), w.task["aboard"].tolist()
        carried: list[list[int]] = [[] for _ in range(n)]
        open_tasks = []
        for k, task in enumerate(self.tasks):
            if owner[k] == GONE:
                continue
            open_tasks.append(task)
            if aboard[k]:
                carried[owner[k]].append(task.number)
        robots = tuple(
            RobotPlan(
                robot=names[r] if names is not None else r,
                room=int(w.node["room"][r]),
                free_at=float(w.node["time"][r]),
                onboard=tuple(sorted(carried[r])),
                capacity=int(w.capacity[r]),
                planned=self.stops(r),
            )
            for r in range(n)
        )
        return AllocationProblem(
            now=now,
            robots=robots,
            tasks=tuple(open_tasks),
            travel_times=w.travel,
            commitment=commitment,
        )

    def adopt(self, answer: Allocation) -> None:
        """Take the itineraries of an answer to :meth:`problem` as the routes."""
        w, n = self.w, self.n
        w.node["due"][n + 1 : n + 2 * len(self.tasks) : 2] = [task.deadline for task in self.tasks]
        for number in answer.late:
            w.node["due"][n + 2 * self.index[number] + 1] = np.inf
        self.reload(answer.itineraries)

    def reload(self, itineraries: Sequence[Sequence[Stop]]) -> None:
        """Replace all routes; tasks in none of them are pending, times are worked out anew."""
        w = self.w
        owner, aboard = w.task["owner"], w.task["aboard"]
        carried = [np.flatnonzero((owner == r) & (aboard == 1)) for r in range(self.n)]
        owner[owner != GONE] = FREE
        w.node["after"][:] = NONE
        w.node["before"][:] = NONE
        for r, stops in enumerate(itineraries):
            self.load_route(r, stops, [self.tasks[k].number for k in carried[r]])

    def stops(self, r: int) -> tuple[Stop, ...]:
        """Itinerary of robot ``r``."""
        after, time = self.w.node["after"], self.w.node["time"]
        found = []
        x = int(after[r])
        while x != NONE:
            found.append(self._stop(x, float(time[x])))
            x = int(after[x])
        return tuple(found)

    def _stop(self, x: int, time: float) -> Stop:
        task = self.tasks[(x - self.n) >> 1]
        if (x - self.n) & 1:
            return Stop(task=task.number, action="dropoff", room=task.end, time=time)
        return Stop(task=task.number, action="pickup", room=task.start, time=time)

    # --- changes ----------------------------------------------------------------------------

    def add(self, tasks: Sequence[OpenTask]) -> IntArray:
        """Take in tasks that no robot has yet, and return their indices."""
        first, count = len(self.tasks), len(tasks)
        if first + count > len(self.w.task):
            self._grow(max(first + count, 2 * first))
        node = self.w.node[self.n + 2 * first : self.n + 2 * (first + count)]
        room, service, release, due = (
            node[field] for field in ("room", "service", "release", "due")
        )
        for i, task in enumerate(tasks):
            pick, drop = 2 * i, 2 * i + 1
            room[pick], room[drop] = task.start, task.end
            service[pick], service[drop] = task.pickup_time, task.dropoff_time
            release[pick], due[drop] = task.arrival, task.deadline
            self.index[task.number] = first + i
            self.w.task["only"][first + i] = self._position.get(task.robot, FREE)
        self.w.task["owner"][first : first + count] = FREE
        self.tasks.extend(tasks)
        return np.arange(first, first + count)

    def pending(self) -> IntArray:
        """Indices of the tasks that no robot has."""
        return np.flatnonzero(self.w.task["owner"] == FREE)

    def commit(self, now: float) -> None:
        """Move on to time ``now`` [s]: what has begun cannot be changed any more."""
        if (self.w.node["time"][: self.n] >= now).all():
            return  # every robot is committed to be at work then
        self._logged = commit_until(self.w, now, *self._log, self._logged)

    def report(self, r: int, time: float) -> None:
        """Let the committed part of robot ``r`` end at ``time`` [s], not when it was planned."""
        _, robot, logged = self._log
        mine = np.flatnonzero(robot[: self._logged] == r)
        if len(mine):
            logged[mine[-1]] = time
        self.w.node["time"][r] = time
        refresh(self.w, r)

    def relieve(self, robots: Iterable[int], weights: Weights) -> None:
        """Take what is too late off the routes of ``robots``; it is pending then."""
        time, latest = self.w.node["time"], self.w.node["latest"]
        for r in robots:
            if time[r] > latest[r]:
                relieve(self.w, r, weights)

    def committed(self) -> list[list[Stop]]:
        """Stops that were committed so far, per robot, with their actual times."""
        history: list[list[Stop]] = [[] for _ in range(self.n)]
        node, robot, logged = self._log
        for i in range(self._logged):
            history[robot[i]].append(self._stop(int(node[i]), float(logged[i])))
        return history

    # --- arrays -----------------------------------------------------------------------------

    def copy_of_routes(self) -> Routes:
        """Routes of the same size, to copy into."""
        return Routes._make(array.copy() for array in self.w)

    @staticmethod
    def _empty_log(m: int) -> tuple[IntArray, IntArray, Array]:
        return np.empty(2 * m, np.int64), np.empty(2 * m, np.int64), np.empty(2 * m)

    def _grow(self, m: int) -> None:
        old = self.w
        self.w = _empty_routes(old.travel, old.capacity, m)
        self.w.node[: len(old.node)] = old.node
        self.w.task[: len(old.task)] = old.task
        log = self._empty_log(m)
        for before, now in zip(self._log, log, strict=True):
            now[: self._logged] = before[: self._logged]
        self._log = log
