"""How robots work off their itineraries: drive to a room, load or unload, drive on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.plane import distance_of, is_near
from mrta_falsify.core.polyline import look_along, path_length
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Heading, Idle, Off, Parking, Serving, Stalled, Waiting
from mrta_falsify.stack.dispatcher import Dispatcher
from mrta_falsify.stack.mission import Mission, StackState
from mrta_falsify.stack.mission_table import MissionTable, Rows, record_of
from mrta_falsify.stack.resources.queue import QueueState
from mrta_falsify.stack.resources.rooms import Grounds, RoomTraffic, is_on_grounds
from mrta_falsify.stack.route import AT_PATH_END, LOOK_AHEAD, ROOM_REACHED

AT_REST = 0.1  # m/s, slow enough to load and unload
MEAN_SPEED = 0.69  # m/s, loaded travel times of MRTA-Sim over its road lengths
NO_PATH_DELAY = 120.0  # s that a robot without a path is expected to be late

NEARLY = 1e-6  # m, who is so near to being somewhere is asked

#: when a robot has something to do about its next stop
STOP_RECORD = record_of(
    ("now", np.bool_),  # at once
    ("until", np.float64),  # from then on [s]; inf: not by the clock
    ("point", np.float64, (2,)),  # as soon as it rests where it may be served [m], nan: nowhere
    ("end", np.float64, (2,)),  # the same at the end of its path [m]
    ("queue", np.int64),  # as soon as it is where this queue's room is asked for, -1: none
)
NOWHERE = (np.nan, np.nan)
NOTHING_TO_DO = (False, np.inf, NOWHERE, NOWHERE, -1)
SOMETHING_TO_DO = (True, np.inf, NOWHERE, NOWHERE, -1)


class ItineraryFollower:
    """The rule by which robots work on their next stop; has no memory that decides anything.

    Args:
        world: of the episode.
        rooms: are asked for.
        dispatcher: knows travel times.
    """

    def __init__(self, world: World, rooms: RoomTraffic, dispatcher: Dispatcher) -> None:
        self._world = world
        self._rooms = rooms
        self._dispatcher = dispatcher
        self._table = MissionTable(STOP_RECORD, self._stop_of)

    def step(
        self, missions: list[Mission], state: StackState, fleet: FleetState
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Let each robot work on its next stop.

        Args:
            missions: of all robots.
            state: memory of the stack.
            fleet: what the robots' sensors say.
        """
        at_rest, asks = np.empty((2, len(missions)), dtype=np.bool_)
        _fill_asks(
            self._table.rows(missions, state.queues),
            fleet.pose,
            fleet.velocity,
            fleet.time,
            tuple(self._rooms.grounds),
            (at_rest, asks),
        )
        pursued, events = list(missions), []
        for robot in asks.nonzero()[0].tolist():
            pursued[robot], happened = self._pursue(
                robot, missions[robot], state, fleet, is_at_rest=bool(at_rest[robot])
            )
            events += happened
        return pursued, events

    def first_stop_ends(self, mission: Mission, position: Array, time: float) -> float:
        """Predict when the first stop of an itinerary will be done [s].

        Args:
            mission: of the robot.
            position: ``(2,)`` of the robot now [m].
            time: [s].
        """
        if not mission.itinerary:
            return time
        activity, way, stop = mission.activity, mission.way, mission.itinerary[0]
        if isinstance(activity, Serving):
            return max(time, activity.until)
        service = self._service_time(stop)
        if way.failed:
            service += NO_PATH_DELAY
        if not isinstance(activity, Heading | Waiting) or not len(way.path):
            drive = self._dispatcher.travel_time(mission.room, stop.room)
        else:
            rest, *_, length = look_along(way.path, position[0], position[1], LOOK_AHEAD)
            if len(way.route) > 2:
                length += path_length(np.concatenate([rest[-1:], way.route[2:]]))
            drive = length / MEAN_SPEED
            if isinstance(activity, Waiting):
                drive += distance_of(self._point(stop), way.route[-1]) / MEAN_SPEED
        return time + drive + service

    def _pursue(
        self,
        robot: int,
        mission: Mission,
        state: StackState,
        fleet: FleetState,
        *,
        is_at_rest: bool,
    ) -> tuple[Mission, list[StackEvent]]:
        """Work on the next stop: serve it, ask for its room, or find the way there."""
        if isinstance(mission.activity, Off):
            return mission, []
        mission, events = self._serve(robot, mission, state, fleet, is_at_rest=is_at_rest)
        activity = mission.activity
        if not mission.itinerary:
            is_parking = isinstance(activity, Parking)
            is_resting = isinstance(activity, Idle) and not mission.way.is_going
            return mission if is_parking or is_resting else mission.rest(), events
        if self._is_busy(mission):
            return mission, events
        mission, asked = self._rooms.head_for_stop(robot, mission, state.queues, fleet)
        return mission, events + asked

    def _is_busy(self, mission: Mission) -> bool:
        """Whether a robot with a stop stays where it is."""
        return isinstance(mission.activity, Serving)

    def _stop_of(
        self, robot: int, mission: Mission, memories: Sequence[QueueState]
    ) -> tuple[object, ...]:
        """Describe by a STOP_RECORD when :meth:`_pursue` has something to do for a robot.

        Until then it would give the mission back as it is, and touch no memory.
        """
        activity = mission.activity
        if isinstance(activity, Off):
            return NOTHING_TO_DO
        if not mission.itinerary:
            rests = isinstance(activity, Idle) and not mission.way.is_going
            return NOTHING_TO_DO if rests or isinstance(activity, Parking) else SOMETHING_TO_DO
        if isinstance(activity, Serving):
            return False, activity.until, NOWHERE, NOWHERE, -1
        queue = self._rooms.queue_of_room.get(mission.itinerary[0].room, -1)
        memory = memories[queue] if queue >= 0 else None
        if isinstance(activity, Heading) and (memory is None or robot in memory.holders):
            queue = -1
        elif activity != Waiting(queue, None, arrived=False) or _is_known(robot, memory):
            return SOMETHING_TO_DO
        point, path = self._point(mission.itinerary[0]), mission.way.path
        end = NOWHERE
        if len(path) and len(mission.way.route) <= 1:
            end = tuple(path[-1].tolist())
        return mission.passage.asks_for_room, np.inf, tuple(point.tolist()), end, queue

    def _serve(
        self,
        robot: int,
        mission: Mission,
        state: StackState,
        fleet: FleetState,
        *,
        is_at_rest: bool,
    ) -> tuple[Mission, list[StackEvent]]:
        """Load and unload everything that is due where the robot stands."""
        events: list[StackEvent] = []
        while mission.itinerary:
            stop = mission.itinerary[0]
            if not isinstance(mission.activity, Serving):
                if not (is_at_rest and self._has_arrived(robot, mission, state, fleet)):
                    break
                visit = self._rooms.enter(state.queues, robot, stop.room, fleet.time)
                until = fleet.time + self._service_time(stop) + visit
                mission = replace(
                    mission, room=stop.room, activity=Serving(until), way=mission.way.stopped()
                )
            assert isinstance(mission.activity, Serving)
            if fleet.time < mission.activity.until:
                break
            mission = self._served(mission)
            if stop.action == "dropoff":
                state.dispatcher.deliver(stop.task)
            events.append(self._event(fleet.time, robot, stop))
        return mission, events

    def _served(self, mission: Mission) -> Mission:
        """Take the first stop off the itinerary."""
        stop, rest = mission.itinerary[0], mission.itinerary[1:]
        onboard = (
            (*mission.onboard, stop.task)
            if stop.action == "pickup"
            else tuple(task for task in mission.onboard if task != stop.task)
        )
        return replace(
            mission,
            itinerary=rest,
            onboard=onboard,
            activity=Idle(),
            has_delivered=mission.has_delivered or stop.action == "dropoff",
        )

    def _has_arrived(
        self, robot: int, mission: Mission, state: StackState, fleet: FleetState
    ) -> bool:
        """Whether a robot at rest is where its first stop is, and may be served there."""
        stop = mission.itinerary[0]
        if isinstance(mission.activity, Stalled):
            return False
        if not self._rooms.may_serve(state.queues, robot, stop.room):
            return False
        return mission.way.has_reached(self._point(stop), fleet.pose[robot, :2], ROOM_REACHED)

    def _point(self, stop: Stop) -> Array:
        return np.asarray(self._world.rooms[stop.room].point)

    def _service_time(self, stop: Stop) -> float:
        """Time [s] that loading or unloading takes."""
        task = self._world.tasks[stop.task]
        return task.pickup_time if stop.action == "pickup" else task.dropoff_time

    def _event(self, time: float, robot: int, stop: Stop) -> StackEvent:
        kind = "picked-up" if stop.action == "pickup" else "dropped-off"
        name = self._world.rooms[stop.room].name
        return StackEvent(time=time, kind=kind, robot=robot, task=stop.task, resource=name)


