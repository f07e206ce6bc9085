"""Corridors, doors, lifts and chargers: resources that robots pass on their way.

Before a robot enters the release area of such a resource it asks, and stops short of it (or
goes to a free waiting spot on its own side) until it is a holder. It lets go behind the area.

Nobody waits inside an area if that can be avoided, so that no circle of holders waiting for
each other comes about: areas that follow one another too closely to wait between them are
asked for and granted together, and a robot whose waiting place for a room lies inside an
area asks for the room first, from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.protocols import Waiter
from mrta_falsify.stack.planning_service import Way
from mrta_falsify.stack.resources.queue import Queue, QueueState, inside

STOP_SHORT = 0.6  # m before the area, as far as robots keep from each other
ASK_AHEAD = 2.0  # m before the stop: time enough to be let in without braking
WAITING_GAP = 1.5  # m between two areas, so that a robot can wait there clear of both
DEEP = 0.3  # m left inside: less is the jitter of a robot that has just left
FILE_GAP = 1.0  # m between robots that wait one behind the other, as MRTA-Sim's spots
SAME_FILE = 4.0  # m, robots farther apart wait at different sides or for different reasons
STANDS = 0.25  # m from the end of its limit a robot counts as standing there
STEP = 0.1  # m, sampling of ways
REACH = 25.0  # m of the way ahead that are searched for areas


@dataclass(slots=True)
class Gate:
    """What one robot waits for on its way; part of the stack's memory."""

    chain: tuple[int, ...] = ()  #: queues asked for together, the first one first
    spot: int = -1  #: waiting spot of the first that it stands at, -1: none

    def clear(self) -> None:
        """Wait for nothing."""
        self.chain, self.spot = (), -1


@dataclass(slots=True, kw_only=True)
class Traveller:
    """One robot as the areas see it, and what they make of it."""

    robot: int
    position: Array  #: (2,) [m]
    ahead: Array  #: (L, 2) way ahead from the robot on [m], may be empty
    way: Way
    gate: Gate
    deadline: float  #: [s]
    room_needed: bool  #: heads for a waiting place, without the room
    limit: float = np.inf  #: how much of the way it may drive [m]
    standing: Phase | None = None  #: waits for a resource, or is served by one
    wants_room: bool = False  #: is to ask for its room from here
    crossings: list[Crossing] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Crossing:
    """A stretch of a way that lies in an area."""

    area: int  #: queue number
    enter: float  #: [m] ahead, 0: is inside
    leave: float  #: [m] ahead, inf: the way ends inside


