"""One tick of the whole stack: tasks in, commands out.

``due tasks -> allocator -> itineraries -> waypoints -> queue grants -> paths -> ranks ->
look-ahead -> controller -> command``. The memory is an explicit value, :class:`StackState`:
``copy.deepcopy`` forks it, ``digest()`` compares it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.allocation import Stop
from mrta_falsify.core.arrays import Array
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
from mrta_falsify.core.world import Lane, World
from mrta_falsify.stack.comms import Links, links_at, outage_times
from mrta_falsify.stack.control.lookahead import lookahead_point, remaining_path
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, Report
from mrta_falsify.stack.navigation import (
    NO_POINTS,
    OFF_PATH,
    PARKED_AFTER,
    RETRY,
    ROOM_REACHED,
    SPOT_REACHED,
    WAYPOINT_REACHED,
    PlanningService,
    ServiceState,
    Way,
    distance_off,
    path_length,
)
from mrta_falsify.stack.room_queues import Queue, QueueState
from mrta_falsify.stack.waypoints import join

LOOK_AHEAD = 0.5  # m, MRTA-Sim
AT_REST = 0.1  # m/s, slow enough to load and unload
PROGRESS = 0.2  # m, moving this far counts as progress
PLANS_PER_TICK = 6
REPLAN_TICKS = 10  # checks of a path at 2 Hz, spread over the robots
NEAR_SPOT = 0.9  # m, a robot this near to a waiting spot uses the way from there

#: where a robot's route leads
NOWHERE, TO_ROOM, TO_SPOT, TO_PARKING = "", "room", "spot", "parking"


@dataclass(slots=True)
class Mission:
    """What one robot is about."""

    itinerary: list[Stop] = field(default_factory=list)
    onboard: list[int] = field(default_factory=list)
    phase: Phase = Phase.OFF
    aim: str = NOWHERE
    room: int = -1  #: room it was in last
    place: int = -1  #: place in the queue it stands in, -1: none
    parking: int = -1  #: parking spot it has or heads for, -1: none
    serve_until: float = -1.0  #: end of the service in progress, < 0: none
    way: Way = field(default_factory=Way)
    anchor: Array = field(default_factory=lambda: np.full(2, np.inf))
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

    def digest(self) -> str:
        """sha256 over everything that decides the next commands."""
        text = repr((self.missions, self.queues, self.dispatcher, self.service))
        return hashlib.sha256(text.encode()).hexdigest()


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
        self._dispatcher = Dispatcher(world, allocator)
        self._queues = [Queue(resource, policy, defects) for resource in world.resources]
        self._queue_of_room = {
            queue.resource.room: i
            for i, queue in enumerate(self._queues)
            if queue.resource.kind == "room"
        }
        self._areas = [i for i, q in enumerate(self._queues) if q.resource.kind != "room"]
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
        self._link_changes = np.array(outage_times(world))
        self._links: dict[int, Links] = {}
        robots = world.robots
        self._max_speed = np.array([robot.max_speed for robot in robots])
        self._max_acceleration = np.array([robot.max_acceleration for robot in robots])
        self._max_turn_rate = np.array([robot.max_turn_rate for robot in robots])
        self._points = [np.asarray(room.point) for room in world.rooms]

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
                gaps = [float(np.hypot(*(point - position))) for point in self._points]
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
        return self._dispatcher.all_arrived(state.dispatcher) and self._dispatcher.all_done(
            state.dispatcher
        )

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
        links = self._links_of(fleet.time)
        self._join(state, fleet, events)
        self._follow_progress(state, fleet)
        self._dispatch(state, fleet, links, events)
        self._leave_resources(state, fleet, events)
        for robot, mission in enumerate(state.missions):
            self._pursue(state, robot, mission, fleet, events)
        self._grant(state, fleet, events)
        self._make_room(state, fleet, events)
        self._advance(state, fleet, events)
        self._plan(state, fleet, links, events)
        command, intent = self._control(state, fleet, links)
        return state, command, intent, tuple(events)

    # --- what is known ------------------------------------------------------------------

    def _links_of(self, time: float) -> Links:
        epoch = int(np.searchsorted(self._link_changes, time, side="right"))
        if epoch not in self._links:
            self._links[epoch] = links_at(self._world, time)
        return self._links[epoch]

    def _join(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        for robot, mission in enumerate(state.missions):
            if mission.phase == Phase.OFF and fleet.time >= self._world.robots[robot].joins_at:
                mission.phase = Phase.IDLE
                events.append(StackEvent(time=fleet.time, kind="joined", robot=robot))

    @staticmethod
    def _follow_progress(state: StackState, fleet: FleetState) -> None:
        for robot, mission in enumerate(state.missions):
            gap = fleet.pose[robot, :2] - mission.anchor
            if not gap[0] * gap[0] + gap[1] * gap[1] <= PROGRESS * PROGRESS:
                mission.anchor = fleet.pose[robot, :2].copy()
                mission.moved_at = fleet.time

    # --- tasks --------------------------------------------------------------------------

    def _dispatch(
        self, state: StackState, fleet: FleetState, links: Links, events: list[StackEvent]
    ) -> None:
        reports = [
            Report(
                itinerary=tuple(mission.itinerary),
                onboard=tuple(mission.onboard),
                room=mission.room,
                distance=path_length(mission.way.path) if mission.itinerary else 0.0,
                reachable=mission.phase != Phase.OFF and bool(links.dispatcher[robot]),
            )
            for robot, mission in enumerate(state.missions)
        ]
        new, happened = self._dispatcher.dispatch(state.dispatcher, fleet.time, reports)
        events.extend(happened)
        for robot, itinerary in new.items():
            state.missions[robot].itinerary = list(itinerary)

    def _pursue(
        self,
        state: StackState,
        robot: int,
        mission: Mission,
        fleet: FleetState,
        events: list[StackEvent],
    ) -> None:
        """Work on the next stop: serve it, ask for its room, or find the way there."""
        if mission.phase == Phase.OFF:
            return
        self._serve(state, robot, mission, fleet, events)
        if not mission.itinerary:
            if mission.aim != TO_PARKING:
                if mission.aim != NOWHERE or mission.way.is_going:
                    mission.way.stop()
                mission.aim, mission.phase = NOWHERE, Phase.IDLE
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
        near = queue.is_asked_from(position) or self._is_near_spot(queue, position)
        if near:
            waiter = Waiter(
                robot=robot,
                since=fleet.time,
                distance=float(np.hypot(*(self._points[room] - position))),
                deadline=self._next_deadline(mission),
            )
            if queue.ask(memory, waiter):
                holder = memory.holders[0] if memory.holders else -1
                name = queue.resource.name
                events.append(
                    StackEvent(
                        time=fleet.time, kind="waits-for", robot=robot, resource=name, other=holder
                    )
                )
        self._head_for_spot(state, robot, mission, index, room, position)

    def _next_deadline(self, mission: Mission) -> float:
        drops = [self._world.tasks[s.task].deadline for s in mission.itinerary]
        return min(drops, default=np.inf)

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
                mission.serve_until = fleet.time + service
                mission.room, mission.place = stop.room, -1
                mission.way.stop()
                mission.aim, mission.phase = NOWHERE, Phase.SERVING
            if fleet.time < mission.serve_until:
                return
            mission.serve_until = -1.0
            del mission.itinerary[0]
            if stop.action == "pickup":
                mission.onboard.append(stop.task)
                state.dispatcher.picked_up.add(stop.task)
            else:
                mission.onboard.remove(stop.task)
                state.dispatcher.delivered.add(stop.task)
            kind = "picked-up" if stop.action == "pickup" else "dropped-off"
            name = self._world.rooms[stop.room].name
            events.append(
                StackEvent(time=fleet.time, kind=kind, robot=robot, task=stop.task, resource=name)
            )
            again = mission.itinerary and mission.itinerary[0].room == stop.room
            if again and "same_room_twice_stalls" in self._defects:
                mission.aim, mission.phase = "stalled", Phase.DRIVING
                return

    def _has_arrived(
        self, state: StackState, robot: int, mission: Mission, stop: Stop, fleet: FleetState
    ) -> bool:
        if mission.aim == "stalled":
            return False
        gap = self._points[stop.room] - fleet.pose[robot, :2]
        if np.hypot(gap[0], gap[1]) > ROOM_REACHED:
            return False
        index = self._queue_of_room.get(stop.room)
        if index is not None and robot not in state.queues[index].holders:
            return False
        return bool(np.abs(fleet.velocity[robot, :2]).max() <= AT_REST)

    # --- ways ---------------------------------------------------------------------------

    def _head_for_room(
        self, mission: Mission, room: int, position: Array, *, from_spot: bool
    ) -> None:
        mission.phase = Phase.DRIVING
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
        place = queue.place_of(state.queues[index], robot)
        lane = self._lanes.get((mission.room, room))
        approach = np.asarray(lane.to_queue) if lane is not None else queue.resource.spots
        if not len(approach):
            approach = self._points[room][None, :]
        known = place if place >= 0 else len(queue.resource.spots) - 1
        spot = queue.waiting_point(max(known, 0), approach)
        arrived = np.hypot(*(spot - position)) <= SPOT_REACHED
        mission.phase = Phase.QUEUEING if arrived and place >= 0 else Phase.DRIVING
        if mission.aim == TO_SPOT and mission.place == place:
            return
        moves_up = mission.aim == TO_SPOT and self._is_near_spot(queue, position)
        if lane is None or moves_up:
            route = spot[None, :]
        else:
            route = join(self._waypoints.to_queue(lane, spot), position, self._points[mission.room])
        mission.aim, mission.place, mission.parking = TO_SPOT, place, -1
        mission.way.head_for(np.asarray(route))

    @staticmethod
    def _is_near_spot(queue: Queue, position: Array) -> bool:
        spots = queue.resource.spots
        if not len(spots):
            return False
        gaps = spots - position
        return bool((gaps[:, 0] ** 2 + gaps[:, 1] ** 2).min() <= NEAR_SPOT**2)

    # --- resources ----------------------------------------------------------------------

    def _leave_resources(
        self, state: StackState, fleet: FleetState, events: list[StackEvent]
    ) -> None:
        for queue, memory in zip(self._queues, state.queues, strict=True):
            for robot in tuple(memory.holders):
                mission = state.missions[robot]
                room = queue.resource.room
                heads_here = bool(mission.itinerary) and mission.itinerary[0].room == room
                if heads_here and mission.aim in (TO_ROOM, NOWHERE):
                    continue
                finished = (
                    "room_freed_while_parked" in self._defects
                    and not mission.itinerary
                    and mission.phase == Phase.IDLE
                )
                if finished or queue.is_left_at(fleet.pose[robot, :2]):
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

    def _grant(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        for queue, memory in zip(self._queues, state.queues, strict=True):
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

    def _make_room(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Idle robots leave what others ask for; those that arrived at a parking spot rest."""
        parking = self._world.parking
        for mission, pose in zip(state.missions, fleet.pose, strict=True):
            if mission.aim == TO_PARKING:
                gap = parking[mission.parking] - pose[:2]
                if np.hypot(gap[0], gap[1]) <= SPOT_REACHED:
                    mission.way.stop()
                    mission.aim, mission.phase = NOWHERE, Phase.IDLE
        if not len(parking):
            return
        for queue, memory in zip(self._queues, state.queues, strict=True):
            if not memory.waiters and not self._is_wanted(state, queue):
                continue
            for robot in memory.holders:
                mission = state.missions[robot]
                if mission.phase == Phase.IDLE and mission.aim == NOWHERE:
                    other = memory.waiters[0].robot if memory.waiters else -1
                    self._send_to_parking(state, robot, fleet)
                    events.append(
                        StackEvent(
                            time=fleet.time,
                            kind="makes-room",
                            robot=robot,
                            resource=queue.resource.name,
                            other=other,
                        )
                    )

    @staticmethod
    def _is_wanted(state: StackState, queue: Queue) -> bool:
        """Whether somebody's next stop is here, even if it has not asked yet."""
        room = queue.resource.room
        return any(m.itinerary and m.itinerary[0].room == room for m in state.missions)

    def _send_to_parking(self, state: StackState, robot: int, fleet: FleetState) -> None:
        mission = state.missions[robot]
        taken = {m.parking for m in state.missions if m.parking >= 0}
        parking = self._world.parking
        gaps = np.hypot(*(parking - fleet.pose[robot, :2]).T)
        for spot in np.argsort(gaps, kind="stable").tolist():
            beside = np.hypot(*(fleet.pose[:, :2] - parking[spot]).T)
            beside[robot] = np.inf
            if spot not in taken and beside.min() > 0.6:
                mission.parking, mission.aim = int(spot), TO_PARKING
                mission.phase = Phase.MAKING_ROOM
                mission.way.head_for(np.asarray(parking[spot])[None, :])
                return

    # --- paths --------------------------------------------------------------------------

    def _advance(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Drop waypoints that are reached."""
        for robot, mission in enumerate(state.missions):
            way = mission.way
            if len(way.route) < 2:
                continue
            gap = way.route[0] - fleet.pose[robot, :2]
            if np.hypot(gap[0], gap[1]) <= WAYPOINT_REACHED:
                way.route = way.route[1:]
                way.must_plan = True
                events.append(StackEvent(time=fleet.time, kind="waypoint", robot=robot))

    def _plan(
        self, state: StackState, fleet: FleetState, links: Links, events: list[StackEvent]
    ) -> None:
        self._note_parked(state, fleet)
        self._service.look(state.service, fleet.time)
        n = len(state.missions)
        plans = 0
        for k in range(n):
            robot = (state.next_planner + k) % n
            mission = state.missions[robot]
            way, position = mission.way, fleet.pose[robot, :2]
            if not way.is_going or not links.planner[robot]:
                continue
            if not way.must_plan and (fleet.tick + robot) % REPLAN_TICKS == 0:
                self._check_path(mission, position, fleet.time)
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

    def _check_path(self, mission: Mission, position: Array, time: float) -> None:
        way = mission.way
        stuck = time - mission.moved_at > RETRY and time >= way.plan_at
        if (
            stuck
            or not len(way.path)
            or self._service.is_obstructed(way, position)
            or distance_off(way.path, position) > OFF_PATH
        ):
            way.must_plan = True

    def _note_parked(self, state: StackState, fleet: FleetState) -> None:
        """Robots at rest for some seconds become obstacles of the map."""
        parked = fleet.parked_for > PARKED_AFTER
        known = state.service.parked
        if len(known) == int(parked.sum()):
            now = fleet.pose[parked, :2]
            if not len(now) or np.abs(now - known).max() <= 0.1:
                return
        state.service.parked = fleet.pose[parked, :2].copy()

    # --- control ------------------------------------------------------------------------

    def _control(
        self, state: StackState, fleet: FleetState, links: Links
    ) -> tuple[Command, Intent]:
        n = len(state.missions)
        target, goal = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
        distance = np.full(n, np.inf)
        active = np.zeros(n, dtype=np.bool_)
        ahead: list[Array] = [NO_POINTS] * n
        for robot, mission in enumerate(state.missions):
            if not len(mission.way.path) or not mission.way.is_going:
                continue
            position = fleet.pose[robot, :2]
            rest = remaining_path(mission.way.path, position)
            ahead[robot] = rest
            target[robot] = lookahead_point(rest, position, LOOK_AHEAD)
            goal[robot] = rest[-1]
            distance[robot] = path_length(rest)
            at_spot = mission.phase == Phase.QUEUEING and distance[robot] < SPOT_REACHED
            active[robot] = not at_spot
            if at_spot:
                target[robot] = np.nan
        moved_at = np.array([mission.moved_at for mission in state.missions])
        ranks = self._priority.ranks(
            PriorityView(
                time=fleet.time,
                pose=fleet.pose,
                active=active,
                distance_to_goal=distance,
                waiting_since=np.where(fleet.time - moved_at > RETRY, moved_at, np.inf),
            )
        )
        present = np.array([m.phase != Phase.OFF for m in state.missions], dtype=np.bool_)
        view = ControlView(
            time=fleet.time,
            dt=self._dt,
            pose=fleet.pose,
            velocity=fleet.velocity,
            target=target,
            goal=goal,
            path=tuple(ahead),
            active=active,
            present=present,
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
        intent = Intent(
            phase=np.array([self._phase_of(m) for m in state.missions], dtype=np.int64),
            goal=self._final_goals(state),
            waypoint=np.array(
                [m.way.route[0] if len(m.way.route) else (np.nan, np.nan) for m in state.missions]
            ).reshape(n, 2),
            path=tuple(m.way.path for m in state.missions),
            cluster=result.cluster,
            leader=result.leader,
            slack=result.slack,
            tasks_left=np.array([len(m.itinerary) for m in state.missions], dtype=np.int64),
            queue=np.array([m.place for m in state.missions], dtype=np.int64),
            waits_for=tuple(self._resource_waited_for(state, r) for r in range(n)),
        )
        return result.command, intent

    @staticmethod
    def _phase_of(mission: Mission) -> int:
        if mission.phase == Phase.DRIVING and mission.way.is_going and not len(mission.way.path):
            return int(Phase.PLANNING)
        return int(mission.phase)

    def _final_goals(self, state: StackState) -> Array:
        goals = np.full((len(state.missions), 2), np.nan)
        for robot, mission in enumerate(state.missions):
            if mission.itinerary:
                goals[robot] = self._points[mission.itinerary[0].room]
            elif mission.aim == TO_PARKING:
                goals[robot] = self._world.parking[mission.parking]
        return goals

    def _resource_waited_for(self, state: StackState, robot: int) -> str:
        for queue, memory in zip(self._queues, state.queues, strict=True):
            if any(waiter.robot == robot for waiter in memory.waiters):
                return queue.resource.name
        return ""
