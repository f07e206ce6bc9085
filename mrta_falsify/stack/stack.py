"""One tick of the whole stack: tasks in, commands out.

``due tasks -> allocator -> itineraries -> waypoints -> queue grants -> paths -> ranks ->
look-ahead -> controller -> command``. The memory is an explicit value, :class:`StackState`:
``copy.deepcopy`` forks it, ``digest()`` compares it. See ``docs/stack.md`` for the rules.
"""

from __future__ import annotations

import bisect
import dataclasses
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.allocation import Stop
from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Command, FleetState, Intent, Phase, StackEvent
from mrta_falsify.core.protocols import (
    Controller,
    ControlView,
    CostmapSource,
    PriorityRule,
    PriorityView,
    Waiter,
    WaypointGenerator,
)
from mrta_falsify.core.world import Blockage, Lane, World
from mrta_falsify.stack.areas import STOP_SHORT, Areas, Gate, Traveller, find_crossing
from mrta_falsify.stack.comms import Links, links_at, outage_times
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, Report
from mrta_falsify.stack.fingerprint import fingerprint
from mrta_falsify.stack.navigation import (
    NO_POINTS,
    OFF_PATH,
    RETRY,
    ROOM_REACHED,
    SPOT_REACHED,
    WAYPOINT_REACHED,
    PlanningService,
    ServiceState,
    Way,
    cut_path,
    is_near,
    is_within,
    look_along,
    path_length,
)
from mrta_falsify.stack.refuges import APART, choose_refuge, refuges_of
from mrta_falsify.stack.room_queues import Queue, QueueState
from mrta_falsify.stack.views import LOOK_AHEAD, Outlook, Views
from mrta_falsify.stack.waypoints import join

NOT_A_POINT = (math.nan, math.nan)
AT_REST = 0.1  # m/s, slow enough to load and unload
AT_PATH_END = 0.15  # m, controllers stop within 0.1 m of their goal
PROGRESS = 0.2  # m, moving this far counts as progress
PLANS_PER_TICK = 6
REPLAN_TICKS = 10  # checks of paths and of idle robots in the way, 2 Hz at 20 Hz control
NEAR_SPOT = 0.9  # m, a robot this near to a waiting spot uses the way from there
MEAN_SPEED = 0.69  # m/s, loaded travel times of MRTA-Sim over its road lengths
NO_PATH_DELAY = 120.0  # s that a robot without a path is expected to be late
IN_THE_WAY_AFTER = 5.0  # s without progress, then an idle robot ahead is sent away
CLEARED = 1.5  # m of a stuck robot's path that idle robots have to clear

# Bound once: up to Python 3.11 each `Phase.X` costs ten times a plain name, and every robot
# is asked for its phase several times a tick.
OFF, IDLE, DRIVING, QUEUEING, PLANNING, SERVING, MAKING_ROOM = Phase

#: where a robot's route leads
NOWHERE, TO_ROOM, TO_SPOT, TO_PARKING = "", "room", "spot", "parking"


@dataclass(slots=True)
class Mission:
    """What one robot is about."""

    itinerary: list[Stop] = field(default_factory=list)
    onboard: list[int] = field(default_factory=list)
    phase: Phase = OFF
    aim: str = NOWHERE
    room: int = -1  #: room it was in last
    place: int = -1  #: place in the queue it stands in, -1: none
    parking: int = -1  #: refuge it has or heads for, -1: none
    unreachable: list[int] = field(default_factory=list)  #: refuges it found no path to
    park_at: float = 0.0  #: not sent away before this [s]
    stops_short_of: int = -1  #: queue without spots it may not enter yet, -1: none
    wants_room: bool = False  #: asks for its room from before an area
    gate: Gate = field(default_factory=Gate)
    standing: Phase | None = None  #: waits at an area, or is served by one
    serve_until: float = -1.0  #: end of the service in progress, < 0: none
    way: Way = field(default_factory=Way)
    anchor: tuple[float, float] = (np.inf, np.inf)  #: where it made progress last [m]
    moved_at: float = 0.0  #: last time it was PROGRESS away from where it was


