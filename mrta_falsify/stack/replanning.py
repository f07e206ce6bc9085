"""When paths are planned, checked and planned again."""

from __future__ import annotations

import bisect
from dataclasses import replace
from typing import Protocol

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.plane import NO_POINTS, is_near
from mrta_falsify.core.polyline import look_along
from mrta_falsify.core.protocols import CostmapSource
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.stack.comms import Links
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.mission_table import MissionTable, Rows, record_of
from mrta_falsify.stack.planning_service import PlanningService, ServiceState
from mrta_falsify.stack.resources.queue import QueueState
from mrta_falsify.stack.route import LOOK_AHEAD, RETRY, SPOT_REACHED, WAYPOINT_REACHED, Way

PLANS_PER_TICK = 6  # so many a tick of 50 ms has time for
CHECK_TICKS = 10  # between two checks of a path, 2 Hz at 20 Hz control
OFF_PATH = 0.5  # m beside the path, then the robot plans again

#: what a mission says of the planning of its way
WAY_RECORD = record_of(
    ("going", np.bool_),  # there is somewhere to go
    ("must_plan", np.bool_),
    ("plan_at", np.float64),  # no plan before this time [s]
    ("waypoint", np.float64, (2,)),  # dropped as soon as it is reached [m], nan: none
)
NOWHERE = (np.nan, np.nan)


class PlanningMemory(Protocol):
    """What is remembered of planning, wherever it is kept."""

    headway: Headway
    service: ServiceState
    queues: list[QueueState]  #: of all resources; empty: no robot asks for any
    next_planner: int  #: robot whose plan is computed first
    map_epoch: int  #: changes of blockages seen so far


class Replanning:
    """The rule by which paths are planned; has no memory of its own."""

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        defects = config.defects
        planner = registry.build("planner", config.planner, defects=defects)
        self._service = with_defects(PlanningService, defects)(
            planner,
            costmaps,
            rooms=[
                np.asarray(r.release_area if r.room is not None else NO_POINTS)
                for r in world.resources
            ],
        )
        blockages = [event for event in world.events if isinstance(event, Blockage)]
        self._map_changes = sorted({t for event in blockages for t in (event.start, event.end)})
        self._table = MissionTable(WAY_RECORD, _way_of)

    def step(
        self, missions: list[Mission], state: PlanningMemory, fleet: FleetState, links: Links
    ) -> tuple[list[Mission], list[StackEvent]]:
        """Drop waypoints that are reached, then plan for robots that need it.

        Args:
            missions: of all robots.
            state: memory; what concerns planning is brought up to date.
            fleet: what the robots' sensors say.
            links: a robot without a link to the planner gets no new path.
        """
        reached, may_plan = self._due(missions, fleet, links)
        planned, events = list(missions), list[StackEvent]()
        for robot in reached:
            planned[robot] = _with_way(planned[robot], planned[robot].way.beyond_waypoint())
            events.append(StackEvent(time=fleet.time, kind="waypoint", robot=robot))
        state.service.note_parked(fleet.pose[:, :2], fleet.parked_for)
        has_changed = self._map_has_changed(state, fleet.time)
        if has_changed:
            planned = [_planning_anew(mission) for mission in planned]
        if reached or has_changed:
            _, may_plan = self._due(planned, fleet, links)
        split = bisect.bisect_left(may_plan, state.next_planner)
        plans = 0
        for robot in may_plan[split:] + may_plan[:split]:
            mission = planned[robot]
            way = self._checked(robot, mission, state, fleet)
            if way.must_plan and fleet.time >= way.plan_at:
                if plans == PLANS_PER_TICK:
                    planned[robot] = _with_way(mission, way)
                    state.next_planner = robot
                    break
                plans += 1
                position, before = fleet.pose[robot, :2], way
                not_held = [
                    room for room, queue in enumerate(state.queues) if robot not in queue.holders
                ]
                way = self._service.plan(state.service, way, position, fleet.time, not_held)
                events += _news(robot, before, way, fleet.time)
            planned[robot] = _with_way(mission, way)
        return planned, events

    def _due(
        self, missions: list[Mission], fleet: FleetState, links: Links
    ) -> tuple[list[int], list[int]]:
        """List who is at its waypoint, and who may plan now or has a path that is to be checked."""
        reached, may_plan = np.empty((2, len(missions)), dtype=np.bool_)
        rows = self._table.rows(missions)
        _fill_due(rows, fleet.pose, links.planner, fleet.tick, fleet.time, reached, may_plan)
        return reached.nonzero()[0].tolist(), may_plan.nonzero()[0].tolist()

    def _map_has_changed(self, state: PlanningMemory, time: float) -> bool:
        """Whether a blockage began or ended since the last tick."""
        epoch = bisect.bisect_right(self._map_changes, time)
        changed = epoch != state.map_epoch
        state.map_epoch = epoch
        return changed

    def _checked(
        self, robot: int, mission: Mission, state: PlanningMemory, fleet: FleetState
    ) -> Way:
        """Let the robot plan again if its path is outdated; checked every CHECK_TICKS."""
        way = mission.way
        if way.must_plan or (fleet.tick + robot) % CHECK_TICKS != 0:
            return way
        if self._is_outdated(robot, mission, state, fleet):
            return replace(way, must_plan=True)
        return way

    def _is_outdated(
        self, robot: int, mission: Mission, state: PlanningMemory, fleet: FleetState
    ) -> bool:
        way, position, time = mission.way, fleet.pose[robot, :2], fleet.time
        if not len(way.path):
            return True
        rest, _, _, length = look_along(way.path, position[0], position[1], LOOK_AHEAD)
        if length <= 2.0 * SPOT_REACHED or mission.passage.standing is not None:
            return False  # it stands where it is to stand
        stuck = time - state.headway.moved_at[robot] > RETRY and time >= way.plan_at
        off_path = np.hypot(rest[0, 0] - position[0], rest[0, 1] - position[1]) > OFF_PATH
        return bool(
            stuck or off_path or self._service.is_obstructed(state.service, way, position, time)
        )