class Areas:
    """Rules of all area resources of a world; no memory of its own."""

    def __init__(self, queues: Sequence[Queue]) -> None:
        self._queues = queues
        self._areas = [i for i, queue in enumerate(queues) if queue.resource.kind != "room"]
        self._middle = {i: np.mean(queues[i].resource.release_area, axis=0) for i in self._areas}

    def __bool__(self) -> bool:
        """Whether there is any area."""
        return bool(self._areas)

    def step(
        self, travellers: Sequence[Traveller], memories: Sequence[QueueState], time: float
    ) -> list[StackEvent]:
        """Release, ask, grant, and fill in every traveller's limit and standing.

        Args:
            travellers: all robots, by number; changed in place.
            memories: of all queues, by number; changed in place.
            time: [s].
        """
        events: list[StackEvent] = []
        for traveller in travellers:
            traveller.crossings = self._crossings(traveller)
        for area in self._areas:
            self._let_go(area, memories[area], travellers, time, events)
        for traveller in travellers:
            self._approach(traveller, travellers, memories, time, events)
        for area in self._areas:
            self._grant(area, memories, travellers, time, events)
        for traveller in travellers:
            self._stand_still(traveller, memories, time)
        return events

    def _crossings(self, traveller: Traveller) -> list[Crossing]:
        ahead = traveller.ahead if len(traveller.ahead) else traveller.position[None, :]
        found = []
        for area in self._areas:
            enter, leave = find_crossing(ahead, self._queues[area].resource.release_area)
            if enter < np.inf:
                found.append(Crossing(area, enter, leave))
        return sorted(found, key=lambda crossing: (crossing.enter, crossing.area))

    # --- letting go -------------------------------------------------------------------------

    def _let_go(
        self,
        area: int,
        memory: QueueState,
        travellers: Sequence[Traveller],
        time: float,
        events: list[StackEvent],
    ) -> None:
        queue = self._queues[area]
        for robot in tuple(memory.holders):
            traveller = travellers[robot]
            if not queue.is_left_at(traveller.position):
                memory.entered.setdefault(robot, time)
            if self._still_needs(queue, area, memory, traveller, time):
                continue
            queue.release(memory, robot)
            events.append(_event(time, "released", queue, robot))
            for lucky in queue.careless_admission(memory):
                events.append(_event(time, "granted", queue, lucky))
        for waiter in tuple(memory.waiters):
            traveller = travellers[waiter.robot]
            # A robot at a spot looks away from the area, one without a path looks nowhere.
            settled = not traveller.way.must_plan and not len(traveller.way.halt)
            if settled and all(area != crossing.area for crossing in traveller.crossings):
                queue.withdraw(memory, waiter.robot)
                traveller.gate.clear()

    @staticmethod
    def _still_needs(
        queue: Queue, area: int, memory: QueueState, traveller: Traveller, time: float
    ) -> bool:
        robot = traveller.robot
        if not queue.is_served(memory, robot, time):
            return True
        if robot in memory.entered and queue.resource.hold == "until_served":
            return False
        if any(crossing.area == area for crossing in traveller.crossings):
            return True
        return traveller.way.must_plan and traveller.way.is_going and robot not in memory.entered

    # --- asking -----------------------------------------------------------------------------

    def _approach(
        self,
        traveller: Traveller,
        travellers: Sequence[Traveller],
        memories: Sequence[QueueState],
        time: float,
        events: list[StackEvent],
    ) -> None:
        robot = traveller.robot
        for place, crossing in enumerate(traveller.crossings):
            queue, memory = self._queues[crossing.area], memories[crossing.area]
            if robot in memory.holders:
                continue
            is_inside = crossing.enter == 0.0
            if is_inside and queue.resource.hold == "until_served":
                continue
            if is_inside and crossing.leave > DEEP:
                # However it came there: nobody else may come in.
                queue.admit(memory, robot)
                events.append(_event(time, "granted", queue, robot, detail="was inside"))
                continue
            if is_inside:
                continue
            stop = crossing.enter - STOP_SHORT
            before = _robots_before(traveller, crossing, travellers, memory)
            traveller.limit = max(0.0, stop - FILE_GAP * before)
            near = queue.is_asked_from(traveller.position) or stop <= ASK_AHEAD
            if not near:
                return
            if traveller.room_needed and np.isinf(crossing.leave):
                traveller.wants_room = True
                queue.withdraw(memory, robot)
                traveller.gate.clear()
                return
            traveller.gate.chain = self._chain(traveller.crossings[place:], memories, robot)
            self._ask(traveller, crossing.enter, memories, time, events)
            return

    def _chain(
        self, crossings: Sequence[Crossing], memories: Sequence[QueueState], robot: int
    ) -> tuple[int, ...]:
        """Areas that a robot must have together, because it cannot wait between them."""
        chain: list[int] = []
        leave = -np.inf
        for crossing in crossings:
            if chain and crossing.enter - leave >= WAITING_GAP:
                break
            leave = max(leave, crossing.leave)
            if robot not in memories[crossing.area].holders:
                chain.append(crossing.area)
        return tuple(chain)

    def _ask(
        self,
        traveller: Traveller,
        distance: float,
        memories: Sequence[QueueState],
        time: float,
        events: list[StackEvent],
    ) -> None:
        for area in traveller.gate.chain:
            queue, memory = self._queues[area], memories[area]
            waiter = Waiter(
                robot=traveller.robot, since=time, distance=distance, deadline=traveller.deadline
            )
            if queue.ask(memory, waiter):
                holder = -1 if queue.has_place(memory) else memory.holders[0]
                events.append(_event(time, "waits-for", queue, traveller.robot, other=holder))

    # --- granting ---------------------------------------------------------------------------

    def _grant(
        self,
        area: int,
        memories: Sequence[QueueState],
        travellers: Sequence[Traveller],
        time: float,
        events: list[StackEvent],
    ) -> None:
        queue, memory = self._queues[area], memories[area]
        while memory.waiters and queue.has_place(memory):
            robot = queue.order(memory)[0]
            traveller = travellers[robot]
            chain = traveller.gate.chain if area in traveller.gate.chain else (area,)
            if not all(self._queues[i].has_place(memories[i]) for i in chain):
                break
            for i in chain:
                self._queues[i].admit(memories[i], robot)
                events.append(_event(time, "granted", self._queues[i], robot))
            traveller.gate.clear()
            traveller.way.go_on()
            traveller.limit = np.inf
        self._send_to_spots(area, memory, travellers)

    def _send_to_spots(
        self, area: int, memory: QueueState, travellers: Sequence[Traveller]
    ) -> None:
        """Waiting robots that stand at their stop move on to free spots on their side."""
        queue = self._queues[area]
        spots, polygon = queue.resource.spots, queue.resource.release_area
        for robot in queue.order(memory) if len(spots) else ():
            traveller = travellers[robot]
            gate = traveller.gate
            near = traveller.limit <= ASK_AHEAD
            if gate.spot >= 0 or gate.chain[:1] != (area,) or not near:
                continue
            taken = {t.gate.spot for t in travellers if t.gate.chain[:1] == (area,)}
            for place, spot in enumerate(spots):
                line = np.stack([traveller.position, spot])
                if place not in taken and find_crossing(line, polygon)[0] == np.inf:
                    gate.spot = place
                    traveller.way.halt_at(spot)
                    break

    # --- standing ---------------------------------------------------------------------------

    def _stand_still(
        self, traveller: Traveller, memories: Sequence[QueueState], time: float
    ) -> None:
        """Who waits at a gate, and who stands in a lift or charger until it is served."""
        robot, way = traveller.robot, traveller.way
        if len(way.halt):
            gap = way.halt[0] - traveller.position
            if np.hypot(gap[0], gap[1]) <= STANDS:
                traveller.standing = Phase.QUEUEING
        elif traveller.limit <= STANDS and (traveller.gate.chain or traveller.wants_room):
            traveller.standing = Phase.QUEUEING
        for crossing in traveller.crossings:
            queue, memory = self._queues[crossing.area], memories[crossing.area]
            if queue.resource.kind not in ("elevator", "charger") or robot not in memory.entered:
                continue
            if not queue.is_served(memory, robot, time) and len(traveller.ahead):
                stand = nearest_arc(traveller.ahead, self._middle[crossing.area], crossing.leave)
                traveller.limit = min(traveller.limit, stand)
                if stand <= STANDS:
                    traveller.standing = Phase.SERVING


