"""Robots whose stack says where to, not how: they are planned for and driven as the shipped ones.

A foreign stack may leave driving to the harness, robot by robot. Such a robot gets
a plan to its goal, or keeps to the path that it was given, and the configured controller drives it
past the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.protocols import Controller, ControlResult, CostmapSource
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Heading, Idle, Off
from mrta_falsify.stack.comms import Links
from mrta_falsify.stack.driving import Driving
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.planning_service import ServiceState
from mrta_falsify.stack.replanning import Replanning
from mrta_falsify.stack.resources.queue import QueueState
from mrta_falsify.stack.route import Way


@dataclass(frozen=True, slots=True, eq=False)
class Destination:
    """Where a robot is to be driven."""

    goal: Array  #: (2,) [m], not finite: nowhere
    path: Array  #: (L, 2) [m] to keep to; empty: one is planned to the goal


@dataclass(slots=True)
class FollowState:
    """Memory of robots that are driven for their stack."""

    missions: list[Mission]
    headway: Headway
    controller: Controller
    service: ServiceState = field(default_factory=ServiceState)
    queues: list[QueueState] = field(default_factory=list)  #: none: it asks for no room
    next_planner: int = 0  #: robot whose plan is computed first
    map_epoch: int = 0  #: changes of blockages seen so far


class Following:
    """Drives robots to their destinations; has no memory that decides anything.

    Args:
        world: of the episode.
        config: its planner, controller and priority rule.
        costmaps: of the building.
    """

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        self._world = world
        self._replanning = Replanning(world, config, costmaps)
        self._driving = Driving(world, config)

    def start(self) -> FollowState:
        """Memory before the first destination."""
        return FollowState(
            missions=[Mission() for _ in self._world.robots],
            headway=Headway.of_fleet(len(self._world.robots)),
            controller=self._driving.new_controller(),
        )

    def step(
        self,
        state: FollowState,
        destinations: Sequence[Destination | None],
        fleet: FleetState,
        links: Links,
    ) -> tuple[ControlResult, list[StackEvent]]:
        """Plan and drive for one tick.

        Args:
            state: memory; it is brought up to date.
            destinations: of the N robots, None: it drives by itself.
            fleet: what the robots' sensors say.
            links: a robot without a link to the planner gets no new path.

        Returns:
            Commands of all robots, of which those of the robots with a destination are meant, and
            what happened to these.
        """
        state.headway.note(fleet.pose, fleet.time)
        missions = [
            self._minded(robot, mission, there, state, fleet)
            for robot, (mission, there) in enumerate(zip(state.missions, destinations, strict=True))
        ]
        keep_theirs = [there is not None and len(there.path) > 0 for there in destinations]
        planner = links.planner & ~np.array(keep_theirs, dtype=np.bool_)
        links = replace(links, planner=planner)
        state.missions, events = self._replanning.step(missions, state, fleet, links)
        views = self._driving.views(state.missions, fleet.pose)
        result = self._driving.control(state, views, fleet, links)
        return result, events

    def _minded(
        self,
        robot: int,
        mission: Mission,
        there: Destination | None,
        state: FollowState,
        fleet: FleetState,
    ) -> Mission:
        """Let a robot head for its destination of the moment."""
        if self._world.robots[robot].joins_at > fleet.time:
            state.headway.forget(robot)
            return replace(mission, activity=Off())
        way = _way_to(mission.way, there)
        activity = Heading() if way.is_going else Idle()
        if way is mission.way and activity == mission.activity:
            return mission
        return replace(mission, way=way, activity=activity)


def _way_to(way: Way, there: Destination | None) -> Way:
    """Take up a destination; the same way if it leads there already."""
    if there is not None and len(there.path):
        if way.path is there.path:
            return way
        return Way(route=there.path[-1:], path=there.path)
    if there is None or not np.isfinite(there.goal).all():
        return way.stopped() if way.is_going else way
    if way.is_going and np.array_equal(way.route[-1], there.goal):
        return way
    return way.head_for(there.goal[None, :])