@dataclass(slots=True)
class StackState:
    """The memory of the whole stack."""

    missions: list[Mission]
    queues: list[QueueState]
    dispatcher: DispatcherState
    service: ServiceState
    controller: Controller
    next_planner: int = 0  #: robot whose plan is computed first
    link_epoch: int = 0  #: changes of links seen so far
    map_epoch: int = 0  #: changes of blockages seen so far

    def digest(self) -> str:
        """sha256 over everything that decides the next commands."""
        seen = hashlib.sha256()
        fingerprint(self, seen)
        return seen.hexdigest()


class Stack:
    """The stack of a world under a configuration; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        defects = config.defects
        self._world = world
        self._config = config
        self._defects = frozenset(defects)
        self._dt = 1.0 / config.control_rate
        allocator = registry.build("allocator", config.allocator, defects=defects)
        policy = registry.build("queue_policy", config.queue_policy, defects=defects)
        planner = registry.build("planner", config.planner, defects=defects)
        self._dispatcher = Dispatcher(world, allocator, defects)
        self._queues = [Queue(resource, policy, defects) for resource in world.resources]
        self._queue_of_room = {
            queue.resource.room: i
            for i, queue in enumerate(self._queues)
            if queue.resource.kind == "room"
        }
        self._areas = Areas(self._queues)
        self._rooms = [
            (i, queue) for i, queue in enumerate(self._queues) if queue.resource.kind == "room"
        ]
        self._refuges = refuges_of(world)
        self._waypoints: WaypointGenerator = registry.build(
            "waypoint_generator", config.waypoint_generator, defects=defects
        )
        self._priority: PriorityRule = registry.build(
            "priority_rule", config.priority_rule, defects=defects
        )
        self._service = PlanningService(
            planner, costmaps, failure_blocks="planner_failure_blocks_all" in defects
        )
        self._lanes: dict[tuple[int, int], Lane] = {
            (lane.start, lane.end): lane for lane in world.lanes
        }
        self._read_outages(world)
        blockages = [event for event in world.events if isinstance(event, Blockage)]
        self._map_changes = sorted({t for event in blockages for t in (event.start, event.end)})
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
        queues = [QueueState() for _ in self._queues]
        for robot, spec in enumerate(self._world.robots):
            position = spec.pose[:2]
            for queue, state in zip(self._queues, queues, strict=True):
                if not queue.is_left_at(position):
                    state.holders.append(robot)
                    if queue.resource.room is not None:
                        missions[robot].room = queue.resource.room
            if missions[robot].room < 0 and self._points:
                gaps = [_distance(point, position) for point in self._points]
                missions[robot].room = int(np.argmin(gaps))
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
        self._leave_rooms(state, fleet, events)
        for robot, mission in enumerate(state.missions):
            self._pursue(state, robot, mission, fleet, events)
        self._grant_rooms(state, fleet, events)
        self._make_room(state, fleet, events)
        self._advance(state, fleet, events)
        self._plan(state, fleet, links, events)
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
                drive += _distance(self._points[stop.room], way.route[-1]) / MEAN_SPEED
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
        room = mission.itinerary[0].room
        position = fleet.pose[robot, :2]
        if "same_room_twice_stalls" in self._defects and mission.aim == "stalled":
            return
        index = self._queue_of_room.get(room)
        if index is None:
            self._head_for_room(mission, room, position, from_spot=False)
            return
        queue, memory = self._queues[index], state.queues[index]
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
                distance=_distance(self._points[room], position),
                deadline=self._next_deadline(mission),
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

    def _next_deadline(self, mission: Mission) -> float:
        drops = (stop.task for stop in mission.itinerary if stop.action == "dropoff")
        task = next(drops, None)
        return np.inf if task is None else self._world.tasks[task].deadline

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
                mission.serve_until = fleet.time + service + self._visit_time(state, robot, stop)
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
            if again and "same_room_twice_stalls" in self._defects:
                mission.aim, mission.phase = "stalled", DRIVING
                return

    def _has_arrived(
        self, state: StackState, robot: int, mission: Mission, stop: Stop, fleet: FleetState
    ) -> bool:
        if mission.aim == "stalled":
            return False
        if not _is_at(self._points[stop.room], fleet.pose[robot, :2], ROOM_REACHED, mission.way):
            return False
        index = self._queue_of_room.get(stop.room)
        if index is not None and robot not in state.queues[index].holders:
            return False
        return bool(np.abs(fleet.velocity[robot, :2]).max() <= AT_REST)

    def _visit_time(self, state: StackState, robot: int, stop: Stop) -> float:
        """Service time of the room itself [s], once per visit."""
        index = self._queue_of_room.get(stop.room)
        if index is None or robot in state.queues[index].entered:
            return 0.0
        state.queues[index].entered[robot] = state.missions[robot].serve_until
        return self._queues[index].resource.service_time

    # --- ways ---------------------------------------------------------------------------

    def _head_for_room(
        self, mission: Mission, room: int, position: Array, *, from_spot: bool
    ) -> None:
        mission.phase = DRIVING
        if mission.aim == TO_ROOM:
            return
        index = self._queue_of_room.get(room)
        lane = self._lanes.get((mission.room, room))
        entry = self._queues[index].resource.entry if index is not None else NO_POINTS
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
        queue = self._queues[index]
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
            and _is_at(mission.way.route[-1], position, reach, mission.way)
        )
        mission.phase = QUEUEING if arrived else DRIVING

    @staticmethod
    def _is_near_spot(queue: Queue, position: Array) -> bool:
        return bool(is_within(queue.resource.spots, position, NEAR_SPOT))

    # --- resources ----------------------------------------------------------------------

    def _leave_rooms(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        for index, queue in self._rooms:
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
        if has_finished and "room_freed_while_parked" in self._defects:
            return True
        if queue.resource.hold == "until_served" and robot in memory.entered:
            return True
        return queue.is_left_at(fleet.pose[robot, :2])

    def _grant_rooms(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        for index, queue in self._rooms:
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

    # --- idle robots --------------------------------------------------------------------

    def _make_room(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
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
                    name = self._queues[index].resource.name
                    self._send_away(state, robot, fleet, events, name=name, other=other)
                    break
            else:
                if (fleet.tick + robot) % REPLAN_TICKS == 0:
                    self._clear_way(state, robot, fleet, events)

    def _end_parking(self, mission: Mission, robot: int, fleet: FleetState) -> None:
        place = self._refuges.points[mission.parking]
        if _is_at(place, fleet.pose[robot, :2], SPOT_REACHED, mission.way):
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
                index = self._queue_of_room.get(mission.itinerary[0].room)
                if index is not None:
                    wanted.setdefault(index, robot)
        for index, memory in enumerate(state.queues):
            if memory.waiters:
                wanted[index] = memory.waiters[0].robot
        return wanted

    def _occupies(self, state: StackState, index: int, robot: int, position: Array) -> bool:
        if robot in state.queues[index].holders:
            return True
        # The defect is that nobody notices a robot that is parked in a room it has freed.
        careless = "room_freed_while_parked" in self._defects
        return not careless and not self._queues[index].is_left_at(position)

    def _clear_way(
        self, state: StackState, robot: int, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        """Send an idle robot away from another's destination, or from where one is stuck."""
        if "room_freed_while_parked" in self._defects:
            return  # the defect is that nobody minds a parked robot
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
            covers_end = _distance(end, position) < APART
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

    # --- paths --------------------------------------------------------------------------

    def _advance(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Drop waypoints that are reached."""
        for robot, mission in enumerate(state.missions):
            way = mission.way
            if len(way.route) < 2 or len(way.halt):
                continue
            if is_near(way.route[0], fleet.pose[robot], WAYPOINT_REACHED):
                way.route = way.route[1:]
                way.must_plan = True
                events.append(StackEvent(time=fleet.time, kind="waypoint", robot=robot))

    def _plan(
        self, state: StackState, fleet: FleetState, links: Links, events: list[StackEvent]
    ) -> None:
        state.service.note_parked(fleet.pose[:, :2], fleet.parked_for)
        self._note_blockages(state, fleet.time)
        n = len(state.missions)
        plans = 0
        for k in range(n):
            robot = (state.next_planner + k) % n
            mission = state.missions[robot]
            way = mission.way
            if not way.is_going or not links.planner[robot]:
                continue
            position = fleet.pose[robot, :2]
            if not way.must_plan and (fleet.tick + robot) % REPLAN_TICKS == 0:
                self._check_path(state, mission, position, fleet.time)
            if not way.must_plan or fleet.time < way.plan_at:
                continue
            if plans == PLANS_PER_TICK:
                state.next_planner = robot
                break
            plans += 1
            had_failed = way.failed
            if self._service.plan(state.service, way, position, fleet.time):
                events.append(StackEvent(time=fleet.time, kind="replanned", robot=robot))
            elif way.failed and way.failed != had_failed:
                events.append(
                    StackEvent(time=fleet.time, kind="no-path", robot=robot, detail=way.failed)
                )

    def _note_blockages(self, state: StackState, time: float) -> None:
        """A blockage that begins or ends is a reason for everybody to plan again."""
        epoch = bisect.bisect_right(self._map_changes, time)
        if epoch != state.map_epoch:
            state.map_epoch = epoch
            for mission in state.missions:
                mission.way.must_plan, mission.way.plan_at = mission.way.is_going, 0.0

    def _check_path(
        self, state: StackState, mission: Mission, position: Array, time: float
    ) -> None:
        way = mission.way
        if not len(way.path):
            way.must_plan = True
            return
        rest, _, _, length = look_along(way.path, position[0], position[1], LOOK_AHEAD)
        if length <= 2.0 * SPOT_REACHED or mission.standing is not None:
            return  # it is where it is to be
        stuck = time - mission.moved_at > RETRY and time >= way.plan_at
        off_path = np.hypot(rest[0, 0] - position[0], rest[0, 1] - position[1]) > OFF_PATH
        if stuck or off_path or self._service.is_obstructed(state.service, way, position, time):
            way.must_plan = True

    # --- control ------------------------------------------------------------------------

    def _limit(
        self, state: StackState, views: Views, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        """Shorten ways so that robots stop before what they do not hold."""
        for robot, mission in enumerate(state.missions):
            if mission.stops_short_of >= 0 and len(views.rest[robot]):
                area = self._queues[mission.stops_short_of].resource.release_area
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
                deadline=self._next_deadline(mission),
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
            return np.asarray(self._refuges.points[parking] if aim == TO_PARKING else NOT_A_POINT)
        index = self._queue_of_room.get(room)
        if aim == TO_SPOT and index is not None and place >= 0:
            spots = self._queues[index].resource.spots
            if place < len(spots):
                return np.asarray(spots[place])
        return self._points[room]

    def _resources_waited_for(self, state: StackState) -> tuple[str, ...]:
        names = [""] * len(state.missions)
        for queue, memory in zip(self._queues, state.queues, strict=True):
            for waiter in memory.waiters:
                names[waiter.robot] = names[waiter.robot] or queue.resource.name
        return tuple(names)


@dataclass(frozen=True, slots=True, eq=False)
class _Goals:
    """Where robots with these aims head for."""

    aims: tuple[tuple[int, str, int, int], ...]  #: N: next room, aim, place in queue, refuge
    points: Array  #: (N, 2) [m], nan: nowhere


def _distance(point: Array, other: Array) -> float:
    """Distance [m] of two points ``(2,)``."""
    return float(np.hypot(point[0] - other[0], point[1] - other[1]))


def _is_at(point: Array, position: Array, reach: float, way: Way) -> bool:
    """Whether a robot is where it wants to be: near the point, or as near as its path leads.

    The planner moves a goal that is covered by up to 0.25 m.
    """
    if is_near(point, position, reach):
        return True
    if not len(way.path) or len(way.route) > 1:
        return False
    end = way.path[-1]
    return _distance(end, point) <= ROOM_REACHED and _distance(end, position) <= AT_PATH_END


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
