"""How the controller is asked: what all robots do along the ways ahead of them."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.protocols import (
    Controller,
    ControlResult,
    ControlView,
    PriorityRule,
    PriorityView,
)
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Off, Serving, Waiting
from mrta_falsify.stack.comms import Links
from mrta_falsify.stack.cruising import BRAKING_SHARE, Cruise
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.lookahead import Outlook, Views
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.mission_table import MissionTable, Rows, record_of
from mrta_falsify.stack.route import RETRY, SPOT_REACHED

#: what a mission says of how its robot drives
DRIVE_RECORD = record_of(
    ("present", np.bool_),  # has joined
    ("serves", np.bool_),  # loads or unloads
    ("waits", np.bool_),  # stands, or stood a moment ago, where it is to wait
    ("stands", np.bool_),  # before a resource on its way, or in it
)


_way_of = operator.attrgetter("way")


class DrivingMemory(Protocol):
    """What is remembered of robots that drive, wherever it is kept."""

    missions: list[Mission]
    headway: Headway
    controller: Controller


class Driving:
    """Shows the controller what it may know; has no memory that decides anything.

    Args:
        world: of the episode.
        config: its controller and priority rule.
    """

    def __init__(self, world: World, config: StackConfig) -> None:
        self._config = config
        self._dt = 1.0 / config.control_rate
        self._priority: PriorityRule = registry.build(
            "priority_rule", config.priority_rule, defects=config.defects
        )
        robots = world.robots
        self._max_speed = np.array([robot.max_speed for robot in robots])
        self._max_acceleration = np.array([robot.max_acceleration for robot in robots])
        self._max_turn_rate = np.array([robot.max_turn_rate for robot in robots])
        self._places = Polylines.of([np.asarray(r.release_area) for r in world.resources])
        self._table = MissionTable(DRIVE_RECORD, _drive_of)
        self._outlook = Outlook(
            [
                Cruise(
                    min(robot.max_speed, robot.cruise_speed),
                    BRAKING_SHARE * robot.max_acceleration,
                )
                for robot in robots
            ]
        )

    def new_controller(self) -> Controller:
        """Build a controller that remembers nothing."""
        built: Controller = registry.build(
            "controller", self._config.controller, defects=self._config.defects
        )
        return built

    def views(self, missions: list[Mission], pose: Array) -> Views:
        """Look along the ways of all robots from ``pose`` ``(N, 3)``."""
        return self._outlook.views(list(map(_way_of, missions)), pose)

    def control(
        self,
        state: DrivingMemory,
        views: Views,
        fleet: FleetState,
        links: Links,
        *,
        first: Sequence[int] = (),
        closed: BoolArray | None = None,
    ) -> ControlResult:
        """Ask for one tick's commands.

        Args:
            state: memory; that of the controller moves on.
            views: what is ahead of the robots.
            fleet: what their sensors say.
            links: between them.
            first: robots that go before all others in this order, whatever the priority rule says.
            closed: ``(N, A)`` resources of the world that others hold, up to their capacity.
        """
        rows, n = self._table.rows(state.missions), len(state.missions)
        target, since = views.target.copy(), np.empty(n)
        active, present = np.empty((2, n), dtype=np.bool_)
        moved_at = state.headway.moved_at
        _fill_drives(rows, views.length, (moved_at, fleet.time), target, since, (active, present))
        rank = self._priority.ranks(
            PriorityView(
                time=fleet.time,
                pose=fleet.pose,
                active=active,
                distance_to_goal=views.length,
                waiting_since=since,
            )
        )
        if first:
            rank = _ranked_first(rank, first)
        return state.controller.control(
            ControlView(
                time=fleet.time,
                dt=self._dt,
                pose=fleet.pose,
                velocity=fleet.velocity,
                target=target,
                goal=views.end,
                path=views.rest,
                active=active,
                present=present,
                rank=rank,
                obstacle_points=fleet.obstacle_points,
                human_position=fleet.human_position,
                human_velocity=fleet.human_velocity,
                human_radius=fleet.human_radius,
                states_link=links.states,
                leader_link=links.leader,
                max_speed=self._max_speed,
                max_acceleration=self._max_acceleration,
                max_turn_rate=self._max_turn_rate,
                cruise=views.pace,
                shared_places=self._places,
                closed=closed,
            )
        )


def _drive_of(robot: int, mission: Mission) -> tuple[object, ...]:
    """Describe a mission by a DRIVE_RECORD."""
    del robot
    activity = mission.activity
    return (
        not isinstance(activity, Off),
        isinstance(activity, Serving),
        isinstance(activity, Waiting) and activity.arrived,
        mission.passage.standing is not None,
    )


def _ranked_first(rank: IntArray, robots: Sequence[int]) -> IntArray:
    """Rank ``(N,)`` some robots before all others, in the order given; else the order stays."""
    key = rank + len(robots)
    key[list(robots)] = np.arange(len(robots))
    return key.argsort().argsort()


@njit(cache=True)
def _fill_drives(
    rows: Rows,
    length: Array,
    progress: tuple[Array, float],
    target: Array,
    since: Array,
    flags: tuple[BoolArray, BoolArray],
) -> None:
    """Say who drives, who is there, and who is held up.

    Args:
        rows: ``(N,)`` of DRIVE_RECORD.
        length: ``(N,)`` of the ways ahead [m], inf: none.
        progress: when each robot made progress last ``(N,)``, and the time now [s].
        target: ``(N, 2)`` points to steer for; nan is written for robots at their waiting spots.
        since: ``(N,)`` filled with the time since when there was no progress [s], inf: there is.
        flags: ``(N,)`` each, filled: drives or loads; has joined.
    """
    moved_at, now = progress
    active, present = flags
    for i in range(rows.shape[0]):
        robot, has_way = rows[i], length[i] < np.inf
        at_spot = robot.waits and length[i] < SPOT_REACHED
        if at_spot:
            target[i, 0], target[i, 1] = np.nan, np.nan
        active[i] = not at_spot and (not robot.stands if has_way else robot.serves)
        present[i] = robot.present
        since[i] = moved_at[i] if now - moved_at[i] > RETRY else np.inf
