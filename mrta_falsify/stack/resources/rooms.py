"""Rooms are asked for, granted, entered and left; the way there, and to the waiting spots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.protocols import Waiter, WaypointGenerator
from mrta_falsify.core.world import Lane, World
from mrta_falsify.stack.mission import (
    DRIVING,
    IDLE,
    MAKING_ROOM,
    NOWHERE,
    QUEUEING,
    TO_ROOM,
    TO_SPOT,
    Mission,
    StackState,
    distance_of,
    has_reached,
    next_deadline,
)
from mrta_falsify.stack.planning_service import NO_POINTS, SPOT_REACHED, is_within
from mrta_falsify.stack.resources.queue import Queue, QueueState
from mrta_falsify.stack.waypoints import join

NEAR_SPOT = 0.9  # m, a robot this near to a waiting spot uses the way from there


class RoomTraffic:
    """The rule by which robots get at rooms; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig) -> None:
        defects = config.defects
        policy = registry.build("queue_policy", config.queue_policy, defects=defects)
        self.queues = [Queue(resource, policy, defects) for resource in world.resources]
        self.queue_of_room = {
            queue.resource.room: i
            for i, queue in enumerate(self.queues)
            if queue.resource.kind == "room"
        }
        self._of_rooms = [
            (i, queue) for i, queue in enumerate(self.queues) if queue.resource.kind == "room"
        ]
        self._waypoints: WaypointGenerator = registry.build(
            "waypoint_generator", config.waypoint_generator, defects=defects
        )
        self._lanes: dict[tuple[int, int], Lane] = {
            (lane.start, lane.end): lane for lane in world.lanes
        }
        self._points = [np.asarray(room.point) for room in world.rooms]
        self._tasks = world.tasks
        self._frees_early = "room_freed_while_parked" in defects

    def start(self, missions: Sequence[Mission], positions: Sequence[Array]) -> list[QueueState]:
        """Queues at time 0: robots hold the rooms they stand in, and know which those are."""
        queues = [QueueState() for _ in self.queues]
        for robot, (mission, position) in enumerate(zip(missions, positions, strict=True)):
            for queue, state in zip(self.queues, queues, strict=True):
                if not queue.is_left_at(position):
                    state.holders.append(robot)
                    if queue.resource.room is not None:
                        mission.room = queue.resource.room
            if mission.room < 0 and self._points:
                gaps = [distance_of(point, position) for point in self._points]
                mission.room = int(np.argmin(gaps))
        return queues

    def head_for_stop(
        self, state: StackState, robot: int, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        """Go to the room of a robot's next stop, or ask for it and go where to wait for it."""
        mission = state.missions[robot]
        room = mission.itinerary[0].room
        position = fleet.pose[robot, :2]
        index = self.queue_of_room.get(room)
        if index is None:
            self._head_for_room(mission, room, position, from_spot=False)
            return
        queue, memory = self.queues[index], state.queues[index]
        if robot in memory.holders:
            self._head_for_room(mission, room, position, from_spot=mission.place >= 0)
            return
        near = (
            mission.wants_room
            or queue.is_asked_from(position)
            or self._is_near_spot(queue, position)
        )
        if near and not mission.way.failed:
            waiter = Waiter(
                robot=robot,
                since=fleet.time,
                distance=distance_of(self._points[room], position),
                deadline=next_deadline(mission, self._tasks),
            )
            if queue.ask(memory, waiter):
                holder = -1 if queue.has_place(memory) else memory.holders[0]
                name = queue.resource.name
                events.append(
                    StackEvent(
                        time=fleet.time, kind="waits-for", robot=robot, resource=name, other=holder
                    )
                )
        self._head_for_spot(state, robot, mission, index, room, position)

    def may_serve(self, state: StackState, robot: int, room: int) -> bool:
        """Whether a robot at a room's point holds the room, or needs not to."""
        index = self.queue_of_room.get(room)
        return index is None or robot in state.queues[index].holders

    def enter(self, state: StackState, robot: int, room: int) -> float:
        """Note that a robot is served there; service time of the room itself [s], once a visit."""
        index = self.queue_of_room.get(room)
        if index is None or robot in state.queues[index].entered:
            return 0.0
        state.queues[index].entered[robot] = state.missions[robot].serve_until
        return self.queues[index].resource.service_time

    def _head_for_room(
        self, mission: Mission, room: int, position: Array, *, from_spot: bool
    ) -> None:
        mission.phase = DRIVING
        if mission.aim == TO_ROOM:
            return
        index = self.queue_of_room.get(room)
        lane = self._lanes.get((mission.room, room))
        entry = self.queues[index].resource.entry if index is not None else NO_POINTS
        if from_spot or (lane is None and len(entry)):
            route = join(entry, position) if not from_spot else np.asarray(entry)
        elif lane is None:
            route = self._points[room][None, :]
        else:
            route = join(self._waypoints.to_room(lane), position, self._points[mission.room])
        if not len(route):
            route = self._points[room][None, :]
        mission.aim, mission.place, mission.parking = TO_ROOM, -1, -1
        mission.stops_short_of, mission.wants_room = -1, False
        mission.unreachable.clear()
        mission.way.head_for(np.asarray(route))

    def _head_for_spot(
        self,
        state: StackState,
        robot: int,
        mission: Mission,
        index: int,
        room: int,
        position: Array,
    ) -> None:
        queue = self.queues[index]
        spots = queue.resource.spots
        place = queue.place_of(state.queues[index], robot)
        if mission.aim == TO_SPOT and mission.place == place:
            self._note_waiting(mission, position)
            return
        lane = self._lanes.get((mission.room, room))
        moves_up = mission.aim == TO_SPOT and self._is_near_spot(queue, position)
        if not len(spots):
            # Nowhere to wait: on the way to the room, short of it.
            mission.stops_short_of = index
            if lane is None:
                route = self._points[room][None, :]
            else:
                way = self._waypoints.to_room(lane)
                route = join(way, position, self._points[mission.room])
        else:
            approach = spots if lane is None else np.asarray(lane.to_queue)
            spot = queue.waiting_point(place if place >= 0 else len(spots) - 1, approach)
            if lane is None or moves_up:
                route = spot[None, :]
            else:
                way = self._waypoints.to_queue(lane, spot)
                route = join(way, position, self._points[mission.room])
        goes_on = mission.stops_short_of >= 0 and mission.aim == TO_SPOT
        mission.aim, mission.place, mission.parking = TO_SPOT, place, -1
        mission.unreachable.clear()
        if not goes_on:
            mission.way.head_for(np.asarray(route))
        self._note_waiting(mission, position)

    @staticmethod
    def _note_waiting(mission: Mission, position: Array) -> None:
        """Queueing as soon as the robot stands at its place; a little later on the way back."""
        reach = 2.0 * SPOT_REACHED if mission.phase is QUEUEING else SPOT_REACHED
        arrived = (
            mission.stops_short_of < 0
            and mission.place >= 0
            and len(mission.way.route) > 0
            and has_reached(mission.way.route[-1], position, reach, mission.way)
        )
        mission.phase = QUEUEING if arrived else DRIVING

    @staticmethod
    def _is_near_spot(queue: Queue, position: Array) -> bool:
        return bool(is_within(queue.resource.spots, position, NEAR_SPOT))

    def leave(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Take back rooms that were left and requests of those who head elsewhere now."""
        for index, queue in self._of_rooms:
            memory = state.queues[index]
            if not memory.holders and not memory.waiters:
                continue
            for robot in tuple(memory.holders):
                mission = state.missions[robot]
                heads_here = (
                    bool(mission.itinerary) and mission.itinerary[0].room == queue.resource.room
                )
                outside = queue.is_left_at(fleet.pose[robot, :2])
                shut_out = outside and bool(mission.way.failed) and bool(memory.waiters)
                if heads_here and shut_out:
                    mission.aim = NOWHERE  # it asks again when there is a way
                elif heads_here and mission.aim in (TO_ROOM, NOWHERE):
                    continue
                if shut_out or self._lets_go(queue, memory, robot, mission, fleet):
                    queue.release(memory, robot)
                    name = queue.resource.name
                    events.append(
                        StackEvent(time=fleet.time, kind="released", robot=robot, resource=name)
                    )
                    self._note_grants(queue.careless_admission(memory), queue, fleet, events)
            for waiter in tuple(memory.waiters):
                mission = state.missions[waiter.robot]
                room = queue.resource.room
                if not mission.itinerary or mission.itinerary[0].room != room:
                    queue.withdraw(memory, waiter.robot)
                    self._note_grants(queue.careless_admission(memory), queue, fleet, events)

    def _lets_go(
        self, queue: Queue, memory: QueueState, robot: int, mission: Mission, fleet: FleetState
    ) -> bool:
        """Whether a holder that has no further stop in the room gives it back."""
        has_finished = not mission.itinerary and mission.phase in (IDLE, MAKING_ROOM)
        if has_finished and self._frees_early:
            return True
        if queue.resource.hold == "until_served" and robot in memory.entered:
            return True
        return queue.is_left_at(fleet.pose[robot, :2])

    def grant(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Give free rooms to those who wait for them, and send them in."""
        for index, queue in self._of_rooms:
            memory = state.queues[index]
            if not memory.waiters:
                continue
            granted = queue.grant(memory)
            self._note_grants(granted, queue, fleet, events)
            for robot in granted:
                mission = state.missions[robot]
                room = mission.itinerary[0].room
                position = fleet.pose[robot, :2]
                waited = self._is_near_spot(queue, position)
                self._head_for_room(mission, room, position, from_spot=waited)

    @staticmethod
    def _note_grants(
        granted: Sequence[int], queue: Queue, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        name = queue.resource.name
        for robot in granted:
            events.append(StackEvent(time=fleet.time, kind="granted", robot=robot, resource=name))
