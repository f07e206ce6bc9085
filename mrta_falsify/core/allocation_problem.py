"""What dispatcher and allocator exchange: problems, plans and proofs of infeasibility."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mrta_falsify.core.arrays import Array

Action = Literal["pickup", "dropoff"]
#: ``free``: stops that are not committed may change; ``keep``: the old plan is only appended to
Commitment = Literal["free", "keep"]
Status = Literal["plan", "partial", "infeasible"]


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
    arrival: float  #: [s], the leg toward the pickup starts no earlier
    deadline: float  #: [s], absolute
    pickup_time: float = 0.0  #: service [s]
    dropoff_time: float = 0.0  #: service [s]
    robot: int = -1  #: number of the only robot that may serve it; -1: any. A robot of the problem

    def allows(self, robot: int) -> bool:
        """Whether the robot of that number may serve the task."""
        return self.robot in (-1, robot)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPlan:
    """A robot as the allocator sees it: the committed future, and what may be changed."""

    robot: int  #: robot number
    room: int  #: room where the committed part ends
    free_at: float  #: when the committed part ends [s]
    onboard: tuple[int, ...]  #: task numbers picked up (or committed to be) and not dropped
    capacity: int
    planned: tuple[Stop, ...] = ()  #: the part of the previous itinerary that is not committed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllocationProblem:
    """One call of the allocator.

    R rooms. A stop's time is the end of its service: the later of the previous stop's end
    and (for a pickup) the task's arrival, plus travel, plus service. Robots do not return.
    """

    now: float  #: [s]
    robots: tuple[RobotPlan, ...]
    tasks: tuple[OpenTask, ...]  #: every task that is not committed to be dropped
    travel_times: Array  #: (R, R) [s], closed under shortest paths
    commitment: Commitment = "free"  #: what may happen to ``RobotPlan.planned``
    points: Array | None = None  #: (R, 2) location points of the rooms [m], map frame


@dataclass(frozen=True, slots=True, kw_only=True)
class Infeasible:
    """A proof that not all deadlines can be met."""

    core: tuple[int, ...]  #: tasks that cannot all be in time, sorted; without any one they can
    reason: str  #: in words
    minimal: bool = True  #: False: the search for a smaller core was cut off


@dataclass(frozen=True, slots=True, kw_only=True)
class Allocation:
    """An allocator's answer; always an answer, never None."""

    itineraries: tuple[tuple[Stop, ...], ...]  #: one per robot of the problem, in its order
    late: tuple[int, ...] = ()  #: tasks served after their deadline by this plan
    unserved: tuple[int, ...] = ()  #: tasks no robot takes
    reason: str = ""  #: why tasks are late or unserved, in words
    infeasible: Infeasible | None = None  #: proof that no plan meets all deadlines
    least_lost: int | None = None  #: proved: at least this many deadlines are lost

    @property
    def status(self) -> Status:
        """``plan``: all in time; ``infeasible``: proved impossible; ``partial``: not known."""
        if not self.late and not self.unserved:
            return "plan"
        return "partial" if self.infeasible is None else "infeasible"