def _robots_before(
    traveller: Traveller,
    crossing: Crossing,
    travellers: Sequence[Traveller],
    memory: QueueState,
) -> int:
    """How many robots will wait for the same area in front of this one."""
    count = 0
    for other in travellers:
        if other is traveller or other.robot in memory.holders or len(other.way.halt):
            continue
        gap = other.position - traveller.position
        if gap[0] * gap[0] + gap[1] * gap[1] > SAME_FILE * SAME_FILE:
            continue
        mine = (crossing.enter, traveller.robot)
        count += any(
            c.area == crossing.area and (c.enter, other.robot) < mine for c in other.crossings
        )
    return count


def _event(
    time: float, kind: str, queue: Queue, robot: int, *, other: int = -1, detail: str = ""
) -> StackEvent:
    return StackEvent(
        time=time,
        kind=kind,
        robot=robot,
        resource=queue.resource.name,
        other=other,
        detail=detail,
    )


@njit(cache=True)
def find_crossing(points: Array, polygon: Array) -> tuple[float, float]:
    """Where a way first runs through an area.

    Args:
        points: ``(L, 2)`` polyline [m], L >= 1.
        polygon: ``(V, 2)`` [m].

    Returns:
        Distances along the way [m] at which it enters (0: begins inside, inf: never does)
        and leaves again (inf: ends inside).
    """
    enter, arc = np.inf, 0.0
    if inside(polygon, points[0]):
        enter = 0.0
    for i in range(1, points.shape[0]):
        step = points[i] - points[i - 1]
        length = np.hypot(step[0], step[1])
        count = max(1, int(np.ceil(length / STEP)))
        for k in range(1, count + 1):
            here = inside(polygon, points[i - 1] + step * (k / count))
            if here and enter == np.inf:
                enter = arc + length * k / count
            elif not here and enter < np.inf:
                return enter, arc + length * k / count
        arc += length
        if arc > REACH and enter == np.inf:
            break
    return enter, np.inf


@njit(cache=True)
def nearest_arc(points: Array, target: Array, reach: float) -> float:
    """Distance [m] along ``points`` ``(L, 2)``, at most ``reach``, to where ``target`` is near."""
    best, found, arc = np.inf, 0.0, 0.0
    for i in range(1, points.shape[0]):
        step = points[i] - points[i - 1]
        length = np.hypot(step[0], step[1])
        count = max(1, int(np.ceil(length / STEP)))
        for k in range(count + 1):
            at = arc + length * k / count
            if at > reach:
                return found
            gap = points[i - 1] + step * (k / count) - target
            if gap[0] * gap[0] + gap[1] * gap[1] < best:
                best, found = gap[0] * gap[0] + gap[1] * gap[1], at
        arc += length
    return found
