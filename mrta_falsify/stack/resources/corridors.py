"""Corridors, doors, lifts and chargers: resources that robots pass on their way.

Before a robot enters the release area of such a resource it asks for it. Until it is a holder it
stops short of the area, or goes to a free waiting spot on its own side. It lets go behind the area.

Robots do not wait inside an area if they can avoid it, so that no circle of holders comes about
that wait for each other. Two rules serve that:

- Areas too close to each other to wait between them are asked for and granted together.
- A robot whose waiting place for a room lies inside an area asks for the room first, from outside.

In names here, *corridor* stands for all four kinds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.protocols import Waiter
from mrta_falsify.stack.resources.crossings import Stretch, find_crossing, nearest_arc, stretches
from mrta_falsify.stack.resources.passage import Passage
from mrta_falsify.stack.resources.queue import Queue, QueueState
from mrta_falsify.stack.route import Way

STOP_SHORT = 0.6  # m before the area, as far as robots keep from each other
ASK_AHEAD = 2.0  # m before the stop: time enough to be let in without braking
WAITING_GAP = 1.5  # m between two areas, so that a robot can wait there clear of both
DEEP = 0.3  # m left inside: less is the jitter of a robot that has just left
FILE_GAP = 1.0  # m between robots that wait one behind the other, as MRTA-Sim's spots
SAME_FILE = 4.0  # m, robots farther apart wait at different sides or for different reasons
STANDS = 0.25  # m from the end of its limit a robot counts as standing there


class Traveller(NamedTuple):
    """One robot as the corridors see it."""

    position: Array  #: (2,) [m]
    ahead: Array  #: (L, 2) way ahead from the robot on [m], may be empty
    way: Way
    passage: Passage  #: as the last tick left it
    deadline: float  #: of what it delivers next [s]
    room_needed: bool  #: heads for a waiting place, without the room


class Clearance(NamedTuple):
    """What the corridors let one robot do."""

    passage: Passage
    way: Way
    limit: float  #: how much of the way it may drive [m]


@dataclass(slots=True)
class _Progress:
    """How far one robot has come in a tick: a clearance in the making."""

    robot: int
    seen: Traveller
    stretches: tuple[Stretch, ...]
    way: Way
    chain: tuple[int, ...]
    spot: int | None
    limit: float = np.inf
    standing: Phase | None = None
    asks_for_room: bool = False

    def clear(self) -> None:
        """Wait for nothing."""
        self.chain, self.spot = (), None

    def clearance(self) -> Clearance:
        """What the corridors let the robot do, now that all rules have been applied."""
        passage = Passage(self.chain, self.spot, self.standing, self.asks_for_room)
        return Clearance(passage, self.way, self.limit)


class CorridorTraffic:
    """The rule by which robots pass corridors; has no memory of its own."""

    def __init__(self, queues: Sequence[Queue]) -> None:
        self._queues = queues
        self._corridors = [i for i, queue in enumerate(queues) if queue.resource.kind != "room"]
        self._areas = [(i, queues[i].resource.release_area) for i in self._corridors]
        self._middle = {i: np.mean(area, axis=0) for i, area in self._areas}

    def step(
        self, travellers: Sequence[Traveller], memories: Sequence[QueueState], time: float
    ) -> tuple[list[Clearance], list[StackEvent]]:
        """Release, ask and grant; tell each robot how far it may drive.

        Args:
            travellers: all robots, by number.
            memories: of all queues, by number; brought up to date.
            time: [s].
        """
        events: list[StackEvent] = []
        robots = [self._begin(robot, seen) for robot, seen in enumerate(travellers)]
        for corridor in self._corridors:
            events += self._let_go(corridor, memories[corridor], robots, time)
        for robot in robots:
            events += self._approach(robot, robots, memories, time)
        for corridor in self._corridors:
            events += self._grant(corridor, memories, robots, time)
            self._send_to_spots(corridor, memories[corridor], robots)
        for robot in robots:
            self._stand_still(robot, memories, time)
        return [robot.clearance() for robot in robots], events

    def _begin(self, robot: int, seen: Traveller) -> _Progress:
        ahead = seen.ahead if len(seen.ahead) else seen.position[None, :]
        return _Progress(
            robot=robot,
            seen=seen,
            stretches=stretches(ahead, self._areas),
            way=seen.way,
            chain=seen.passage.chain,
            spot=seen.passage.spot,
        )

    # --- letting go -------------------------------------------------------------------------

    def _let_go(
        self, corridor: int, memory: QueueState, robots: Sequence[_Progress], time: float
    ) -> list[StackEvent]:
        queue = self._queues[corridor]
        events: list[StackEvent] = []
        for holder in tuple(memory.holders):
            robot = robots[holder]
            if not queue.is_left_at(robot.seen.position):
                memory.entered.setdefault(holder, time)
            if not self._still_needs(corridor, memory, robot, time):
                events += queue.let_go(memory, holder, time, robot.seen.position)
        for waiter in tuple(memory.waiters):
            robot = robots[waiter.robot]
            # A robot at a spot looks away from the area, one without a path looks nowhere.
            settled = not robot.way.must_plan and not len(robot.way.halt)
            if settled and all(corridor != stretch.queue for stretch in robot.stretches):
                queue.withdraw(memory, waiter.robot)
                robot.clear()
        return events

    def _still_needs(
        self, corridor: int, memory: QueueState, robot: _Progress, time: float
    ) -> bool:
        queue = self._queues[corridor]
        entered = robot.robot in memory.entered
        if not queue.is_served(memory, robot.robot, time):
            return True
        if entered and queue.resource.hold == "until_served":
            return False
        if any(stretch.queue == corridor for stretch in robot.stretches):
            return True
        return robot.way.must_plan and robot.way.is_going and not entered

    # --- asking -----------------------------------------------------------------------------

    def _approach(
        self,
        robot: _Progress,
        robots: Sequence[_Progress],
        memories: Sequence[QueueState],
        time: float,
    ) -> list[StackEvent]:
        """Ask for the first corridor ahead that the robot does not hold, and stop before it."""
        events: list[StackEvent] = []
        for place, stretch in enumerate(robot.stretches):
            queue, memory = self._queues[stretch.queue], memories[stretch.queue]
            if robot.robot in memory.holders:
                continue
            if stretch.enter == 0.0:
                if queue.resource.hold != "until_served" and stretch.leave > DEEP:
                    # However it came there: no other robot may come in.
                    queue.admit(memory, robot.robot)
                    events.append(
                        queue.event(time, robot.robot, kind="granted", detail="was inside")
                    )
                continue
            stop = stretch.enter - STOP_SHORT
            robot.limit = max(0.0, stop - FILE_GAP * _robots_before(robot, stretch, robots, memory))
            if not queue.is_requested_from(robot.seen.position) and stop > ASK_AHEAD:
                return events
            if robot.seen.room_needed and np.isinf(stretch.leave):
                robot.asks_for_room = True
                queue.withdraw(memory, robot.robot)
                robot.clear()
                return events
            robot.chain = _chain(robot.stretches[place:], memories, robot.robot)
            return events + self._ask(robot, stretch.enter, memories, time)
        return events

    def _ask(
        self, robot: _Progress, distance: float, memories: Sequence[QueueState], time: float
    ) -> list[StackEvent]:
        waiter = Waiter(
            robot=robot.robot, since=time, distance=distance, deadline=robot.seen.deadline
        )
        events: list[StackEvent] = []
        for corridor in robot.chain:
            events += self._queues[corridor].request(memories[corridor], waiter)
        return events

    # --- granting ---------------------------------------------------------------------------

    def _grant(
        self,
        corridor: int,
        memories: Sequence[QueueState],
        robots: Sequence[_Progress],
        time: float,
    ) -> list[StackEvent]:
        """Let waiting robots in, each with all the corridors that it must have together."""
        queue, memory = self._queues[corridor], memories[corridor]
        events: list[StackEvent] = []
        while memory.waiters and queue.has_place(memory):
            robot = robots[queue.order(memory)[0]]
            chain = robot.chain if corridor in robot.chain else (corridor,)
            if not all(self._queues[i].has_place(memories[i]) for i in chain):
                break
            for i in chain:
                admitted = self._queues[i].admit(memories[i], robot.robot)
                events += self._queues[i].grants([admitted], time)
            robot.clear()
            robot.way = robot.way.resumed()
            robot.limit = np.inf
        return events

    def _send_to_spots(
        self, corridor: int, memory: QueueState, robots: Sequence[_Progress]
    ) -> None:
        """Send waiting robots that stand at their stop to free spots on their side."""
        queue = self._queues[corridor]
        spots, area = queue.resource.spots, queue.resource.release_area
        for waiting in queue.order(memory) if len(spots) else ():
            robot = robots[waiting]
            near = robot.limit <= ASK_AHEAD
            if robot.spot is not None or robot.chain[:1] != (corridor,) or not near:
                continue
            taken = {other.spot for other in robots if other.chain[:1] == (corridor,)}
            for place, spot in enumerate(spots):
                line = np.stack([robot.seen.position, spot])
                if place not in taken and find_crossing(line, area)[0] == np.inf:
                    robot.spot = place
                    robot.way = robot.way.halt_at(spot)
                    break

    # --- standing ---------------------------------------------------------------------------

    def _stand_still(self, robot: _Progress, memories: Sequence[QueueState], time: float) -> None:
        """Note who waits before a corridor, and who stands in a lift or charger until served."""
        if _waits_there(robot):
            robot.standing = Phase.QUEUEING
        for stretch in robot.stretches:
            queue, memory = self._queues[stretch.queue], memories[stretch.queue]
            if queue.resource.kind not in ("elevator", "charger"):
                continue
            is_served = queue.is_served(memory, robot.robot, time)
            if robot.robot not in memory.entered or is_served or not len(robot.seen.ahead):
                continue
            stand = nearest_arc(robot.seen.ahead, self._middle[stretch.queue], stretch.leave)
            robot.limit = min(robot.limit, stand)
            if stand <= STANDS:
                robot.standing = Phase.SERVING


def corridor_traffic(queues: Sequence[Queue]) -> CorridorTraffic | None:
    """Give the rule by which robots pass the corridors among ``queues``; None: there are none."""
    if all(queue.resource.kind == "room" for queue in queues):
        return None
    return CorridorTraffic(queues)


def _waits_there(robot: _Progress) -> bool:
    """Whether the robot stands at its waiting spot, or at its stop before a corridor."""
    if len(robot.way.halt):
        gap = robot.way.halt[0] - robot.seen.position
        return bool(np.hypot(gap[0], gap[1]) <= STANDS)
    return robot.limit <= STANDS and (bool(robot.chain) or robot.asks_for_room)


def _chain(ahead: Sequence[Stretch], memories: Sequence[QueueState], robot: int) -> tuple[int, ...]:
    """List the corridors a robot must have together, because it cannot wait between them."""
    chain: list[int] = []
    leave = -np.inf
    for stretch in ahead:
        if chain and stretch.enter - leave >= WAITING_GAP:
            break
        leave = max(leave, stretch.leave)
        if robot not in memories[stretch.queue].holders:
            chain.append(stretch.queue)
    return tuple(chain)


def _robots_before(
    robot: _Progress, stretch: Stretch, robots: Sequence[_Progress], memory: QueueState
) -> int:
    """How many robots will wait for the same corridor in front of this one."""
    count = 0
    mine = (stretch.enter, robot.robot)
    for other in robots:
        if other is robot or other.robot in memory.holders or len(other.way.halt):
            continue
        gap = other.seen.position - robot.seen.position
        if gap[0] * gap[0] + gap[1] * gap[1] > SAME_FILE * SAME_FILE:
            continue
        count += any(
            s.queue == stretch.queue and (s.enter, other.robot) < mine for s in other.stretches
        )
    return count
