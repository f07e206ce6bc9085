"""How robots work off their itineraries: drive to a room, load or unload, drive on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array
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
from mrta_falsify.stack.resources.rooms import Grounds, Places, RoomTraffic, is_on_grounds
from mrta_falsify.stack.route import AT_PATH_END, LOOK_AHEAD, ROOM_REACHED, SPOT_REACHED

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
    ("waits", np.bool_),  # only once its place in the queue is another, or it comes to or leaves it
    ("arrived", np.bool_),  # it stands at that place: at ``point``, or at ``end``
    ("room", np.float64, (2,)),  # its queue is told how far it is from there [m]
)
NOWHERE = (np.nan, np.nan)
NOTHING_TO_DO = (False, np.inf, NOWHERE, NOWHERE, -1, False, False, NOWHERE)
SOMETHING_TO_DO = (True, *NOTHING_TO_DO[1:])

#: what follows for a robot at one tick
ASK_RECORD = record_of(
    ("at_rest", np.bool_),  # slow enough to load and unload
    ("asks", np.bool_),  # has something to do
    ("waits", np.bool_),  # goes on waiting unless its place in the queue has changed
    ("renews", np.bool_),  # tells its queue how far it is from the room
    ("away", np.float64),  # so far [m]
)


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
        asks = np.empty(len(missions), dtype=ASK_RECORD)
        rows = self._table.rows(missions, state.queues)
        grounds = tuple(self._rooms.grounds)
        pursued, events = list(missions), list[StackEvent]()
        if not _fill_asks(rows, fleet.pose, fleet.velocity, fleet.time, grounds, asks):
            return pursued, events
        places: Places = {}
        for robot in (asks["asks"] | asks["waits"]).nonzero()[0].tolist():
            mission = missions[robot]
            at_rest, is_asked, _, renews, away = asks.item(robot)
            if not is_asked and self._rooms.goes_on_waiting(
                robot, mission, state.queues, away if renews else None, places
            ):
                continue
            pursued[robot], happened = self._pursue(
                robot, mission, state, fleet, is_at_rest=bool(at_rest)
            )
            events += happened
            places.pop(self._rooms.queue_of_next(pursued[robot]), None)  # it may have asked there
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
            return NOTHING_TO_DO[0], activity.until, *NOTHING_TO_DO[2:]
        queue = self._rooms.queue_of_next(mission)
        memory = memories[queue] if queue >= 0 else None
        if isinstance(activity, Waiting) and activity.place is not None:
            is_in_line = activity.queue == queue and _is_waiter(robot, memories[queue])
            return self._wait_of(mission, activity) if is_in_line else SOMETHING_TO_DO
        if isinstance(activity, Heading) and (memory is None or robot in memory.holders):
            queue = -1
        elif activity != Waiting(queue, None, arrived=False) or _is_known(robot, memory):
            return SOMETHING_TO_DO
        point, path = self._point(mission.itinerary[0]), mission.way.path
        end = NOWHERE
        if len(path) and len(mission.way.route) <= 1:
            end = tuple(path[-1].tolist())
        now = mission.passage.asks_for_room
        return now, np.inf, tuple(point.tolist()), end, queue, *NOTHING_TO_DO[5:]

    def _wait_of(self, mission: Mission, waiting: Waiting) -> tuple[object, ...]:
        """Describe a robot that waits at its place in a queue, or drives there."""
        way, point, end = mission.way, NOWHERE, NOWHERE
        if mission.passage.asks_for_room:
            return SOMETHING_TO_DO
        if way.is_going and len(self._rooms.queues[waiting.queue].spots):
            place = way.route[-1]
            point = tuple(place.tolist())
            leads_there = len(way.path) > 0 and len(way.route) <= 1
            if leads_there and distance_of(way.path[-1], place) <= ROOM_REACHED:
                end = tuple(way.path[-1].tolist())
        queue = -1 if way.failed else waiting.queue
        room = tuple(self._point(mission.itinerary[0]).tolist())
        return False, np.inf, point, end, queue, True, waiting.arrived, room

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
    return memory is not None and (robot in memory.holders or _is_waiter(robot, memory))


def _is_waiter(robot: int, memory: QueueState) -> bool:
    return any(waiter.robot == robot for waiter in memory.waiters)


@njit(cache=True)
def _fill_asks(
    rows: Rows,
    pose: Array,
    velocity: Array,
    time: float,
    areas: tuple[Any, ...],
    asks: Rows,
) -> bool:
    """Say who is slow enough to load and unload, who has something to do, and who only waits.

    Args:
        rows: ``(N,)`` of STOP_RECORD.
        pose: ``(N, 3)``.
        velocity: ``(N, 3)`` [m/s, rad/s].
        time: [s].
        areas: where rooms are asked for, the fields of :class:`Grounds`.
        asks: ``(N,)`` of ASK_RECORD, filled.

    Returns:
        Whether anybody asks or waits.
    """
    grounds, is_any = Grounds(*areas), False
    for i in range(rows.shape[0]):
        robot, ask = rows[i], asks[i]
        is_on = robot.queue >= 0 and is_on_grounds(grounds, robot.queue, pose[i])
        ask.at_rest = abs(velocity[i, 0]) <= AT_REST and abs(velocity[i, 1]) <= AT_REST
        ask.waits = robot.waits
        is_any = is_any or robot.waits
        if robot.waits:
            ask.asks = _comes_or_leaves(robot, pose[i])
            ask.renews = is_on
            ask.away = np.hypot(robot.room[0] - pose[i, 0], robot.room[1] - pose[i, 1])
            continue
        ask.asks = robot.now or time >= robot.until or is_on
        if ask.at_rest and not ask.asks:
            ask.asks = is_near(robot.point, pose[i], ROOM_REACHED + NEARLY) or is_near(
                robot.end, pose[i], AT_PATH_END + NEARLY
            )
        is_any = is_any or ask.asks
    return is_any


@njit(cache=True)
def _comes_or_leaves(robot: np.record, position: Array) -> bool:
    """Whether a robot may have come to its place in a queue, or have left it."""
    margin = -NEARLY if robot.arrived else NEARLY
    reach = 2.0 * SPOT_REACHED if robot.arrived else SPOT_REACHED
    is_there = is_near(robot.point, position, reach + margin) or is_near(
        robot.end, position, AT_PATH_END + margin
    )
    return bool(is_there != robot.arrived)
