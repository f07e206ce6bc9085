"""One tick of the whole stack: tasks in, commands out.

``due tasks -> allocator -> itineraries -> rooms -> waypoints -> parking -> paths -> corridors ->
look-ahead -> ranks -> controller -> command``. The memory is an explicit value,
:class:`StackState`: ``copy.deepcopy`` forks it, ``digest()`` compares it. A stage takes the
missions of all robots and returns new ones, and the events of the tick. See ``docs/stack.md``
for the rules.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.fleet import Command, FleetState, Intent, StackEvent
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.protocols import (
    Allocator,
    CostmapSource,
)
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Idle, Off, Waiting
from mrta_falsify.stack.comms import Links, LinkTimetable
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, RobotReport
from mrta_falsify.stack.driving import Driving
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.intent import Declaration
from mrta_falsify.stack.itinerary import ItineraryFollower
from mrta_falsify.stack.lookahead import Views
from mrta_falsify.stack.mission import Mission, StackState
from mrta_falsify.stack.planning_service import ServiceState
from mrta_falsify.stack.replanning import Replanning
from mrta_falsify.stack.resources.clear_ways import ClearWays
from mrta_falsify.stack.resources.corridors import STOP_SHORT, Traveller, corridor_traffic
from mrta_falsify.stack.resources.crossings import find_crossing
from mrta_falsify.stack.resources.parking import ParkingTraffic
from mrta_falsify.stack.resources.right_of_way import coming_out
from mrta_falsify.stack.resources.rooms import RoomTraffic
from mrta_falsify.stack.route import SPOT_REACHED, Way


class Stack:
    """The stack of a world under a configuration; has no memory of its own."""

    def __init__(
        self,
        world: World,
        config: StackConfig,
        costmaps: CostmapSource,
        *,
        metered: Callable[[Allocator], Allocator] = lambda allocator: allocator,
    ) -> None:
        """Build the stack.

        Args:
            world: it works in.
            config: its layers.
            costmaps: that its planner uses.
            metered: gives an allocator that is asked instead, and may count its calls.
        """
        defects = config.defects
        self._world = world
        allocator = registry.build("allocator", config.allocator, defects=defects)
        self._dispatcher = with_defects(Dispatcher, defects)(world, metered(allocator))
        self._links = LinkTimetable(world)
        ways = ClearWays(world, costmaps.costmap(0.0, NO_POINTS))
        self._rooms = with_defects(RoomTraffic, defects)(world, config, ways)
        follower = with_defects(ItineraryFollower, defects)
        self._follower = follower(world, self._rooms, self._dispatcher)
        self._parking = with_defects(ParkingTraffic, defects)(world, self._rooms, ways)
        self._replanning = Replanning(world, config, costmaps)
        self._corridors = corridor_traffic(self._rooms.queues)
        self._joins_at = [robot.joins_at for robot in world.robots]
        # What these remember only saves work: the memory says it as well.
        self._driving = Driving(world, config)
        self._declaration = Declaration(world, self._rooms)

    def forget_after(self, state: StackState, time: float) -> None:
        """Let no task arrive any more, and no outage begin, after ``time`` [s]."""
        self._dispatcher.take_no_more(state.dispatcher)
        self._links = LinkTimetable(self._world, until=time)
        state.link_epoch = self._links.epoch_at(time)

    def start(self) -> StackState:
        """Memory at time 0: robots hold the rooms they stand in."""
        missions, queues = self._rooms.start([robot.pose[:2] for robot in self._world.robots])
        return StackState(
            missions=missions,
            headway=Headway.of_fleet(len(missions)),
            queues=queues,
            dispatcher=DispatcherState(),
            service=ServiceState(),
            controller=self._driving.new_controller(),
        )

    def step(
        self, state: StackState, fleet: FleetState
    ) -> tuple[StackState, Command, Intent, tuple[StackEvent, ...]]:
        """Run one control tick.

        Args:
            state: memory; it is consumed (``copy.deepcopy`` it first to fork).
            fleet: what the robots' sensors say.

        Returns:
            The memory for the next tick, the command, what the stack intends, and what
            happened and why.
        """
        links, told = self._current_links(state, fleet.time)
        state.headway.note(fleet.pose, fleet.time)
        missions, joined = self._join(state.missions, fleet)
        missions, assigned = self._dispatch(missions, state.dispatcher, fleet, links)
        missions, left = self._rooms.leave(missions, state.queues, fleet)
        missions, served = self._follower.step(missions, state, fleet)
        missions, granted = self._rooms.grant(missions, state.queues, fleet)
        missions, parked = self._parking.step(missions, state, fleet)
        missions, planned = self._replanning.step(missions, state, fleet, links)
        views = self._driving.views(missions, fleet.pose)
        missions, views = self._stop_short(missions, views, fleet)
        missions, views, passed = self._pass_corridors(missions, views, state, fleet)
        state.missions = missions
        command, intent = self._control(state, views, fleet, links)
        events = (*told, *joined, *assigned, *left, *served, *granted, *parked, *planned, *passed)
        return state, command, intent, events

    # --- what is known ------------------------------------------------------------------

    def _current_links(self, state: StackState, time: float) -> tuple[Links, list[StackEvent]]:
        earlier, epoch = state.link_epoch, self._links.epoch_at(time)
        state.link_epoch = epoch
        changes = self._links.changes(earlier, epoch, time) if epoch != earlier else []
        return self._links.links(epoch), changes

    def _join(
        self, missions: Sequence[Mission], fleet: FleetState
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Let robots take part from their time on."""
        known, events = list(missions), []
        for robot, mission in enumerate(missions):
            if isinstance(mission.activity, Off) and fleet.time >= self._joins_at[robot]:
                known[robot] = replace(mission, activity=Idle())
                events.append(StackEvent(time=fleet.time, kind="joined", robot=robot))
        return known, events

    # --- tasks --------------------------------------------------------------------------

    def _dispatch(
        self,
        missions: list[Mission],
        memory: DispatcherState,
        fleet: FleetState,
        links: Links,
    ) -> tuple[list[Mission], Sequence[StackEvent]]:
        """Give the robots new itineraries, if there is a reason."""

        def reports() -> list[RobotReport]:
            return [
                RobotReport(
                    itinerary=mission.itinerary,
                    onboard=mission.onboard,
                    room=mission.room,
                    first_ends=self._follower.first_stop_ends(
                        mission, fleet.pose[robot, :2], fleet.time
                    ),
                    reachable=not isinstance(mission.activity, Off)
                    and bool(links.dispatcher[robot]),
                )
                for robot, mission in enumerate(missions)
            ]

        orders = self._dispatcher.dispatch(memory, fleet.time, reports)
        given = list(missions)
        for robot, itinerary in orders.itineraries.items():
            given[robot] = replace(missions[robot], itinerary=itinerary)
        return given, orders.events

    # --- how far robots may drive ---------------------------------------------------------

    def _stop_short(
        self, missions: list[Mission], views: Views, fleet: FleetState
    ) -> tuple[list[Mission], Views]:
        """Let robots stop before rooms without waiting spots that they do not hold."""
        limits = {}
        stopping = list(missions)
        for robot, mission in enumerate(missions):
            waiting = mission.activity
            if not isinstance(waiting, Waiting):
                continue
            queue = self._rooms.queues[waiting.queue]
            if len(queue.spots) or not len(views.rest[robot]):
                continue
            enter, _ = find_crossing(views.rest[robot], queue.resource.release_area)
            limits[robot] = max(0.0, enter - STOP_SHORT)
            arrived = waiting.place is not None and limits[robot] <= SPOT_REACHED
            stopping[robot] = replace(mission, activity=replace(waiting, arrived=arrived))
        return stopping, views.shortened(limits, fleet.pose) if limits else views

    def _pass_corridors(
        self, missions: list[Mission], views: Views, state: StackState, fleet: FleetState
    ) -> tuple[list[Mission], Views, list[StackEvent]]:
        """Let robots stop before corridors, doors, lifts and chargers that they do not hold."""
        if self._corridors is None:
            return missions, views, []
        travellers = [
            Traveller(
                position=fleet.pose[robot, :2],
                ahead=_way_ahead(mission.way, views.rest[robot]),
                way=mission.way,
                passage=mission.passage,
                deadline=mission.next_deadline(self._world.tasks),
                room_needed=isinstance(mission.activity, Waiting),
            )
            for robot, mission in enumerate(missions)
        ]
        clearances, events = self._corridors.step(travellers, state.queues, fleet.time)
        passing = [
            mission
            if clearance.passage == mission.passage and clearance.way is mission.way
            else replace(mission, passage=clearance.passage, way=clearance.way)
            for mission, clearance in zip(missions, clearances, strict=True)
        ]
        limits = {robot: clearance.limit for robot, clearance in enumerate(clearances)}
        return passing, views.shortened(limits, fleet.pose), events

    # --- control ------------------------------------------------------------------------

    def _control(
        self, state: StackState, views: Views, fleet: FleetState, links: Links
    ) -> tuple[Command, Intent]:
        first = coming_out(self._rooms.queues, state.queues, fleet.pose)
        closed = self._rooms.closed(state.queues, len(fleet.pose))
        result = self._driving.control(state, views, fleet, links, first=first, closed=closed)
        return result.command, self._declaration.intent(state.missions, state.queues, result)


def _way_ahead(way: Way, rest: Array) -> Array:
    """Rest of the path, and the waypoints behind its end."""
    if not len(rest) or len(way.halt) or len(way.route) < 3:
        return rest
    return np.vstack([rest, way.route[2:]])
