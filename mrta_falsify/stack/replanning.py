"""When paths are planned, checked and planned again."""

from __future__ import annotations

import bisect

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.protocols import CostmapSource
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.stack.comms import Links
from mrta_falsify.stack.lookahead import LOOK_AHEAD
from mrta_falsify.stack.mission import Mission, StackState
from mrta_falsify.stack.planning_service import (
    OFF_PATH,
    RETRY,
    SPOT_REACHED,
    WAYPOINT_REACHED,
    PlanningService,
    is_near,
    look_along,
)

PLANS_PER_TICK = 6
CHECK_TICKS = 10  # between two checks of a path, 2 Hz at 20 Hz control


class Paths:
    """The rule by which paths are planned; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        defects = config.defects
        planner = registry.build("planner", config.planner, defects=defects)
        self._service = PlanningService(
            planner, costmaps, failure_blocks="planner_failure_blocks_all" in defects
        )
        blockages = [event for event in world.events if isinstance(event, Blockage)]
        self._map_changes = sorted({t for event in blockages for t in (event.start, event.end)})

    def advance(self, state: StackState, fleet: FleetState, events: list[StackEvent]) -> None:
        """Drop waypoints that are reached."""
        for robot, mission in enumerate(state.missions):
            way = mission.way
            if len(way.route) < 2 or len(way.halt):
                continue
            if is_near(way.route[0], fleet.pose[robot], WAYPOINT_REACHED):
                way.route = way.route[1:]
                way.must_plan = True
                events.append(StackEvent(time=fleet.time, kind="waypoint", robot=robot))

    def plan(
        self, state: StackState, fleet: FleetState, links: Links, events: list[StackEvent]
    ) -> None:
        """Plan for robots that need it, as many as a tick has time for."""
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
            if not way.must_plan and (fleet.tick + robot) % CHECK_TICKS == 0:
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
