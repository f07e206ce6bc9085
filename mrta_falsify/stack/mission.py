"""What the stack remembers: each robot's mission, and everything else that decides."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.protocols import Controller
from mrta_falsify.core.world import Task
from mrta_falsify.stack.dispatcher import DispatcherState
from mrta_falsify.stack.fingerprint import fingerprint
from mrta_falsify.stack.planning_service import ROOM_REACHED, ServiceState, Way, is_near
from mrta_falsify.stack.resources.corridors import Gate
from mrta_falsify.stack.resources.queue import QueueState

AT_PATH_END = 0.15  # m, controllers stop within 0.1 m of their goal

# Bound once: up to Python 3.11 each `Phase.X` costs ten times a plain name, and every robot
# is asked for its phase several times a tick.
OFF, IDLE, DRIVING, QUEUEING, PLANNING, SERVING, MAKING_ROOM = Phase

#: where a robot's route leads
NOWHERE, TO_ROOM, TO_SPOT, TO_PARKING = "", "room", "spot", "parking"
STALLED = "stalled"  # by the planted defect of that name: nowhere, and not asked again


@dataclass(slots=True)
class Mission:
    """What one robot is about."""

    itinerary: list[Stop] = field(default_factory=list)
    onboard: list[int] = field(default_factory=list)
    phase: Phase = OFF
    aim: str = NOWHERE
    room: int = -1  #: room it was in last
    place: int = -1  #: place in the queue it stands in, -1: none
    parking: int = -1  #: refuge it has or heads for, -1: none
    unreachable: list[int] = field(default_factory=list)  #: refuges it found no path to
    park_at: float = 0.0  #: not sent away before this [s]
    stops_short_of: int = -1  #: queue without spots it may not enter yet, -1: none
    wants_room: bool = False  #: asks for its room from before an area
    gate: Gate = field(default_factory=Gate)
    standing: Phase | None = None  #: waits at an area, or is served by one
    serve_until: float = -1.0  #: end of the service in progress, < 0: none
    way: Way = field(default_factory=Way)
    anchor: tuple[float, float] = (np.inf, np.inf)  #: where it made progress last [m]
    moved_at: float = 0.0  #: last time it was PROGRESS away from where it was


@dataclass(slots=True)
class StackState:
    """The memory of the whole stack."""

    missions: list[Mission]
    queues: list[QueueState]
    dispatcher: DispatcherState
    service: ServiceState
    controller: Controller
    next_planner: int = 0  #: robot whose plan is computed first
    link_epoch: int = 0  #: changes of links seen so far
    map_epoch: int = 0  #: changes of blockages seen so far

    def digest(self) -> str:
        """sha256 over everything that decides the next commands."""
        seen = hashlib.sha256()
        fingerprint(self, seen)
        return seen.hexdigest()


def next_deadline(mission: Mission, tasks: Sequence[Task]) -> float:
    """Deadline [s] of what is delivered next; infinity: nothing is."""
    drops = (stop.task for stop in mission.itinerary if stop.action == "dropoff")
    task = next(drops, None)
    return np.inf if task is None else tasks[task].deadline


def distance_of(point: Array, other: Array) -> float:
    """Distance [m] of two points ``(2,)``."""
    return float(np.hypot(point[0] - other[0], point[1] - other[1]))


def has_reached(point: Array, position: Array, reach: float, way: Way) -> bool:
    """Whether a robot is where it wants to be: near the point, or as near as its path leads.

    The planner moves a goal that is covered by up to 0.25 m.
    """
    if is_near(point, position, reach):
        return True
    if not len(way.path) or len(way.route) > 1:
        return False
    end = way.path[-1]
    return distance_of(end, point) <= ROOM_REACHED and distance_of(end, position) <= AT_PATH_END
