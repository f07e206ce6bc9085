"""The queue of one shared resource: who holds it, and who waits in which place.

Rooms, corridors, doors, lifts and chargers obey the same rules. A resource has at most
``capacity`` holders. All other robots that ask for it wait in the order of the queue policy, and
none is dropped. ``rooms`` and ``corridors`` say when a robot asks and when it lets go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.plane import inside
from mrta_falsify.core.polyline import point_before_end
from mrta_falsify.core.protocols import QueuePolicy, Waiter
from mrta_falsify.core.world import Resource


class Departure(NamedTuple):
    """When and where a robot let go of a resource."""

    time: float  #: [s]
    place: Array  #: (2,) [m]


@dataclass(slots=True)
class QueueState:
    """The memory of one resource's queue."""

    holders: list[int] = field(
        default_factory=list
    )  #: robot numbers; too many if robots stood inside
    unasked: list[int] = field(default_factory=list)  #: holders that stood there at time 0
    waiters: list[Waiter] = field(default_factory=list)  #: in the order they asked
    entered: dict[int, float] = field(default_factory=dict)  #: holders: start of the visit [s]
    left: dict[int, Departure] = field(default_factory=dict)  #: who let go and is still near
    ignored: list[int] = field(default_factory=list)  #: robots whose requests are not heard


class WaitingSpots(NamedTuple):
    """Where robots wait for a resource."""

    points: Array  #: (S, 2) [m], head first
    own: int  #: so many of them, the first, are spots of the resource as the world has it


class Queue:
    """Rules of one resource; its memory is a :class:`QueueState` that the caller owns."""

    def __init__(
        self,
        resource: Resource,
        policy: QueuePolicy,
        spots: WaitingSpots | None = None,
    ) -> None:
        """Serve a resource.

        Args:
            resource: as the world describes it.
            policy: order of those who wait.
            spots: where robots wait; the resource's own spots if None.
        """
        self.resource = resource
        chosen = spots or WaitingSpots(np.asarray(resource.spots), len(resource.spots))
        self.spots = chosen.points  #: (S, 2) waiting spots [m], head first
        self._own_spots = chosen.own
        self._policy = policy

    def is_requested_from(self, position: Array) -> bool:
        """Whether a robot at ``position`` ``(2,)`` [m] is near enough to ask."""
        return bool(inside(self.resource.request_area, position))

    def is_left_at(self, position: Array) -> bool:
        """Whether a robot at ``position`` ``(2,)`` [m] leaves the resource free."""
        return not inside(self.resource.release_area, position)

    def is_served(self, state: QueueState, robot: int, time: float) -> bool:
        """Whether no service of this holder is under way: it is over, or has not begun."""
        return time >= state.entered.get(robot, -np.inf) + self.resource.service_time

    def ask(self, state: QueueState, waiter: Waiter) -> bool:
        """Enter the queue, or renew what it knows; True if the robot was not in it before."""
        if waiter.robot in state.holders:
            return False
        if any(known.robot == waiter.robot for known in state.waiters):
            self.renew(state, waiter.robot, waiter.distance, waiter.deadline)
            return False
        state.waiters.append(waiter)
        return True

    def renew(self, state: QueueState, robot: int, distance: float, deadline: float) -> bool:
        """Renew what the queue knows of a waiter; True if that is another than before."""
        for place, known in enumerate(state.waiters):
            if known.robot == robot and (known.distance, known.deadline) != (distance, deadline):
                state.waiters[place] = Waiter(
                    robot=robot, since=known.since, distance=distance, deadline=deadline
                )
                return True
        return False

    def order(self, state: QueueState) -> tuple[int, ...]:
        """Waiting robots, the next holder first."""
        return self._policy.order(state.waiters) if state.waiters else ()

    def place_of(self, state: QueueState, robot: int) -> int | None:
        """Place of a robot in the queue, 0 = head; None if it does not wait."""
        for waiter in state.waiters:
            if waiter.robot == robot:
                return self.order(state).index(robot)
        return None

    def has_place(self, state: QueueState) -> bool:
        """Whether one more robot may hold the resource."""
        return len(state.holders) < self.resource.capacity

    def grant(self, state: QueueState) -> tuple[int, ...]:
        """Give free places to waiting robots, and return those robots."""
        granted = []
        while state.waiters and self.has_place(state):
            granted.append(self.admit(state, self.order(state)[0]))
        return tuple(granted)

    def admit(self, state: QueueState, robot: int) -> int:
        """Make ``robot`` a holder, which waits no longer."""
        self.withdraw(state, robot)
        state.holders.append(robot)
        return robot

    def withdraw(self, state: QueueState, robot: int) -> None:
        """Take ``robot`` out of the queue without a grant."""
        state.waiters = [waiter for waiter in state.waiters if waiter.robot != robot]

    def release(self, state: QueueState, robot: int) -> bool:
        """Give the place back; True if the robot had one."""
        if robot not in state.holders:
            return False
        state.holders.remove(robot)
        state.unasked = [one for one in state.unasked if one != robot]
        state.entered.pop(robot, None)
        return True

    def is_off_lane(self, place: int) -> bool:
        """Whether the robot at ``place`` stands somewhere that no lane leads to."""
        return self._own_spots <= place < len(self.spots)

    def is_own_spot(self, place: int) -> bool:
        """Whether the robot at ``place`` in the queue stands at a spot that the world names."""
        return place < self._own_spots

    def waiting_point(self, place: int, approach: Array) -> Array:
        """Where the robot at ``place`` in the queue stands.

        Args:
            place: 0 = head.
            approach: ``(K, 2)`` waypoints that end at the tail spot [m].

        Returns:
            ``(2,)`` the spot [m]. Waiters beyond the last spot line up behind it on
            ``approach``, one metre apart.
        """
        spots = self.spots
        if place < len(spots):
            return np.asarray(spots[place])
        behind = float(place - len(spots) + 1) if len(spots) else float(place)
        return point_before_end(approach, behind)

    # --- the same, told as events -------------------------------------------------------------

    def request(self, state: QueueState, waiter: Waiter) -> list[StackEvent]:
        """Let a robot ask for the resource; tell it if the robot did not wait before."""
        if not self.ask(state, waiter):
            return []
        holder = -1 if self.has_place(state) else state.holders[0]
        return [self.event(waiter.since, waiter.robot, kind="waits-for", other=holder)]

    def let_go(
        self, state: QueueState, robot: int, time: float, position: Array
    ) -> list[StackEvent]:
        """Take the resource back from a holder, which is at ``position`` ``(2,)`` [m]."""
        self.release(state, robot)
        if self.is_left_at(position):
            state.left[robot] = Departure(time, position.copy())
        return [self.event(time, robot, kind="released")]

    def turn_away(self, state: QueueState, robot: int, time: float) -> list[StackEvent]:
        """Take a robot out of the queue that heads elsewhere now."""
        del time
        self.withdraw(state, robot)
        return []

    def grants(self, robots: Sequence[int], time: float) -> list[StackEvent]:
        """Tell that ``robots`` became holders."""
        return [self.event(time, robot, kind="granted") for robot in robots]

    def event(
        self, time: float, robot: int, *, kind: str, other: int = -1, detail: str = ""
    ) -> StackEvent:
        """Event of this resource at ``time`` [s]."""
        return StackEvent(
            time=time,
            kind=kind,
            robot=robot,
            resource=self.resource.name,
            other=other,
            detail=detail,
        )
