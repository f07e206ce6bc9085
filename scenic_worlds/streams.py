"""Task streams of random deliveries, bound to the program's floor.

A stream is a list of as many tuples as a scene may have tasks at most. Scenic programs cannot
loop over random counts, so the last entry of a tuple switches its task off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

from scenic.core.distributions import DiscreteRange, Options, Range

from mrta_falsify.core.errors import WorldError
from scenic_worlds.lifted import lifted
from scenic_worlds.random_places import (
    longest_approach,
    pick_other_room,
    pick_room,
    travel_time,
)

#: arrival, start, end, deadline, pick-up time, drop-off time, active[, robot]; may be random
TaskEntry = tuple[Any, ...]
#: a number, or the limits it is drawn between
Span = Any


class Streams:
    """Makes task streams for one floor.

    Rooms are numbers or names; None stands for a random room. A *span* is a number, fixed or
    random, or a pair of limits that it is drawn between for each task.

    Args:
        places: of the floor, fixed or random.
        varies: the floor is another one in each scene.
    """

    def __init__(self, places: Any, *, varies: bool) -> None:
        self._places = places
        self._varies = varies

    def any_room(self) -> Any:
        """A random room's number."""
        if self._varies:
            return pick_room(self._places, Range(0, 1))
        return DiscreteRange(0, len(self._places.layout.rooms) - 1)

    def another_room(self, place: Any) -> Any:
        """A random room's number, never that of ``place``."""
        return pick_other_room(self._places, place, Range(0, 1))

    def delivery(
        self,
        arrival: Any,
        start: Any = None,
        end: Any = None,
        slack: Span = (150, 300),
        service: Span = 0,
        active: Any = True,
        robot: Any = "",
    ) -> TaskEntry:
        """One task.

        Args:
            arrival: when the dispatcher learns of it [s].
            start: room of the pick-up.
            end: room of the drop-off; a random one is never ``start``.
            slack: from arrival to deadline [s].
            service: that picking up and dropping off take [s].
            active: False leaves the task out of the world.
            robot: the only robot that may serve it, by name or as an object; any if empty.
        """
        first, last = self._rooms(start, end)
        at_start, at_end = _span(service), _span(service)
        entry = (arrival, first, last, arrival + _span(slack), at_start, at_end, active)
        return entry if isinstance(robot, str) and not robot else (*entry, robot)

    def for_robot(self, robot: Any, tasks: Sequence[TaskEntry]) -> list[TaskEntry]:
        """``tasks``, to be served by ``robot`` alone: its name, or the object itself."""
        defaults = (0.0, 0.0, True)
        return [(*(*task, *defaults[len(task) - 4 :])[:7], robot) for task in tasks]

    def burst(
        self,
        count: int,
        begin: Any = 0,
        within: Any = 10,
        start: Any = None,
        end: Any = None,
        slack: Span = (150, 300),
        service: Span = 0,
    ) -> list[TaskEntry]:
        """``count`` tasks that arrive between ``begin`` and ``begin + within`` [s]."""
        return [
            self.delivery(begin + Range(0, within), start, end, slack, service)
            for _ in range(count)
        ]

    def poisson(
        self,
        rate: Any,
        between: tuple[Any, Any] = (0, 600),
        most: int = 12,
        start: Any = None,
        end: Any = None,
        slack: Span = (150, 300),
        service: Span = 0,
    ) -> list[TaskEntry]:
        """Tasks that arrive as a Poisson process of ``rate`` [1/s] in a time window [s].

        At most ``most`` tasks come; those that would arrive after the window are left out.
        """
        tasks, arrival = [], between[0]
        for _ in range(most):
            arrival = arrival + exponential(rate, Range(0, 1))
            active = arrives_before(arrival, between[1])
            tasks.append(self.delivery(arrival, start, end, slack, service, active))
        return tasks

    def rush_hour(
        self,
        base: Any,
        peak: Any,
        peak_between: tuple[Any, Any] = (200, 400),
        between: tuple[Any, Any] = (0, 600),
        most: int = 12,
        start: Any = None,
        end: Any = None,
        slack: Span = (150, 300),
        service: Span = 0,
    ) -> list[TaskEntry]:
        """Tasks that arrive as a Poisson process whose rate is higher for a time.

        At most ``most`` tasks come; those that would arrive after the window are left out.

        Args:
            base: rate outside the rush hour [1/s], >= 0.
            peak: rate in it [1/s], >= 0.
            peak_between: when it begins and ends [s].
            between: of the whole stream [s].
            most: tasks at most.
            start: room of the pick-ups.
            end: room of the drop-offs.
            slack: from arrival to deadline [s].
            service: that picking up and dropping off take [s].
        """
        tasks, load = [], 0.0
        for _ in range(most):
            load = load + exponential(1.0, Range(0, 1))
            arrival = rush_arrival(load, base, peak, *peak_between, *between)
            active = arrives_before(arrival, between[1])
            tasks.append(self.delivery(arrival, start, end, slack, service, active))
        return tasks

    def hot_room(
        self,
        place: Any,
        count: int,
        between: Span = (0, 300),
        slack: Span = (200, 400),
        share: float = 1.0,
        service: Span = 0,
    ) -> list[TaskEntry]:
        """``count`` tasks to one room.

        With ``share`` below 1, a task goes to any room with the rest of the probability.
        """
        tasks = []
        for _ in range(count):
            end = place if share >= 1 else Options({place: share, self.any_room(): 1 - share})
            start = self.another_room(end)
            tasks.append(self.delivery(_span(between), start, end, slack, service))
        return tasks

    def tight_deadlines(
        self,
        count: int,
        between: Span = (0, 300),
        factor: Span = (1.1, 1.6),
        start: Any = None,
        end: Any = None,
        service: Span = 0,
    ) -> list[TaskEntry]:
        """``count`` tasks with deadlines close to what one robot needs.

        What it needs is the layout's travel time from the room farthest from the start, by
        the start, to the end, plus service; ``factor`` scales it.
        """
        tasks: list[TaskEntry] = []
        for _ in range(count):
            arrival = _span(between)
            first, last = self._rooms(start, end)
            at_start, at_end = _span(service), _span(service)
            way = longest_approach(self._places, first) + travel_time(self._places, first, last)
            deadline = arrival + _span(factor) * (way + at_start + at_end)
            tasks.append((arrival, first, last, deadline, at_start, at_end, True))
        return tasks

    def _rooms(self, start: Any, end: Any) -> tuple[Any, Any]:
        if start is None:
            start = self.any_room() if end is None else self.another_room(end)
        return start, self.another_room(start) if end is None else end