def _way_of(robot: int, mission: Mission) -> tuple[object, ...]:
    """Describe a mission by a WAY_RECORD."""
    del robot
    way = mission.way
    leads_on = len(way.route) > 1 and not len(way.halt)
    waypoint = tuple(way.route[0].tolist()) if leads_on else NOWHERE
    return way.is_going, way.must_plan, way.plan_at, waypoint


@njit(cache=True)
def _fill_due(
    rows: Rows,
    pose: Array,
    link: BoolArray,
    tick: int,
    time: float,
    reached: BoolArray,
    may_plan: BoolArray,
) -> None:
    """Say who is at its waypoint, and whose plan or check of its path is due.

    Args:
        rows: ``(N,)`` of WAY_RECORD.
        pose: ``(N, 3)``.
        link: ``(N,)`` to the planner.
        tick: number.
        time: [s].
        reached: ``(N,)`` filled.
        may_plan: ``(N,)`` filled.
    """
    for i in range(rows.shape[0]):
        robot = rows[i]
        reached[i] = is_near(robot.waypoint, pose[i], WAYPOINT_REACHED)
        due = time >= robot.plan_at if robot.must_plan else (tick + i) % CHECK_TICKS == 0
        may_plan[i] = robot.going and link[i] and due


def _planning_anew(mission: Mission) -> Mission:
    """Let a robot that drives plan at once."""
    way = mission.way
    return replace(mission, way=replace(way, must_plan=way.is_going, plan_at=0.0))


def _with_way(mission: Mission, way: Way) -> Mission:
    return mission if way is mission.way else replace(mission, way=way)


def _news(robot: int, before: Way, way: Way, time: float) -> list[StackEvent]:
    """Tell of a new path, or of a new reason why there is none."""
    if way is before or (way.failed and way.failed == before.failed):
        return []
    kind = "no-path" if way.failed else "replanned"
    return [StackEvent(time=time, kind=kind, robot=robot, detail=way.failed)]
