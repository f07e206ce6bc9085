"""What the stack remembers: each robot's mission, and everything else that decides."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.protocols import Controller
from mrta_falsify.core.world import Task
from mrta_falsify.stack.activity import Activity, Idle, Off
from mrta_falsify.stack.dispatcher import DispatcherState
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.planning_service import ServiceState
from mrta_falsify.stack.resources.passage import CLEAR, Passage
from mrta_falsify.stack.resources.queue import QueueState
from mrta_falsify.stack.route import Way


def fingerprint(value: object, seen: hashlib._Hash) -> None:
    """Feed ``value`` to ``seen``: arrays by their bytes, objects by their fields in order.

    Components without fields (a planner, options) count by the name of their class.
    """
    if isinstance(value, np.ndarray):
        seen.update(repr((value.dtype.str, value.shape)).encode())
        seen.update(np.ascontiguousarray(value).tobytes())
    elif dataclasses.is_dataclass(value):
        _fields(value, [field.name for field in dataclasses.fields(value)], seen)
    elif isinstance(value, dict):
        for key in sorted(value, key=repr):
            seen.update(repr(key).encode())
            fingerprint(value[key], seen)
    elif isinstance(value, (list, tuple)):
        seen.update(f"[{len(value)}".encode())
        for item in value:
            fingerprint(item, seen)
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        _fields(value, sorted(vars(value)), seen)
    else:
        seen.update(repr(value).encode())


def _fields(value: object, names: list[str], seen: hashlib._Hash) -> None:
    seen.update(type(value).__name__.encode())
    for name in names:
        seen.update(name.encode())
        fingerprint(getattr(value, name), seen)


_DRIVING, _PLANNING = Phase.DRIVING, Phase.PLANNING


@dataclass(frozen=True, slots=True)
class ParkingMemory:
    """What one robot remembers of parking."""

    spot: tuple[float, float] | None = None  #: reserved [m]: it stands there or drives there
    unreachable: tuple[tuple[float, float], ...] = ()  #: spots [m] it found no path to
    not_before: float = 0.0  #: not sent away before this [s]

    def given_up(self) -> ParkingMemory:
        """Give back the spot, and try the unreachable ones again."""
        return replace(self, spot=None, unreachable=())


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """What one robot is about."""

    room: int = -1  #: room it was in last; -1: the world has none
    itinerary: tuple[Stop, ...] = ()
    onboard: tuple[int, ...] = ()
    activity: Activity = Off()
    way: Way = Way()
    passage: Passage = CLEAR
    parking: ParkingMemory = ParkingMemory()
    has_delivered: bool = False  #: anything yet

    @property
    def phase(self) -> Phase:
        """What the robot is doing, as the trace keeps it."""
        if self.passage.standing is not None:
            return self.passage.standing
        phase = self.activity.phase
        if phase is _DRIVING and self.way.is_going and not len(self.way.path):
            return _PLANNING
        return phase

    def depart(self, activity: Activity, route: Array) -> Mission:
        """Take up an activity that leads along ``route`` ``(K, 2)`` [m]."""
        return replace(
            self,
            activity=activity,
            way=self.way.head_for(route),
            parking=self.parking.given_up(),
        )

    def rest(self) -> Mission:
        """Stay here without a stop to work on."""
        return replace(self, activity=Idle(), way=self.way.stopped())

    def next_deadline(self, tasks: Sequence[Task]) -> float:
        """Deadline [s] of what is delivered next; infinity: nothing is."""
        for stop in self.itinerary:
            if stop.action == "dropoff":
                return tasks[stop.task].deadline
        return math.inf


@dataclass(slots=True)
class StackState:
    """The memory of the whole stack."""

    missions: list[Mission]
    headway: Headway
    queues: list[QueueState]
    dispatcher: DispatcherState
    service: ServiceState
    controller: Controller
    next_planner: int = 0  #: robot whose plan is computed first
    link_epoch: int = 0  #: changes of links seen so far
    map_epoch: int = 0  #: changes of blockages seen so far

    def digest(self) -> str:
        """Hash (sha256) everything that decides the next commands."""
        seen = hashlib.sha256()
        fingerprint(self, seen)
        return seen.hexdigest()
