"""How robots work off their itineraries: drive to a room, load or unload, drive on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.plane import distance_of
from mrta_falsify.core.polyline import look_along, path_length
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Heading, Idle, Off, Parking, Serving, Stalled, Waiting
from mrta_falsify.stack.dispatcher import Dispatcher
from mrta_falsify.stack.mission import Mission, StackState
from mrta_falsify.stack.resources.rooms import RoomTraffic
from mrta_falsify.stack.route import LOOK_AHEAD, ROOM_REACHED

AT_REST = 0.1  # m/s, slow enough to load and unload
MEAN_SPEED = 0.69  # m/s, loaded travel times of MRTA-Sim over its road lengths
NO_PATH_DELAY = 120.0  # s that a robot without a path is expected to be late


def who_is_at_rest(velocity: Array) -> list[bool]:
    """Tell which robots are slow enough to load and unload.

    Args:
        velocity: ``(N, 3)`` [m/s, rad/s].
    """
    at_rest: list[bool] = (np.abs(velocity[:, :2]).max(axis=1, initial=0.0) <= AT_REST).tolist()
    return at_rest


@dataclass(frozen=True, slots=True, eq=False)
class ItineraryFollower:
    """The rule by which robots work on their next stop; has no memory of its own."""

    world: World
    rooms: RoomTraffic
    dispatcher: Dispatcher
    stalls: bool  #: the planted defect `same_room_twice_stalls` is on

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
            drive = self.dispatcher.travel_time(mission.room, stop.room)
        else:
            rest, *_, length = look_along(way.path, position[0], position[1], LOOK_AHEAD)
            drive = (length + path_length(np.vstack([rest[-1:], way.route[2:]]))) / MEAN_SPEED
            if isinstance(activity, Waiting):
                drive += distance_of(self._point(stop), way.route[-1]) / MEAN_SPEED
        return time + drive + service

    def pursue(
        self,
        robot: int,
        mission: Mission,
        state: StackState,
        fleet: FleetState,
        *,
        is_at_rest: bool,
    ) -> tuple[Mission, list[StackEvent]]:
        """Work on the next stop: serve it, ask for its room, or find the way there.

        Args:
            robot: its number.
            mission: of the robot.
            state: memory of the stack.
            fleet: what the robots' sensors say.
            is_at_rest: slow enough to load and unload, as :func:`who_is_at_rest` says.
        """
        if isinstance(mission.activity, Off):
            return mission, []
        mission, events = self._serve(robot, mission, state, fleet, is_at_rest=is_at_rest)
        activity = mission.activity
        if not mission.itinerary:
            is_parking = isinstance(activity, Parking)
            is_resting = isinstance(activity, Idle) and not mission.way.is_going
            return mission if is_parking or is_resting else mission.rest(), events
        if isinstance(activity, Serving) or (self.stalls and isinstance(activity, Stalled)):
            return mission, events
        mission, asked = self.rooms.head_for_stop(robot, mission, state.queues, fleet)
        return mission, events + asked

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
                visit = self.rooms.enter(state.queues, robot, stop.room, fleet.time)
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
        again = bool(rest) and rest[0].room == stop.room
        activity = Stalled() if again and self.stalls else Idle()
        return replace(
            mission,
            itinerary=rest,
            onboard=onboard,
            activity=activity,
            has_delivered=mission.has_delivered or stop.action == "dropoff",
        )

    def _has_arrived(
        self, robot: int, mission: Mission, state: StackState, fleet: FleetState
    ) -> bool:
        """Whether a robot at rest is where its first stop is, and may be served there."""
        stop = mission.itinerary[0]
        if isinstance(mission.activity, Stalled):
            return False
        position = fleet.pose[robot, :2]
        if not mission.way.has_reached(self._point(stop), position, ROOM_REACHED):
            return False
        return self.rooms.may_serve(state.queues, robot, stop.room)

    def _point(self, stop: Stop) -> Array:
        return np.asarray(self.world.rooms[stop.room].point)

    def _service_time(self, stop: Stop) -> float:
        """Time [s] that loading or unloading takes."""
        task = self.world.tasks[stop.task]
        return task.pickup_time if stop.action == "pickup" else task.dropoff_time

    def _event(self, time: float, robot: int, stop: Stop) -> StackEvent:
        kind = "picked-up" if stop.action == "pickup" else "dropped-off"
        name = self.world.rooms[stop.room].name
        return StackEvent(time=time, kind=kind, robot=robot, task=stop.task, resource=name)
