"""What the stack tells the observer each tick: where the robots head, and what they wait for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray, frozen_array
from mrta_falsify.core.fleet import Intent
from mrta_falsify.core.protocols import ControlResult
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Activity, Parking, Waiting, queue_place
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.resources.queue import QueueState
from mrta_falsify.stack.resources.rooms import RoomTraffic

NOT_A_POINT = frozen_array([np.nan, np.nan])


@dataclass(frozen=True, slots=True, eq=False)
class _Goals:
    """Where robots head that are about this."""

    #: N: next room, activity, parking spot [m]
    about: tuple[tuple[int, Activity, tuple[float, float] | None], ...]
    points: Array  #: (N, 2) [m], nan: nowhere


@dataclass(frozen=True, slots=True, eq=False)
class _Declared:
    """What all robots intend while they are about the same."""

    missions: list[Mission]
    phase: IntArray  #: (N,)
    tasks_left: IntArray  #: (N,)
    place: IntArray  #: (N,)
    waypoint: Array  #: (N, 2) [m], nan: none
    path: tuple[Array, ...]


class Declaration:
    """Puts the missions of all robots into an :class:`Intent`; only remembers to save work."""

    def __init__(self, world: World, rooms: RoomTraffic) -> None:
        self._rooms = rooms
        self._points = [np.asarray(room.point) for room in world.rooms]
        self._goals = _Goals((), np.full((len(world.robots), 2), np.nan))
        self._declared = _declared([])

    def intent(
        self, missions: list[Mission], memories: Sequence[QueueState], result: ControlResult
    ) -> Intent:
        """Say what all robots intend.

        Args:
            missions: of all robots.
            memories: of all queues.
            result: of the controller.
        """
        if missions != self._declared.missions:  # by identity
            self._declared = _declared(missions)
            self._goals = self._final_goals(missions)
        now = self._declared
        return Intent(
            phase=now.phase,
            goal=self._goals.points,
            waypoint=now.waypoint,
            path=now.path,
            cluster=result.cluster,
            leader=result.leader,
            slack=result.slack,
            tasks_left=now.tasks_left,
            queue=now.place,
            waits_for=self._waited_for(len(missions), memories),
        )

    def _final_goals(self, missions: Sequence[Mission]) -> _Goals:
        """Where the robots finally head; the same object if nothing changed."""
        about = tuple(
            (m.itinerary[0].room if m.itinerary else -1, m.activity, m.parking.spot)
            for m in missions
        )
        if about == self._goals.about:
            return self._goals
        return _Goals(about, np.array([self._goal_of(*robot) for robot in about]))

    def _goal_of(
        self, room: int, activity: Activity, parking_spot: tuple[float, float] | None
    ) -> Array:
        if room < 0:
            if isinstance(activity, Parking) and parking_spot is not None:
                return np.array(parking_spot)
            return NOT_A_POINT
        if isinstance(activity, Waiting) and activity.place is not None:
            queue = self._rooms.queues[activity.queue]
            if queue.is_own_spot(activity.place):
                return np.asarray(queue.spots[activity.place])
        return self._points[room]

    def _waited_for(self, robots: int, memories: Sequence[QueueState]) -> tuple[str, ...]:
        """Names of the resources that the robots wait for, "": none."""
        names = [""] * robots
        for queue, memory in zip(self._rooms.queues, memories, strict=True):
            for waiter in memory.waiters:
                names[waiter.robot] = names[waiter.robot] or queue.resource.name
        return tuple(names)


def _declared(missions: Sequence[Mission]) -> _Declared:
    numbers = [
        (int(mission.phase), len(mission.itinerary), queue_place(mission.activity))
        for mission in missions
    ]
    phase, tasks_left, place = np.array(numbers, dtype=np.int64).reshape(-1, 3).T.copy()
    routes = [mission.way.route for mission in missions]
    waypoint = np.array([route[0] if len(route) else NOT_A_POINT for route in routes])
    return _Declared(
        missions=list(missions),
        phase=phase,
        tasks_left=tasks_left,
        place=place,
        waypoint=waypoint.reshape(-1, 2),
        path=tuple(mission.way.path for mission in missions),
    )
