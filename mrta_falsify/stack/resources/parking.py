"""Idle robots leave what others ask for, and where they stand in the way."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.world import World
from mrta_falsify.stack.lookahead import LOOK_AHEAD
from mrta_falsify.stack.mission import (
    IDLE,
    MAKING_ROOM,
    NOWHERE,
    TO_PARKING,
    Mission,
    StackState,
    distance_of,
    has_reached,
)
from mrta_falsify.stack.planning_service import (
    NO_POINTS,
    RETRY,
    SPOT_REACHED,
    cut_path,
    is_within,
    look_along,
)
from mrta_falsify.stack.resources.parking_spots import APART, choose_refuge, refuges_of
from mrta_falsify.stack.resources.rooms import RoomTraffic

LOOK_TICKS = 10  # between two looks whether a robot is in the way, 2 Hz at 20 Hz control
IN_THE_WAY_AFTER = 5.0  # s without progress, then an idle robot ahead is sent away
CLEARED = 1.5  # m of a stuck robot's path that idle robots have to clear


class MakingRoom:
    """The rule by which idle robots are sent to refuges; has no memory of its own."""

    def __init__(self, world: World, rooms: RoomTraffic, defects: frozenset[str]) -> None:
        self._rooms = rooms
        self._refuges = refuges_of(world)
        # the defect: nobody minds a robot that is parked in a room it has freed, or on the way
        self._is_careless = "room_freed_while_parked" in defects

    def refuge(self, number: int) -> Array:
        """Its point ``(2,)`` [m]."""
        return np.asarray(self._refuges.points[number])

    def step(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Idle robots leave what others ask for; those that arrived at a refuge rest."""
        resting = []
        for robot, mission in enumerate(state.missions):
            if mission.aim == TO_PARKING:
                self._end_parking(mission, robot, fleet)
            if (
                mission.phase is IDLE
                and mission.aim == NOWHERE
                and not mission.itinerary
                and fleet.time >= mission.park_at
            ):
                resting.append(robot)
        if not resting:
            return
        wanted = self._wanted_queues(state)
        for robot in resting:
            for index, other in wanted.items():
                if self._occupies(state, index, robot, fleet.pose[robot, :2]):
                    name = self._rooms.queues[index].resource.name
                    self._send_away(state, robot, fleet, events, name=name, other=other)
                    break
            else:
                if (fleet.tick + robot) % LOOK_TICKS == 0:
                    self._clear_way(state, robot, fleet, events)

    def _end_parking(self, mission: Mission, robot: int, fleet: FleetState) -> None:
        place = self._refuges.points[mission.parking]
        if has_reached(place, fleet.pose[robot, :2], SPOT_REACHED, mission.way):
            mission.unreachable.clear()
        elif mission.way.failed:
            mission.unreachable.append(mission.parking)
            mission.parking = -1
        else:
            return
        mission.way.stop()
        mission.aim, mission.phase = NOWHERE, IDLE

    def _wanted_queues(self, state: StackState) -> dict[int, int]:
        """Resources that somebody waits for or is on the way to, and who that is."""
        wanted: dict[int, int] = {}
        for robot, mission in enumerate(state.missions):
            if mission.itinerary:
                index = self._rooms.queue_of_room.get(mission.itinerary[0].room)
                if index is not None:
                    wanted.setdefault(index, robot)
        for index, memory in enumerate(state.queues):
            if memory.waiters:
                wanted[index] = memory.waiters[0].robot
        return wanted

    def _occupies(self, state: StackState, index: int, robot: int, position: Array) -> bool:
        if robot in state.queues[index].holders:
            return True
        return not self._is_careless and not self._rooms.queues[index].is_left_at(position)

    def _clear_way(
        self, state: StackState, robot: int, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        """Send an idle robot away from another's destination, or from where one is stuck."""
        if self._is_careless:
            return
        position = fleet.pose[robot, :2]
        for other, mission in enumerate(state.missions):
            way = mission.way
            if other == robot or not way.is_going:
                continue
            end = way.halt[0] if len(way.halt) else way.route[-1]
            stuck = fleet.time - mission.moved_at > IN_THE_WAY_AFTER and len(way.path) > 0
            ahead = NO_POINTS
            if stuck:
                x, y, _ = fleet.pose[other]
                ahead = cut_path(look_along(way.path, x, y, LOOK_AHEAD)[0], CLEARED)
            covers_end = distance_of(end, position) < APART
            if covers_end or is_within(ahead, position, APART):
                avoid = np.vstack([ahead, end[None, :]])
                self._send_away(state, robot, fleet, events, other=other, avoid=avoid)
                return

    def _send_away(
        self,
        state: StackState,
        robot: int,
        fleet: FleetState,
        events: list[StackEvent],
        *,
        name: str = "",
        other: int = -1,
        avoid: Array = NO_POINTS,
    ) -> None:
        mission = state.missions[robot]
        excluded = {m.parking for m in state.missions} | set(mission.unreachable)
        here = np.delete(fleet.pose[:, :2], robot, axis=0)
        ends = [
            m.way.route[-1] for i, m in enumerate(state.missions) if i != robot and m.way.is_going
        ]
        others = np.vstack([here, *(end[None, :] for end in ends)])
        position = fleet.pose[robot, :2]
        place = choose_refuge(self._refuges, position, others, avoid, excluded)
        mission.park_at = fleet.time + RETRY
        if place < 0:
            mission.unreachable.clear()
            return
        mission.parking, mission.aim, mission.phase = place, TO_PARKING, MAKING_ROOM
        mission.way.head_for(self._refuges.points[place][None, :])
        events.append(
            StackEvent(time=fleet.time, kind="makes-room", robot=robot, resource=name, other=other)
        )
