"""How the controller is asked: what all robots do along the ways ahead of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState
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
from mrta_falsify.stack.lookahead import Outlook, Views
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.route import RETRY, SPOT_REACHED


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

    def views(self, missions: Sequence[Mission], pose: Array) -> Views:
        """Look along the ways of all robots from ``pose`` ``(N, 3)``."""
        return self._outlook.views([mission.way for mission in missions], pose)

    def control(
        self,
        controller: Controller,
        missions: Sequence[Mission],
        views: Views,
        fleet: FleetState,
        links: Links,
    ) -> ControlResult:
        """Ask for one tick's commands.

        Args:
            controller: is asked; its memory moves on.
            missions: of all robots.
            views: what is ahead of them.
            fleet: what their sensors say.
            links: between them.
        """
        lengths = views.length.tolist()
        at_spot = [_is_at_spot(m, length) for m, length in zip(missions, lengths, strict=True)]
        target = views.target
        if any(at_spot):
            target = target.copy()
            target[at_spot] = np.nan
        active = np.array(
            [
                not at and _is_active(mission, rest)
                for at, mission, rest in zip(at_spot, missions, views.rest, strict=True)
            ],
            dtype=np.bool_,
        )
        return controller.control(
            ControlView(
                time=fleet.time,
                dt=self._dt,
                pose=fleet.pose,
                velocity=fleet.velocity,
                target=target,
                goal=views.end,
                path=tuple(views.rest),
                active=active,
                present=np.array(
                    [not isinstance(m.activity, Off) for m in missions], dtype=np.bool_
                ),
                rank=self._ranks(missions, views, fleet, active),
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
            )
        )

    def _ranks(
        self, missions: Sequence[Mission], views: Views, fleet: FleetState, active: BoolArray
    ) -> IntArray:
        """Rank the robots: who goes first where they meet."""
        since = [m.moved_at if fleet.time - m.moved_at > RETRY else math.inf for m in missions]
        return self._priority.ranks(
            PriorityView(
                time=fleet.time,
                pose=fleet.pose,
                active=active,
                distance_to_goal=views.length,
                waiting_since=np.array(since),
            )
        )


def _is_at_spot(mission: Mission, length: float) -> bool:
    """Whether the robot waits at its spot, with ``length`` [m] of its way left."""
    activity = mission.activity
    return isinstance(activity, Waiting) and activity.arrived and length < SPOT_REACHED


def _is_active(mission: Mission, rest: Array) -> bool:
    """Whether the robot drives along ``rest`` ``(L, 2)`` [m], or loads."""
    if not len(rest):
        return isinstance(mission.activity, Serving)
    return mission.passage.standing is None
