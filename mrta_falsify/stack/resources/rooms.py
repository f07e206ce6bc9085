"""Rooms: when robots ask for them, enter them and leave them, and their ways there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.plane import NO_POINTS, distance_of, inside, is_within
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.protocols import Waiter, WaypointGenerator
from mrta_falsify.core.world import Lane, Resource, World
from mrta_falsify.stack.activity import Heading, Idle, Parking, Stalled, Waiting
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.mission_table import MissionTable, record_of
from mrta_falsify.stack.resources.clear_ways import ClearWays
from mrta_falsify.stack.resources.queue import Queue, QueueState, WaitingSpots
from mrta_falsify.stack.route import SPOT_REACHED
from mrta_falsify.stack.waypoints import join

NEAR_SPOT = 0.9  # m, a robot this near to a waiting spot drives on from the spot

_OUTSIDE = (Waiting, Parking, Stalled)  # activities of holders that do not use the room any more

#: what a mission says of rooms
ROOM_RECORD = record_of(
    ("next", np.int64),  # number of the first stop's room, -1: none
    ("kept", np.int64),  # the same, if the robot does not let go of it wherever it is
)


#: by the number of a queue: the place of each of its waiters
Places = dict[int, dict[int, int]]


class Grounds(NamedTuple):
    """Where the resources of Q queues are asked for."""

    corner: Array  #: (sum V, 2) of all request areas, one after the other [m]
    first_corner: IntArray  #: (Q + 1,) where each area begins
    spot: Array  #: (sum S, 2) waiting spots of all queues [m]
    first_spot: IntArray  #: (Q + 1,) where those of each queue begin


class RoomTraffic:
    """The rule by which robots get into rooms; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig, ways: ClearWays) -> None:
        defects = config.defects
        policy = registry.build("queue_policy", config.queue_policy, defects=defects)
        queue_class = with_defects(Queue, defects)
        self.queues = [
            queue_class(resource, policy, _waiting_spots(resource, world, ways))
            for resource in world.resources
        ]
        areas = Polylines.of([np.asarray(queue.resource.request_area) for queue in self.queues])
        spots = Polylines.of([queue.spots.reshape(-1, 2) for queue in self.queues])
        self.grounds = Grounds(areas.points, areas.first, spots.points, spots.first)
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
        self._table = MissionTable(ROOM_RECORD, _room_of)

    def start(self, positions: Sequence[Array]) -> tuple[list[Mission], list[QueueState]]:
        """Begin at time 0: robots hold the rooms they stand in, and know which those are."""
        memories = [QueueState() for _ in self.queues]
        rooms = []
        for robot, position in enumerate(positions):
            room = -1
            for queue, memory in zip(self.queues, memories, strict=True):
                if not queue.is_left_at(position):
                    memory.holders.append(robot)
                    memory.unasked.append(robot)
                    if queue.resource.room is not None:
                        room = queue.resource.room
            if room < 0 and self._points:
                room = int(np.argmin([distance_of(point, position) for point in self._points]))
            rooms.append(room)
        return [Mission(room=room) for room in rooms], memories

    # --- asking for the room of the next stop -----------------------------------------------

    def head_for_stop(
        self, robot: int, mission: Mission, memories: Sequence[QueueState], fleet: FleetState
    ) -> tuple[Mission, list[StackEvent]]:
        """Go to the room of a robot's next stop, or ask for it and go where to wait for it.

        Of more holders than the room has place for, those nearest to its point go there. The
        others leave, and ask as all do.
        """
        room = mission.itinerary[0].room
        position = fleet.pose[robot, :2]
        index = self.queue_of_room.get(room)
        if index is None:
            return self._head_for_room(mission, position, from_spot=False), []
        queue, memory = self.queues[index], memories[index]
        if robot in memory.holders:
            if self._is_one_too_many(index, memory, robot, fleet.pose):
                return self._wait(mission, index, None, position), []
            activity = mission.activity
            from_spot = isinstance(activity, Waiting) and activity.place is not None
            return self._head_for_room(mission, position, from_spot=from_spot), []
        events: list[StackEvent] = []
        near = mission.passage.asks_for_room or is_on_grounds(self.grounds, index, position)
        if near and not mission.way.failed:
            waiter = Waiter(
                robot=robot,
                since=fleet.time,
                distance=distance_of(self._points[room], position),
                deadline=mission.next_deadline(self._tasks),
            )
            events = queue.request(memory, waiter)
        place = queue.place_of(memory, robot)
        return self._wait(mission, index, place, position), events

    def queue_of_next(self, mission: Mission) -> int:
        """Give the number of the queue of a mission's next stop, -1: none."""
        stops = mission.itinerary
        return self.queue_of_room.get(stops[0].room, -1) if stops else -1

    def goes_on_waiting(
        self,
        robot: int,
        mission: Mission,
        memories: Sequence[QueueState],
        away: float | None,
        places: Places,
    ) -> bool:
        """Renew what a queue knows of a waiter; False: the waiter's place is another now.

        Where the place is the same, that is all that :meth:`head_for_stop` would do for a robot
        that neither comes to its place nor leaves it.

        Args:
            robot: number.
            mission: of the robot, with an activity of ``Waiting``.
            memories: of all queues.
            away: how far the robot is from the room [m]; None: it does not ask from where it is.
            places: known so far; brought up to date.
        """
        waiting = mission.activity
        assert isinstance(waiting, Waiting)
        queue, memory = self.queues[waiting.queue], memories[waiting.queue]
        if away is not None and queue.renew(
            memory, robot, away, mission.next_deadline(self._tasks)
        ):
            places.pop(waiting.queue, None)  # a policy may look at it
        if waiting.queue not in places:
            places[waiting.queue] = {one: k for k, one in enumerate(queue.order(memory))}
        return places[waiting.queue].get(robot) == waiting.place

    def _is_one_too_many(self, index: int, memory: QueueState, robot: int, pose: Array) -> bool:
        """Whether a robot holds an overfull room unasked, and others are nearer to its point.

        More robots than a room has place for may stand in it, or at its door, at time 0.
        """
        queue = self.queues[index]
        if len(memory.holders) <= queue.resource.capacity or robot not in memory.unasked:
            return False
        room = queue.resource.room
        assert room is not None
        point = self._points[room]
        nearest = sorted(memory.holders, key=lambda one: (distance_of(point, pose[one, :2]), one))
        return robot not in nearest[: queue.resource.capacity]

    def may_serve(self, memories: Sequence[QueueState], robot: int, room: int) -> bool:
        """Whether a robot at a room's point holds the room, or need not hold it."""
        index = self.queue_of_room.get(room)
        return index is None or robot in memories[index].holders

    def enter(self, memories: Sequence[QueueState], robot: int, room: int, time: float) -> float:
        """Note that a robot is served there; service time of the room itself [s], once a visit."""
        index = self.queue_of_room.get(room)
        if index is None or robot in memories[index].entered:
            return 0.0
        memories[index].entered[robot] = time
        return self.queues[index].resource.service_time

    def closed(self, memories: Sequence[QueueState], robots: int) -> BoolArray:
        """Say which resources others hold, up to their capacity: ``(N, A)``."""
        closed = np.zeros((robots, len(self.queues)), dtype=np.bool_)
        for index, (queue, memory) in enumerate(zip(self.queues, memories, strict=True)):
            if not queue.has_place(memory):
                closed[:, index] = True
                for robot in memory.holders:
                    closed[robot, index] = False
        return closed

    # --- the ways there -----------------------------------------------------------------------

    def _head_for_room(self, mission: Mission, position: Array, *, from_spot: bool) -> Mission:
        if isinstance(mission.activity, Heading):
            return mission
        room = mission.itinerary[0].room
        index = self.queue_of_room.get(room)
        entry = () if index is None else self.queues[index].resource.entry
        if from_spot:
            route = np.asarray(entry)
        elif (mission.room, room) not in self._lanes and len(entry):
            route = join(np.asarray(entry), position)
        else:
            route = self._way_to_room(mission, room, position)
        if not len(route):
            route = self._points[room][None, :]
        return mission.depart(Heading(), route)

    def _wait(self, mission: Mission, index: int, place: int | None, position: Array) -> Mission:
        """Go to the place in the queue, or stand there."""
        before = mission.activity
        if not isinstance(before, Waiting) or before.place != place:
            mission = self._line_up(mission, index, place, position)
        waiting, way = mission.activity, mission.way
        assert isinstance(waiting, Waiting)
        # Queueing as soon as the robot stands at its place, a little later on the way back.
        reach = 2.0 * SPOT_REACHED if waiting.arrived else SPOT_REACHED
        arrived = (
            place is not None
            and len(way.route) > 0
            and len(self.queues[index].spots) > 0
            and way.has_reached(way.route[-1], position, reach)
        )
        if arrived == waiting.arrived:
            return mission
        return replace(mission, activity=replace(waiting, arrived=arrived))

    def _line_up(self, mission: Mission, index: int, place: int | None, position: Array) -> Mission:
        """Take up a place in the queue; without waiting spots, head for the room itself."""
        queue, before = self.queues[index], mission.activity
        was_waiting = isinstance(before, Waiting)
        activity = Waiting(index, place, isinstance(before, Waiting) and before.arrived)
        if len(queue.spots):
            moves_up = was_waiting and _is_near_spot(queue, position)
            route = self._way_to_spot(mission, queue, place, position, moves_up=moves_up)
            return mission.depart(activity, route)
        if was_waiting:
            return replace(mission, activity=activity, parking=mission.parking.given_up())
        room = mission.itinerary[0].room
        return mission.depart(activity, self._way_to_room(mission, room, position))

    def _way_to_room(self, mission: Mission, room: int, position: Array) -> Array:
        lane = self._lanes.get((mission.room, room))
        if lane is None:
            return self._points[room][None, :]
        return self._joined(self._waypoints.to_room(lane), mission.room, position)

    def _way_to_spot(
        self, mission: Mission, queue: Queue, place: int | None, position: Array, *, moves_up: bool
    ) -> Array:
        """Find the way to a place in the queue, to the last spot while the place is unknown."""
        lane = self._lanes.get((mission.room, mission.itinerary[0].room))
        spots = queue.spots
        approach = spots if lane is None else np.asarray(lane.to_queue)
        target = len(spots) - 1 if place is None else place
        spot = queue.waiting_point(target, approach)
        if lane is None or moves_up or queue.is_off_lane(target):
            return spot[None, :]
        return self._joined(self._waypoints.to_queue(lane, spot), mission.room, position)

    def _joined(self, way: Array, start: int, position: Array) -> Array:
        """Join a way from room ``start``; a robot that has left the room does not go back in."""
        rest = join(way, position, self._points[start])
        index = self.queue_of_room.get(start)
        if index is None or not self.queues[index].is_left_at(position):
            return rest
        area = self.queues[index].resource.release_area
        while len(rest) > 1 and inside(area, rest[0]):
            rest = rest[1:]
        return rest

    # --- leaving and granting -------------------------------------------------------------------

    def leave(
        self, missions: list[Mission], memories: Sequence[QueueState], fleet: FleetState
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Take back rooms that were left, and requests of robots that head elsewhere now."""
        missions = list(missions)
        events: list[StackEvent] = []
        rows = self._table.rows(missions)
        kept, next_room = rows["kept"].tolist(), rows["next"].tolist()
        for index, queue in self._of_rooms:
            memory, room = memories[index], queue.resource.room
            for robot in tuple(memory.holders):
                if kept[robot] == room:
                    continue
                missions[robot], lets_go = self._may_let_go(
                    queue, memory, robot, missions[robot], fleet.pose[robot, :2]
                )
                if lets_go:
                    events += queue.let_go(memory, robot, fleet.time, fleet.pose[robot, :2])
            for waiter in tuple(memory.waiters):
                if next_room[waiter.robot] != room:
                    events += queue.turn_away(memory, waiter.robot, fleet.time)
        return missions, events

    def _may_let_go(
        self, queue: Queue, memory: QueueState, robot: int, mission: Mission, position: Array
    ) -> tuple[Mission, bool]:
        """Whether a holder gives the room back, and its mission then."""
        if mission.itinerary and mission.itinerary[0].room == queue.resource.room:
            shut_out = (
                bool(mission.way.failed) and bool(memory.waiters) and queue.is_left_at(position)
            )
            if shut_out:  # it asks again when there is a way
                return replace(mission, activity=Idle()), True
            if not isinstance(mission.activity, _OUTSIDE):
                return mission, False
        if queue.resource.hold == "until_served" and robot in memory.entered:
            return mission, True
        return mission, queue.is_left_at(position)

    def grant(
        self, missions: Sequence[Mission], memories: Sequence[QueueState], fleet: FleetState
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Give free rooms to those who wait for them, and send them in."""
        missions = list(missions)
        events: list[StackEvent] = []
        for index, queue in self._of_rooms:
            if not memories[index].waiters or not queue.has_place(memories[index]):
                continue
            granted = queue.grant(memories[index])
            events += queue.grants(granted, fleet.time)
            for robot in granted:
                position = fleet.pose[robot, :2]
                from_spot = _is_near_spot(queue, position)
                missions[robot] = self._head_for_room(
                    missions[robot], position, from_spot=from_spot
                )
        return missions, events


def _waiting_spots(resource: Resource, world: World, ways: ClearWays) -> WaitingSpots | None:
    """Replace the waiting spots of a room that would close the only way out of it.

    Returns:
        The spots that leave the ways open, then places near by for all other robots. None if the
        resource's own spots will do.
    """
    if resource.room is None or not len(resource.spots):
        return None
    stands: list[Array] = []
    for spot in resource.spots:
        if ways.leaves_open(np.array([*stands, spot])):
            stands.append(np.asarray(spot))
    own = len(stands)
    if own == len(resource.spots):
        return None
    stands += ways.places_near(
        np.asarray(world.rooms[resource.room].point),
        beside=NO_POINTS,
        off=NO_POINTS,
        stands=stands,
        count=max(len(resource.spots), len(world.robots) - 1) - own,
    )
    return WaitingSpots(np.array(stands).reshape(-1, 2), own)


@njit(cache=True)
def is_on_grounds(grounds: Grounds, queue: int, position: Array) -> bool:
    """Whether a robot is where it asks for the resource of a queue: near enough, or at a spot."""
    corners = grounds.corner[grounds.first_corner[queue] : grounds.first_corner[queue + 1]]
    spots = grounds.spot[grounds.first_spot[queue] : grounds.first_spot[queue + 1]]
    return bool(inside(corners, position) or is_within(spots, position, NEAR_SPOT))


def _is_near_spot(queue: Queue, position: Array) -> bool:
    return bool(is_within(queue.spots, position, NEAR_SPOT))


def _room_of(robot: int, mission: Mission) -> tuple[object, ...]:
    """Describe a mission by a ROOM_RECORD."""
    del robot
    room = mission.itinerary[0].room if mission.itinerary else -1
    keeps = not mission.way.failed and not isinstance(mission.activity, _OUTSIDE)
    return room, room if keeps else -1
