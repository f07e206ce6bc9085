"""A multi-robot TSP with timed partial order, solved by OR-Tools routing.

This is what SPECLESS offers, and an example of a user's own solver: it knows an order
(pickup before drop, by one robot) and time windows, but neither capacities nor loads on board
nor arrivals. What it leaves out is added behind it: a robot that is full drops the load
with the nearest deadline first. The search stops after a number of solutions, not after a
time, so the answer is the same on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem, OpenTask, Stop
from mrta_falsify.core.codec import quantity
from mrta_falsify.stack.allocation.timing import (
    append_only,
    dropoff_of,
    pickup_of,
    timed_allocation,
    with_kept_plans,
    without_fleet,
)

LATE_COST = 1_000  # per second that a drop comes after its deadline
HORIZON = 10_000_000  # s


class Tsp:
    """Tours of all robots that respect order and windows, with the least work."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How long is searched."""

        solutions: int = quantity(low=1, high=10_000, default=30)  #: improving ones

    def __init__(self, options: Options) -> None:
        self._options = options

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """See :class:`~mrta_falsify.core.protocols.Allocator`."""
        if not problem.robots:
            return without_fleet(problem)
        if problem.commitment == "keep":
            return with_kept_plans(problem, self.allocate(append_only(problem)))
        carried = {number for plan in problem.robots for number in plan.onboard}
        fresh = [task for task in problem.tasks if task.number not in carried]
        tours = self._tours(problem, fresh) if fresh else [[] for _ in problem.robots]
        if tours is None:
            routes = [_unload(problem, r, []) for r in range(len(problem.robots))]
            return timed_allocation(problem, routes, reason="the TSP solver found no tours")
        return timed_allocation(
            problem, [_unload(problem, r, tour) for r, tour in enumerate(tours)]
        )

    def _tours(self, problem: AllocationProblem, tasks: list[OpenTask]) -> list[list[Stop]] | None:
        """Stops per robot in the order of the TSP's solution, None if it has none."""
        from ortools.constraint_solver import (  # noqa: PLC0415 - 0.4 s; rarely used
            pywrapcp,
            routing_enums_pb2,
        )

        stops = [stop for task in tasks for stop in (pickup_of(task), dropoff_of(task))]
        n = len(problem.robots)
        rooms = [plan.room for plan in problem.robots] + [stop.room for stop in stops]
        service = [0] * n + [
            round(time) for task in tasks for time in (task.pickup_time, task.dropoff_time)
        ]
        numbers = [plan.robot for plan in problem.robots]
        home = len(rooms)  # routes are open: going there costs nothing
        manager = pywrapcp.RoutingIndexManager(home + 1, n, list(range(n)), [home] * n)
        routing = pywrapcp.RoutingModel(manager)

        def seconds(i: int, j: int) -> int:
            a, b = manager.IndexToNode(i), manager.IndexToNode(j)
            if home in (a, b):
                return 0
            travel = round(float(problem.travel_times[rooms[a], rooms[b]]))
            return travel + int(service[b])

        cost = routing.RegisterTransitCallback(seconds)
        routing.SetArcCostEvaluatorOfAllVehicles(cost)
        routing.AddDimension(cost, HORIZON, HORIZON, False, "time")
        time = routing.GetDimensionOrDie("time")
        for r, plan in enumerate(problem.robots):
            time.CumulVar(routing.Start(r)).SetMin(round(max(plan.free_at, problem.now)))
        for i, task in enumerate(tasks):
            pick, drop = (manager.NodeToIndex(n + 2 * i + side) for side in (0, 1))
            routing.AddPickupAndDelivery(pick, drop)
            solver = routing.solver()
            solver.Add(routing.VehicleVar(pick) == routing.VehicleVar(drop))
            solver.Add(time.CumulVar(pick) <= time.CumulVar(drop))
            if task.robot >= 0:
                solver.Add(routing.VehicleVar(pick) == numbers.index(task.robot))
            time.SetCumulVarSoftUpperBound(drop, max(0, round(task.deadline)), LATE_COST)
            routing.AddVariableMinimizedByFinalizer(time.CumulVar(drop))
        how = pywrapcp.DefaultRoutingSearchParameters()
        first = routing_enums_pb2.FirstSolutionStrategy
        how.first_solution_strategy = first.PARALLEL_CHEAPEST_INSERTION
        how.solution_limit = self._options.solutions
        found = routing.SolveWithParameters(how)
        if found is None:
            return None
        tours: list[list[Stop]] = []
        for r in range(n):
            tour, index = [], found.Value(routing.NextVar(routing.Start(r)))
            while not routing.IsEnd(index):
                tour.append(stops[manager.IndexToNode(index) - n])
                index = found.Value(routing.NextVar(index))
            tours.append(tour)
        return tours


def _unload(problem: AllocationProblem, r: int, tour: list[Stop]) -> list[Stop]:
    """``tour`` with the drops that capacity and loads on board ask for moved forward."""
    tasks = {task.number: task for task in problem.tasks}
    plan = problem.robots[r]
    load = {number for number in plan.onboard if number in tasks}
    stops: list[Stop] = []
    for stop in tour:
        if stop.action == "dropoff":
            if stop.task in load:
                stops.append(stop)
                load.remove(stop.task)
            continue
        while len(load) >= plan.capacity:
            stops.append(_drop_first(load, tasks))
        stops.append(stop)
        load.add(stop.task)
    while load:
        stops.append(_drop_first(load, tasks))
    return stops


def _drop_first(load: set[int], tasks: dict[int, OpenTask]) -> Stop:
    """Drop of the load with the nearest deadline, which leaves ``load``."""
    number = min(load, key=lambda number: (tasks[number].deadline, number))
    load.remove(number)
    return dropoff_of(tasks[number])
