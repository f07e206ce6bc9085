"""What dispatcher and allocator exchange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mrta_falsify.core.arrays import Array

Action = Literal["pickup", "dropoff"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """One entry of an itinerary."""

    task: int  #: task number
    action: Action
    room: int  #: room number
    time: float  #: predicted time of the action's end [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenTask:
    """A task that is not yet delivered."""

    number: int
    start: int  #: room number
    end: int  #: room number
    arrival: float  #: [s]
    deadline: float  #: [s], absolute
    pickup_time: float = 0.0  #: service [s]
    dropoff_time: float = 0.0  #: service [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPlan:
    """A robot as the allocator sees it: the committed future, and what may be changed."""

    robot: int  #: robot number
    room: int  #: room where the committed part ends
    free_at: float  #: when the committed part ends [s]
    onboard: tuple[int, ...]  #: task numbers picked up (or committed to be) and not dropped
    capacity: int
    planned: tuple[Stop, ...] = ()  #: the free part of the previous itinerary


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllocationProblem:
    """One call of the allocator."""

    now: float  #: [s]
    robots: tuple[RobotPlan, ...]
    tasks: tuple[OpenTask, ...]  #: every task that is not committed to be dropped
    travel_times: Array  #: (R, R) [s], closed under shortest paths


@dataclass(frozen=True, slots=True, kw_only=True)
class Allocation:
    """An allocator's answer; always an answer, never None."""

    itineraries: tuple[tuple[Stop, ...], ...]  #: one per robot of the problem, in its order
    late: tuple[int, ...] = ()  #: tasks served after their deadline by this plan
    unserved: tuple[int, ...] = ()  #: tasks no robot takes
    reason: str = ""  #: why tasks are late or unserved, in words
