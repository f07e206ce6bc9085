"""Parking: idle robots leave what others ask for, and where they stand in the way."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.plane import NO_POINTS, distance_of, inside, is_within
from mrta_falsify.core.polyline import cut_path, look_along
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Idle, Parking
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.mission import Mission, StackState
from mrta_falsify.stack.resources.clear_ways import APART, OFF_WAY, ClearWays
from mrta_falsify.stack.resources.queue import Queue, QueueState
from mrta_falsify.stack.resources.rooms import RoomTraffic
from mrta_falsify.stack.route import LOOK_AHEAD, RETRY, SPOT_REACHED

Point: TypeAlias = tuple[float, float]  # x, y [m], map frame


@dataclass(frozen=True, slots=True, eq=False)
class ParkingSpots:
    """Points to park at, best kind first."""

    points: Array  #: (P, 2) [m]
    kind: Array  #: (P,) 0: parking of the world, 1: waiting spot, 2: corner of a lane
    ways: ClearWays  #: finds more where all of these are taken


def parking_spots_of(world: World, ways: ClearWays) -> ParkingSpots:
    """List the parking of the world, then waiting spots and corners of lanes.

    Spots and corners inside a release area are left out, and those where a robot would close the
    only way between two rooms. Parking inside a release area counts as a waiting spot.
    """
    found: list[tuple[int, Array]] = [(0, point) for point in world.parking]
    found += [(1, spot) for resource in world.resources for spot in resource.spots]
    found += [(2, corner) for lane in world.lanes for corner in lane.to_queue[:-1]]
    points = np.empty((len(found), 2))
    kinds: list[float] = []
    for kind, point in found:
        guarded = any(inside(resource.release_area, point) for resource in world.resources)
        if guarded and kind > 0:
            continue
        gaps = point - points[: len(kinds)]
        if (np.hypot(gaps[:, 0], gaps[:, 1]) < APART).any():
            continue
        if kind > 0 and not ways.leaves_open(point[None, :]):
            continue
        points[len(kinds)] = point
        kinds.append(1.0 if guarded else float(kind))
    return ParkingSpots(points[: len(kinds)], np.array(kinds), ways)


def choose_spot(
    spots: ParkingSpots,
    position: Array,
    others: Array,
    avoid: Array,
    excluded: Collection[Point],
) -> Point | None:
    """Choose the nearest free spot of the best kind, else the nearest place that is in no way.

    Args:
        spots: to choose from.
        position: ``(2,)`` of the robot that is to go [m].
        others: ``(K, 2)`` robots, and places that robots drive to [m].
        avoid: ``(L, 2)`` points of a way to be cleared [m], may be empty.
        excluded: spots that are taken, or that could not be reached.

    Returns:
        The spot, None if there is none.
    """
    gaps = np.hypot(*(spots.points - position).T)
    for number in np.lexsort((gaps, spots.kind)).tolist():
        point = spots.points[number]
        x, y = point.tolist()
        if (x, y) in excluded or _near(point, others, APART) or _near(point, avoid, OFF_WAY):
            continue
        return x, y
    known = np.array(list(excluded), dtype=np.float64).reshape(-1, 2)
    free = spots.ways.places_near(position, beside=others, off=np.vstack([avoid, known]), count=1)
    return (float(free[0][0]), float(free[0][1])) if free else None


def _near(point: Array, points: Array, distance: float) -> bool:
    return len(points) > 0 and bool(np.hypot(*(points - point).T).min() <= distance)


LOOK_TICKS = 10  # between two looks whether a robot is in the way, 2 Hz at 20 Hz control
IN_THE_WAY_AFTER = 5.0  # s without progress, then an idle robot ahead is sent away
CLEARED = 1.5  # m of a stuck robot's path that idle robots have to clear


@dataclass(frozen=True, slots=True, eq=False)
class Reason:
    """Why an idle robot has to leave."""

    other: int  #: robot that wants the resource, or the way; -1: any that comes
    resource: str  #: name of the resource, "" if it is about the way
    avoid: Array  #: (L, 2) the way to be cleared [m], may be empty


class ParkingTraffic:
    """The rule by which idle robots are sent to parking spots; has no memory of its own."""

    def __init__(self, world: World, rooms: RoomTraffic, ways: ClearWays) -> None:
        """Serve a world.

        Args:
            world: parking, waiting spots and lanes.
            rooms: tells which queue guards a room.
            ways: tells where a robot at rest closes the only way between two rooms.
        """
        self._rooms = rooms
        self._ways = ways
        self._spots = parking_spots_of(world, ways)

    def step(
        self, missions: Sequence[Mission], state: StackState, fleet: FleetState
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Let robots that arrived at their spot rest, and send away those in the way."""
        memories, resting = state.queues, []
        missions, events = list(missions), []
        for robot, mission in enumerate(missions):
            if isinstance(mission.activity, Parking):
                missions[robot] = self._arrived(mission, fleet.pose[robot, :2])
            now = missions[robot]
            is_resting = isinstance(now.activity, Idle) and not now.itinerary
            if is_resting and fleet.time >= now.parking.not_before:
                resting.append(robot)
        wanted = self._wanted_queues(missions, memories) if resting else {}
        for robot in resting:
            reason = self._occupied(memories, wanted, robot, fleet.pose[robot, :2])
            if reason is None and (fleet.tick + robot) % LOOK_TICKS == 0:
                reason = self._blocked(missions, state.headway, robot, fleet)
                if reason is None and missions[robot].has_delivered:
                    reason = self._in_crossing(fleet.pose[robot, :2])
            if reason is not None:
                missions[robot], left = self._send_away(missions, robot, fleet, reason)
                events += left
        return missions, events

    def _arrived(self, mission: Mission, position: Array) -> Mission:
        """End the way to a parking spot, if it is reached or has no path."""
        memory, spot = mission.parking, mission.parking.spot
        assert spot is not None
        if mission.way.has_reached(np.array(spot), position, SPOT_REACHED):
            memory = replace(memory, unreachable=())
        elif mission.way.failed:
            memory = replace(memory, spot=None, unreachable=(*memory.unreachable, spot))
        else:
            return mission
        return replace(mission.rest(), parking=memory)

    # --- why a robot has to leave ---------------------------------------------------------------

    def _wanted_queues(
        self, missions: Sequence[Mission], memories: Sequence[QueueState]
    ) -> dict[int, int]:
        """Queues that a robot waits in or is on the way to, and the number of that robot."""
        wanted: dict[int, int] = {}
        for robot, mission in enumerate(missions):
            if mission.itinerary:
                index = self._rooms.queue_of_room.get(mission.itinerary[0].room)
                if index is not None:
                    wanted.setdefault(index, robot)
        for index, memory in enumerate(memories):
            if memory.waiters:
                wanted[index] = memory.waiters[0].robot
        return wanted

    def _occupied(
        self,
        memories: Sequence[QueueState],
        wanted: dict[int, int],
        robot: int,
        position: Array,
    ) -> Reason | None:
        """Find a resource that a robot occupies and another one wants."""
        for index, other in wanted.items():
            queue = self._rooms.queues[index]
            if robot in memories[index].holders or self._stands_in(queue, position):
                return Reason(other, queue.resource.name, NO_POINTS)
        return None

    def _stands_in(self, queue: Queue, position: Array) -> bool:
        """Whether a robot at rest here is in the way of those who ask for the resource."""
        return not queue.is_left_at(position)

    def _blocked(
        self, missions: Sequence[Mission], headway: Headway, robot: int, fleet: FleetState
    ) -> Reason | None:
        """Find a robot whose destination an idle robot covers, or that is stuck before it."""
        position = fleet.pose[robot, :2]
        for other, mission in enumerate(missions):
            way = mission.way
            if other == robot or not way.is_going:
                continue
            end = way.halt[0] if len(way.halt) else way.route[-1]
            stuck = fleet.time - headway.moved_at[other] > IN_THE_WAY_AFTER and len(way.path) > 0
            ahead = NO_POINTS
            if stuck:
                x, y, _ = fleet.pose[other]
                ahead = cut_path(look_along(way.path, x, y, LOOK_AHEAD)[0], CLEARED)
            if distance_of(end, position) < APART or is_within(ahead, position, APART):
                return Reason(other, "", np.vstack([ahead, end[None, :]]))
        return None

    def _in_crossing(self, position: Array) -> Reason | None:
        """Whether a robot at rest here would close the only way between two rooms."""
        if self._ways.leaves_open(position[None, :]):
            return None
        return Reason(-1, "", NO_POINTS)

    # --- where it goes ----------------------------------------------------------------------------

    def _send_away(
        self, missions: Sequence[Mission], robot: int, fleet: FleetState, reason: Reason
    ) -> tuple[Mission, list[StackEvent]]:
        mission = missions[robot]
        reserved = {m.parking.spot for m in missions if m.parking.spot is not None}
        here = np.delete(fleet.pose[:, :2], robot, axis=0)
        ends = [m.way.route[-1] for i, m in enumerate(missions) if i != robot and m.way.is_going]
        others = np.vstack([here, *(end[None, :] for end in ends)])
        excluded = reserved | set(mission.parking.unreachable)
        spot = choose_spot(self._spots, fleet.pose[robot, :2], others, reason.avoid, excluded)
        memory = replace(mission.parking, not_before=fleet.time + RETRY)
        if spot is None:
            return replace(mission, parking=replace(memory, unreachable=())), []
        leaving = replace(
            mission,
            activity=Parking(),
            way=mission.way.head_for(np.array([spot])),
            parking=replace(memory, spot=spot),
        )
        event = StackEvent(
            time=fleet.time,
            kind="makes-room",
            robot=robot,
            resource=reason.resource,
            other=reason.other,
        )
        return leaving, [event]
