"""What the stack tells the observer each tick: where the robots head, and what they wait for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
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


class Declaration:
    """Puts the missions of all robots into an :class:`Intent`; only remembers to save work."""

    def __init__(self, world: World, rooms: RoomTraffic) -> None:
        self._rooms = rooms
        self._points = [np.asarray(room.point) for room in world.rooms]
        self._goals = _Goals((), np.full((len(world.robots), 2), np.nan))

    def intent(
        self,
        missions: Sequence[Mission],
        memories: Sequence[QueueState],
        waypoint: Array,
        result: ControlResult,
    ) -> Intent:
        """Say what all robots intend.

        Args:
            missions: of all robots.
            memories: of all queues.
            waypoint: ``(N, 2)`` next waypoints [m], nan: none.
            result: of the controller.
        """
        numbers = np.array(
            [
                [int(mission.phase) for mission in missions],
                [len(mission.itinerary) for mission in missions],
                [queue_place(mission.activity) for mission in missions],
            ],
            dtype=np.int64,
        )
        phase, tasks_left, place = numbers
        return Intent(
            phase=phase,
            goal=self._final_goals(missions),
            waypoint=waypoint,
            path=tuple(mission.way.path for mission in missions),
            cluster=result.cluster,
            leader=result.leader,
            slack=result.slack,
            tasks_left=tasks_left,
            queue=place,
            waits_for=self._waited_for(len(missions), memories),
        )

    def _final_goals(self, missions: Sequence[Mission]) -> Array:
        """Where the robots finally head ``(N, 2)`` [m]; the same object if nothing changed."""
        about = tuple(
            (m.itinerary[0].room if m.itinerary else -1, m.activity, m.parking.spot)
            for m in missions
        )
        if about != self._goals.about:
            points = np.array([self._goal_of(*robot) for robot in about])
            self._goals = _Goals(about, points)
        return self._goals.points

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