def _is_known(robot: int, memory: QueueState | None) -> bool:
    """Whether a robot holds the resource of a queue, or waits for it."""
    if memory is None:
        return False
    return robot in memory.holders or any(waiter.robot == robot for waiter in memory.waiters)


@njit(cache=True)
def _fill_asks(
    rows: Rows,
    pose: Array,
    velocity: Array,
    time: float,
    areas: tuple[Any, ...],
    flags: tuple[BoolArray, BoolArray],
) -> None:
    """Say who is slow enough to load and unload, and who has something to do.

    Args:
        rows: ``(N,)`` of STOP_RECORD.
        pose: ``(N, 3)``.
        velocity: ``(N, 3)`` [m/s, rad/s].
        time: [s].
        areas: where rooms are asked for, the fields of :class:`Grounds`.
        flags: ``(N,)`` each, filled.
    """
    at_rest, asks = flags
    grounds = Grounds(*areas)
    for i in range(rows.shape[0]):
        robot = rows[i]
        at_rest[i] = abs(velocity[i, 0]) <= AT_REST and abs(velocity[i, 1]) <= AT_REST
        asks[i] = robot.now or time >= robot.until
        if at_rest[i] and not asks[i]:
            asks[i] = is_near(robot.point, pose[i], ROOM_REACHED + NEARLY) or is_near(
                robot.end, pose[i], AT_PATH_END + NEARLY
            )
        if robot.queue >= 0 and not asks[i]:
            asks[i] = is_on_grounds(grounds, robot.queue, pose[i])