def _span(limits: Span) -> Any:
    return Range(limits[0], limits[1]) if isinstance(limits, (tuple, list)) else limits


@lifted
def exponential(rate: float, share: float) -> float:
    """Compute the waiting time [s] of a Poisson process at quantile ``share`` in [0, 1).

    Raises:
        WorldError: the rate is not positive.
    """
    if rate <= 0.0:
        raise WorldError(f"poisson: rate is {rate:g}; it must be > 0 tasks per second")
    return -math.log1p(-min(float(share), 1.0 - 1e-12)) / float(rate)


@lifted
def rush_arrival(
    load: float,
    base: float,
    peak: float,
    peak_begin: float,
    peak_end: float,
    begin: float,
    end: float,
) -> float:
    """Find when so many tasks are expected to have come; ``end`` if that is later.

    Args:
        load: expected number of tasks since ``begin``.
        base: rate outside the rush hour [1/s].
        peak: rate in it [1/s].
        peak_begin: of the rush hour [s].
        peak_end: of it [s].
        begin: of the stream [s].
        end: of it [s].

    Raises:
        WorldError: a rate is negative, or an interval ends before it begins.
    """
    for name, rate in (("base", base), ("peak", peak)):
        if rate < 0.0:
            raise WorldError(f"rush_hour: {name} is {rate:g}; it must be >= 0 tasks per second")
    for name, (first, last) in {
        "peak_between": (peak_begin, peak_end),
        "between": (begin, end),
    }.items():
        if last < first:
            raise WorldError(
                f"rush_hour: {name} is ({first:g}, {last:g}); its end must not be before its begin"
            )
    borders = [min(max(time, begin), end) for time in (begin, peak_begin, peak_end, end)]
    rates = (base, peak, base)
    for (since, until), rate in zip(itertools.pairwise(borders), rates, strict=True):
        expected = rate * (until - since)
        if load < expected:
            return float(since + load / rate)
        load -= expected
    return float(end)


@lifted
def arrives_before(arrival: float, until: float) -> bool:
    """Whether a task is part of the world."""
    return bool(arrival < until)
