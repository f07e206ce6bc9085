"""Queues of shared resources: who holds a room, who waits where.

One set of rules for rooms, corridors, doors, lifts and chargers: at most ``capacity`` holders,
everybody else waits in the order of the queue policy, nobody is dropped. ``areas`` and
``stack`` say when a robot asks and lets go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.protocols import QueuePolicy, Waiter
from mrta_falsify.core.world import Resource

FORGOTTEN_FROM = 3  #: waiters that `fourth_waiter_dropped` keeps


@dataclass(slots=True)
class QueueState:
    """The memory of one resource's queue."""

    holders: list[int] = field(default_factory=list)  #: robot numbers, at most the capacity
    waiters: list[Waiter] = field(default_factory=list)  #: in the order they asked
    entered: dict[int, float] = field(default_factory=dict)  #: holders: start of the visit [s]
    forgotten: list[int] = field(default_factory=list)  #: by `fourth_waiter_dropped`


@njit(cache=True)
def inside(polygon: Array, point: Array) -> bool:
    """Whether ``point`` ``(2,)`` lies in the simple polygon ``(V, 2)`` (even-odd rule)."""
    x, y = point[0], point[1]
    hit = False
    if len(polygon) == 0:
        return hit
    last_x, last_y = polygon[-1, 0], polygon[-1, 1]
    for i in range(len(polygon)):
        corner_x, corner_y = polygon[i, 0], polygon[i, 1]
        if (corner_y > y) != (last_y > y):
            crossing = (last_x - corner_x) * (y - corner_y) / (last_y - corner_y) + corner_x
            if x < crossing:
                hit = not hit
        last_x, last_y = corner_x, corner_y
    return hit


class Queue:
    """Rules of one resource; its memory is a :class:`QueueState` that the caller keeps."""

    def __init__(self, resource: Resource, policy: QueuePolicy, defects: Sequence[str]) -> None:
        self.resource = resource
        self._policy = policy
        self._defects = frozenset(defects)

    def is_asked_from(self, position: Array) -> bool:
        """Whether a robot at ``position`` ``(2,)`` [m] is near enough to ask."""
        return bool(inside(self.resource.request_area, position))

    def is_left_at(self, position: Array) -> bool:
        """Whether a robot at ``position`` ``(2,)`` [m] is out of the others' way."""
        return not inside(self.resource.release_area, position)

    def is_served(self, state: QueueState, robot: int, time: float) -> bool:
        """Whether a holder's visit has lasted for the service time, or not begun."""
        return time >= state.entered.get(robot, -np.inf) + self.resource.service_time

    def ask(self, state: QueueState, waiter: Waiter) -> bool:
        """Enter the queue; says whether the robot was not in it before."""
        if waiter.robot in state.holders or waiter.robot in state.forgotten:
            return False
        for place, known in enumerate(state.waiters):
            if known.robot == waiter.robot:
                state.waiters[place] = Waiter(
                    robot=waiter.robot,
                    since=known.since,
                    distance=waiter.distance,
                    deadline=waiter.deadline,
                )
                return False
        forgets = "fourth_waiter_dropped" in self._defects
        if forgets and len(state.waiters) >= FORGOTTEN_FROM:
            state.forgotten.append(waiter.robot)
            return False
        state.waiters.append(waiter)
        return True

    def order(self, state: QueueState) -> tuple[int, ...]:
        """Waiting robots, the next holder first."""
        return self._policy.order(state.waiters) if state.waiters else ()

    def place_of(self, state: QueueState, robot: int) -> int:
        """Place of a robot in the queue, 0 = head, -1 if it does not wait."""
        ordered = self.order(state)
        return ordered.index(robot) if robot in ordered else -1

    def has_place(self, state: QueueState) -> bool:
        """Whether another robot may hold the resource."""
        return len(state.holders) < self.resource.capacity

    def grant(self, state: QueueState) -> tuple[int, ...]:
        """Give free places to waiting robots; the robots that got one."""
        granted = []
        while state.waiters and self.has_place(state):
            granted.append(self.admit(state, self.order(state)[0]))
        return tuple(granted)

    def admit(self, state: QueueState, robot: int) -> int:
        """Make ``robot`` a holder; it waits no longer."""
        self.withdraw(state, robot)
        state.holders.append(robot)
        return robot

    def withdraw(self, state: QueueState, robot: int) -> None:
        """Leave the queue without having had a turn."""
        state.waiters = [waiter for waiter in state.waiters if waiter.robot != robot]

    def release(self, state: QueueState, robot: int) -> bool:
        """Give the place back; says whether the robot had one."""
        if robot not in state.holders:
            return False
        state.holders.remove(robot)
        state.entered.pop(robot, None)
        return True

    def careless_admission(self, state: QueueState) -> tuple[int, ...]:
        """What `queue_release_loses_exclusion` does whenever anybody leaves the queue."""
        if "queue_release_loses_exclusion" not in self._defects or not state.waiters:
            return ()
        return (self.admit(state, self.order(state)[0]),)

    def waiting_point(self, place: int, approach: Array) -> Array:
        """Where the robot at ``place`` in the queue stands.

        Args:
            place: 0 = head.
            approach: ``(K, 2)`` waypoints that end at the tail spot [m].

        Returns:
            ``(2,)`` the spot; for more waiters than spots a point on ``approach``, one metre
            further back each.
        """
        spots = self.resource.spots
        if place < len(spots):
            return np.asarray(spots[place])
        behind = float(place - len(spots) + 1) if len(spots) else float(place)
        return point_before_end(approach, behind)


def point_before_end(points: Array, distance: float) -> Array:
    """Point of the polyline ``(K, 2)`` that lies ``distance`` [m] before its end."""
    left = distance
    for i in range(len(points) - 1, 0, -1):
        step = points[i - 1] - points[i]
        length = float(np.hypot(*step))
        if length >= left and length > 0.0:
            return np.asarray(points[i] + step * (left / length))
        left -= length
    return np.asarray(points[0])
