"""How long a knot must last to count as a deadlock where no forecast can tell.

A knot is *hard* if no member has a way round the others, or they hold resources that exclude each
other.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.no_path import UNREACHABLE
from mrta_falsify.specs.deadlock.occupancy import SolidGrid
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot

BODY_CELL = 0.05  # m, grid on which ways round are looked for
BODY_MARGIN = 0.03  # m beyond the robot's radius that any way needs on each side
HARDNESS_KEPT_FOR = 2.0  # s for which the answer "is there a way round" is kept


class Patience(NamedTuple):
    """How long knots of each kind must last [s]."""

    hard: float  #: no member has a way round
    behind_idle: float  #: hard, but an idle robot stands in the way
    soft: float  #: a member may have a way round, or may back off

    def of_knot(
        self, edges: Collection[BlockedBy], permanent: Collection[BlockedBy], *, hard: bool
    ) -> float:
        """Choose how long a knot with these ``edges`` must last [s].

        No way round does not mean no way back: robots that stand before each other may still
        back off, and an idle one may be sent out of the way. Only what no robot can mend by
        moving (a goal that solids cut off, a circle of held resources) counts at once.
        """
        in_the_way = any(edge.cause == "barrier" and edge not in permanent for edge in edges)
        if not hard or in_the_way:
            return self.soft
        behind_idle = any(
            edge.other >= 0 and edge.cause != "human" and edge in permanent for edge in edges
        )
        return self.behind_idle if behind_idle else self.hard


class Hardness:
    """Judges whether knots are hard, and keeps the answers; one object per episode.

    Args:
        world: of the episode.
        robot_gap: distance needed to pass a robot, centre to centre [m].
    """

    def __init__(self, world: World, robot_gap: float) -> None:
        radius = min((robot.radius for robot in world.robots), default=0.0)
        self._space = SolidGrid(world, cell=BODY_CELL, clearance=radius + BODY_MARGIN)
        self._robot_gap = robot_gap
        self._known: dict[frozenset[BlockedBy], tuple[float, bool]] = {}

    def is_hard(self, knot: EdgesByRobot, permanent: Collection[BlockedBy], frame: Frame) -> bool:
        """Whether the robots of ``knot``, given with their edges, cannot get past each other."""
        time = frame.sensed.time
        shown = [edge for own in knot.values() for edge in own]
        asked_at, answer = self._known.get(frozenset(shown), (-np.inf, False))
        if time - asked_at < HARDNESS_KEPT_FOR:
            return answer
        self._space.furnish(frame.sensed.furniture_pose)
        idle = {edge.other for edge in shown if edge in permanent and edge.cause != "human"}
        bodies = (set(knot) | idle) - {-1}
        answer = all(self._has_no_way_out(i, own, bodies, frame) for i, own in knot.items())
        self._known[frozenset(shown)] = (time, answer)
        return answer

    def _has_no_way_out(self, i: int, own: list[BlockedBy], bodies: set[int], frame: Frame) -> bool:
        for edge in own:
            if edge.cause == "queue" or edge.resource == UNREACHABLE:
                return True
            if edge.cause in ("human", "cluster", "stalled") or (
                edge.cause == "wall" and not edge.resource
            ):
                return False
        position = frame.sensed.pose[:, :2]
        return not self._space.reachable(
            position[i],
            frame.intent.goal[i],
            frame.sensed.time,
            others=position[sorted(bodies - {i})],
            gap=self._robot_gap,
        )
