"""One tick of the whole stack: tasks in, commands out.

``due tasks -> allocator -> itineraries -> waypoints -> queue grants -> paths -> ranks ->
look-ahead -> controller -> command``. The memory is an explicit value, :class:`StackState`:
``copy.deepcopy`` forks it, ``digest()`` compares it. See ``docs/stack.md`` for the rules.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.allocation_problem import Stop
from mrta_falsify.core.arrays import Array, IntArray, frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Command, FleetState, Intent, StackEvent
from mrta_falsify.core.protocols import ControlView, CostmapSource, PriorityRule, PriorityView
from mrta_falsify.core.world import World
from mrta_falsify.stack.comms import Links, links_at, outage_times
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, Report
from mrta_falsify.stack.lookahead import LOOK_AHEAD, Outlook, Views
from mrta_falsify.stack.mission import (
    DRIVING,
    IDLE,
    NOWHERE,
    OFF,
    PLANNING,
    QUEUEING,
    SERVING,
    STALLED,
    TO_PARKING,
    TO_ROOM,
    TO_SPOT,
    Mission,
    StackState,
    distance_of,
    has_reached,
    next_deadline,
)
from mrta_falsify.stack.planning_service import (
    RETRY,
    ROOM_REACHED,
    SPOT_REACHED,
    ServiceState,
    Way,
    look_along,
    path_length,
)
from mrta_falsify.stack.replanning import Paths
from mrta_falsify.stack.resources.corridors import STOP_SHORT, Areas, Traveller, find_crossing
from mrta_falsify.stack.resources.parking import MakingRoom
from mrta_falsify.stack.resources.rooms import RoomTraffic

NOT_A_POINT = frozen_array([math.nan, math.nan])
AT_REST = 0.1  # m/s, slow enough to load and unload
PROGRESS = 0.2  # m, moving this far counts as progress
MEAN_SPEED = 0.69  # m/s, loaded travel times of MRTA-Sim over its road lengths
NO_PATH_DELAY = 120.0  # s that a robot without a path is expected to be late


class Stack:
    """The stack of a world under a configuration; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        defects = config.defects
        self._world = world
        self._config = config
        self._stalls = "same_room_twice_stalls" in defects
        self._dt = 1.0 / config.control_rate
        allocator = registry.build("allocator", config.allocator, defects=defects)
        self._dispatcher = Dispatcher(world, allocator, defects)
        self._rooms = RoomTraffic(world, config)
        self._areas = Areas(self._rooms.queues)
        self._making_room = MakingRoom(world, self._rooms, frozenset(defects))
        self._paths = Paths(world, config, costmaps)
        self._priority: PriorityRule = registry.build(
            "priority_rule", config.priority_rule, defects=defects
        )
        self._read_outages(world)
        robots = world.robots
        self._max_speed = np.array([robot.max_speed for robot in robots])
        self._max_acceleration = np.array([robot.max_acceleration for robot in robots])
        self._max_turn_rate = np.array([robot.max_turn_rate for robot in robots])
        self._points = [np.asarray(room.point) for room in world.rooms]
        # What follows only saves work: it holds nothing that the memory does not say as well.
        self._outlook = Outlook(len(robots))
        self._nowhere = np.full((len(robots), 2), np.nan)
        self._goals = _Goals((), self._nowhere)

    def _read_outages(self, world: World) -> None:
        self._link_changes = outage_times(world)
        before = links_at(world, -1.0)
        self._links = [before, *(links_at(world, time) for time in self._link_changes)]

    def forget_after(self, state: StackState, time: float) -> None:
        """No task that has not arrived by ``time`` [s] ever will, nor will a later outage begin."""
        self._dispatcher.take_no_more(state.dispatcher)
        events = tuple(event for event in self._world.events if event.start <= time)
        self._read_outages(dataclasses.replace(self._world, events=events))
        state.link_epoch = bisect.bisect_right(self._link_changes, time)

    def start(self) -> StackState:
        """Memory at time 0: robots hold the rooms they stand in."""
        missions = [Mission() for _ in self._world.robots]
        queues = self._rooms.start(missions, [robot.pose[:2] for robot in self._world.robots])
        return StackState(
            missions=missions,
            queues=queues,
            dispatcher=DispatcherState(),
            service=ServiceState(),
            controller=registry.build(
                "controller", self._config.controller, defects=self._config.defects
            ),
        )

    def all_done(self, state: StackState) -> bool:
        """Whether every task is delivered and none is to come."""
        return self._dispatcher.all_done(state.dispatcher)

    def step(
        self, state: StackState, fleet: FleetState
    ) -> tuple[StackState, Command, Intent, tuple[StackEvent, ...]]:
        """One control tick.

        Args:
            state: memory; it is consumed (``copy.deepcopy`` it first to fork).
            fleet: what the robots' sensors say.

        Returns:
            The memory for the next tick, the command, what the stack intends, and what
            happened and why.
        """
        events: list[StackEvent] = []
        links = self._current_links(state, fleet.time, events)
        self._join(state, fleet, events)
        self._follow_progress(state, fleet)
        self._dispatch(state, fleet, links, events)
        self._rooms.leave(state, fleet, events)
        for robot, mission in enumerate(state.missions):
            self._pursue(state, robot, mission, fleet, events)
        self._rooms.grant(state, fleet, events)
        self._making_room.step(state, fleet, events)
        self._paths.advance(state, fleet, events)
        self._paths.plan(state, fleet, links, events)
        views = self._outlook.views([mission.way for mission in state.missions], fleet.pose)
        self._limit(state, views, fleet, events)
        command, intent = self._control(state, views, fleet, links)
        return state, command, intent, tuple(events)

    # --- what is known ------------------------------------------------------------------

    def _current_links(self, state: StackState, time: float, events: list[StackEvent]) -> Links:
        epoch = bisect.bisect_right(self._link_changes, time)
        links = self._links[epoch]
        if epoch == state.link_epoch:
            return links
        earlier = self._links[state.link_epoch]
        state.link_epoch = epoch
        for robot in range(len(state.missions)):
            before, now = earlier.down_for(robot), links.down_for(robot)
            lost = ", ".join(name for name in now if name not in before)
            back = ", ".join(name for name in before if name not in now)
            if lost:
                events.append(StackEvent(time=time, kind="comms-lost", robot=robot, detail=lost))
            if back:
                events.append(StackEvent(time=time, kind="comms-back", robot=robot, detail=back))
        return links

    def _join(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        for robot, mission in enumerate(state.missions):
            if mission.phase is OFF and fleet.time >= self._world.robots[robot].joins_at:
                mission.phase = IDLE
                events.append(StackEvent(time=fleet.time, kind="joined", robot=robot))

    @staticmethod
    def _follow_progress(state: StackState, fleet: FleetState) -> None:
        positions = fleet.pose.tolist()
        for robot, mission in enumerate(state.missions):
            x, y, _ = positions[robot]
            dx, dy = x - mission.anchor[0], y - mission.anchor[1]
            if dx * dx + dy * dy > PROGRESS * PROGRESS:
                mission.anchor, mission.moved_at = (x, y), fleet.time

    # --- tasks --------------------------------------------------------------------------

    def _dispatch(
        self, state: StackState, fleet: FleetState, links: Links, events: list[StackEvent]
    ) -> None:
        def reports() -> list[Report]:
            return [
                Report(
                    itinerary=tuple(mission.itinerary),
                    onboard=tuple(mission.onboard),
                    room=mission.room,
                    first_ends=self._first_stop_ends(mission, fleet.pose[robot, :2], fleet.time),
                    reachable=mission.phase is not OFF and bool(links.dispatcher[robot]),
                )
                for robot, mission in enumerate(state.missions)
            ]

        orders = self._dispatcher.dispatch(state.dispatcher, fleet.time, reports)
        events.extend(orders.events)
        for robot, itinerary in orders.itineraries.items():
            state.missions[robot].itinerary = list(itinerary)

    def _first_stop_ends(self, mission: Mission, position: Array, time: float) -> float:
        """When the first stop of an itinerary will be done [s], from where the robot is now."""
        if not mission.itinerary:
            return time
        if mission.serve_until >= 0.0:
            return max(time, mission.serve_until)
        stop, way = mission.itinerary[0], mission.way
        task = self._world.tasks[stop.task]
        service = task.pickup_time if stop.action == "pickup" else task.dropoff_time
        if way.failed:
            service += NO_PATH_DELAY
        if mission.aim not in (TO_ROOM, TO_SPOT) or not len(way.path):
            drive = self._dispatcher.travel_time(mission.room, stop.room)
        else:
            rest, *_, length = look_along(way.path, position[0], position[1], LOOK_AHEAD)
            drive = (length + path_length(np.vstack([rest[-1:], way.route[2:]]))) / MEAN_SPEED
            if mission.aim == TO_SPOT:
                drive += distance_of(self._points[stop.room], way.route[-1]) / MEAN_SPEED
        return time + drive + service

    def _pursue(
        self,
        state: StackState,
        robot: int,
        mission: Mission,
        fleet: FleetState,
        events: list[StackEvent],
    ) -> None:
        """Work on the next stop: serve it, ask for its room, or find the way there."""
        if mission.phase is OFF:
            return
        self._serve(state, robot, mission, fleet, events)
        if not mission.itinerary:
            if mission.aim != TO_PARKING:
                if mission.aim != NOWHERE or mission.way.is_going:
                    mission.way.stop()
                mission.aim, mission.phase, mission.stops_short_of = NOWHERE, IDLE, -1
                mission.place = -1
            return
        if mission.serve_until >= 0.0:
            return
        if self._stalls and mission.aim == STALLED:
            return
        self._rooms.head_for_stop(state, robot, fleet, events)

    def _serve(
        self,
        state: StackState,
        robot: int,
        mission: Mission,
        fleet: FleetState,
        events: list[StackEvent],
    ) -> None:
        """Load and unload everything that is due where the robot stands."""
        while mission.itinerary:
            stop = mission.itinerary[0]
            if mission.serve_until < 0.0:
                if not self._has_arrived(state, robot, mission, stop, fleet):
                    return
                task = self._world.tasks[stop.task]
                service = task.pickup_time if stop.action == "pickup" else task.dropoff_time
                mission.serve_until = (
                    fleet.time + service + self._rooms.enter(state, robot, stop.room)
                )
                mission.room, mission.place = stop.room, -1
                mission.way.stop()
                mission.aim, mission.phase = NOWHERE, SERVING
            if fleet.time < mission.serve_until:
                return
            mission.serve_until = -1.0
            del mission.itinerary[0]
            if stop.action == "pickup":
                mission.onboard.append(stop.task)
            else:
                mission.onboard.remove(stop.task)
                state.dispatcher.deliver(stop.task)
            kind = "picked-up" if stop.action == "pickup" else "dropped-off"
            name = self._world.rooms[stop.room].name
            events.append(
                StackEvent(time=fleet.time, kind=kind, robot=robot, task=stop.task, resource=name)
            )
            again = mission.itinerary and mission.itinerary[0].room == stop.room
            if again and self._stalls:
                mission.aim, mission.phase = STALLED, DRIVING
                return

    def _has_arrived(
        self, state: StackState, robot: int, mission: Mission, stop: Stop, fleet: FleetState
    ) -> bool:
        if mission.aim == STALLED:
            return False
        if not has_reached(
            self._points[stop.room], fleet.pose[robot, :2], ROOM_REACHED, mission.way
        ):
            return False
        if not self._rooms.may_serve(state, robot, stop.room):
            return False
        return bool(np.abs(fleet.velocity[robot, :2]).max() <= AT_REST)

    # --- control ------------------------------------------------------------------------

    def _limit(
        self, state: StackState, views: Views, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        """Shorten ways so that robots stop before what they do not hold."""
        for robot, mission in enumerate(state.missions):
            if mission.stops_short_of >= 0 and len(views.rest[robot]):
                area = self._rooms.queues[mission.stops_short_of].resource.release_area
                enter, _ = find_crossing(views.rest[robot], area)
                limit = max(0.0, enter - STOP_SHORT)
                views.shorten(robot, limit, fleet.pose[robot])
                waits = mission.place >= 0 and limit <= SPOT_REACHED
                mission.phase = QUEUEING if waits else DRIVING
        if not self._areas:
            return
        travellers = [
            Traveller(
                robot=robot,
                position=fleet.pose[robot, :2],
                ahead=_way_ahead(mission.way, views.rest[robot]),
                way=mission.way,
                gate=mission.gate,
                deadline=next_deadline(mission, self._world.tasks),
                room_needed=mission.aim == TO_SPOT,
            )
            for robot, mission in enumerate(state.missions)
        ]
        events.extend(self._areas.step(travellers, state.queues, fleet.time))
        for traveller, mission in zip(travellers, state.missions, strict=True):
            mission.standing, mission.wants_room = traveller.standing, traveller.wants_room
            if len(views.rest[traveller.robot]):
                views.shorten(traveller.robot, traveller.limit, fleet.pose[traveller.robot])

    def _control(
        self, state: StackState, views: Views, fleet: FleetState, links: Links
    ) -> tuple[Command, Intent]:
        missions = state.missions
        active = []
        goal, waypoint = self._nowhere.copy(), self._nowhere.copy()
        for robot, (mission, rest) in enumerate(zip(missions, views.rest, strict=True)):
            if len(mission.way.route):
                waypoint[robot] = mission.way.route[0]
            if not len(rest):
                active.append(mission.phase is SERVING)
                continue
            goal[robot] = rest[-1]
            at_spot = mission.phase is QUEUEING and views.length[robot] < SPOT_REACHED
            if at_spot:
                views.target[robot] = np.nan
            active.append(not at_spot and mission.standing is None)
        is_active = np.array(active, dtype=np.bool_)
        waiting_since = [
            m.moved_at if fleet.time - m.moved_at > RETRY else math.inf for m in missions
        ]
        ranks = self._priority.ranks(
            PriorityView(
                time=fleet.time,
                pose=fleet.pose,
                active=is_active,
                distance_to_goal=views.length,
                waiting_since=np.array(waiting_since),
            )
        )
        view = ControlView(
            time=fleet.time,
            dt=self._dt,
            pose=fleet.pose,
            velocity=fleet.velocity,
            target=views.target,
            goal=goal,
            path=tuple(views.rest),
            active=is_active,
            present=np.array([m.phase is not OFF for m in missions], dtype=np.bool_),
            rank=ranks,
            obstacle_points=fleet.obstacle_points,
            human_position=fleet.human_position,
            human_velocity=fleet.human_velocity,
            human_radius=fleet.human_radius,
            states_link=links.states,
            leader_link=links.leader,
            max_speed=self._max_speed,
            max_acceleration=self._max_acceleration,
            max_turn_rate=self._max_turn_rate,
        )
        result = state.controller.control(view)
        phase, tasks_left, place = _numbers_of(missions)
        intent = Intent(
            phase=phase,
            goal=self._final_goals(missions),
            waypoint=waypoint,
            path=tuple(m.way.path for m in missions),
            cluster=result.cluster,
            leader=result.leader,
            slack=result.slack,
            tasks_left=tasks_left,
            queue=place,
            waits_for=self._resources_waited_for(state),
        )
        return result.command, intent

    def _final_goals(self, missions: Sequence[Mission]) -> Array:
        """Where the robots finally head for ``(N, 2)``; the same object if nothing changed."""
        aims = tuple(
            (m.itinerary[0].room if m.itinerary else -1, m.aim, m.place, m.parking)
            for m in missions
        )
        if aims != self._goals.aims:
            self._goals = _Goals(aims, np.array([self._goal_of(*aim) for aim in aims]))
        return self._goals.points

    def _goal_of(self, room: int, aim: str, place: int, parking: int) -> Array:
        if room < 0:
            return self._making_room.refuge(parking) if aim == TO_PARKING else NOT_A_POINT
        index = self._rooms.queue_of_room.get(room)
        if aim == TO_SPOT and index is not None and place >= 0:
            spots = self._rooms.queues[index].resource.spots
            if place < len(spots):
                return np.asarray(spots[place])
        return self._points[room]

    def _resources_waited_for(self, state: StackState) -> tuple[str, ...]:
        names = [""] * len(state.missions)
        for queue, memory in zip(self._rooms.queues, state.queues, strict=True):
            for waiter in memory.waiters:
                names[waiter.robot] = names[waiter.robot] or queue.resource.name
        return tuple(names)


@dataclass(frozen=True, slots=True, eq=False)
class _Goals:
    """Where robots with these aims head for."""

    aims: tuple[tuple[int, str, int, int], ...]  #: N: next room, aim, place in queue, refuge
    points: Array  #: (N, 2) [m], nan: nowhere


def _way_ahead(way: Way, rest: Array) -> Array:
    """The rest of the path, and the waypoints behind its end."""
    if not len(rest) or len(way.halt) or len(way.route) < 3:
        return rest
    return np.vstack([rest, way.route[2:]])


def _numbers_of(missions: Sequence[Mission]) -> IntArray:
    """Phase, stops left and place in the queue of all robots ``(3, N)``."""
    numbers = (
        [_phase_of(mission) for mission in missions],
        [len(mission.itinerary) for mission in missions],
        [mission.place for mission in missions],
    )
    return np.array(numbers, dtype=np.int64)


def _phase_of(mission: Mission) -> int:
    if mission.standing is not None:
        return int(mission.standing)
    if mission.phase is DRIVING and mission.way.is_going and not len(mission.way.path):
        return int(PLANNING)
    return int(mission.phase)
