"""What will never move again: the things that a wait-for graph cannot be reduced past."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy, Sensed
from mrta_falsify.core.world import CommsOutage, World
from mrta_falsify.specs.deadlock.occupancy import is_temporary
from mrta_falsify.specs.deadlock.reduction import ReducedGraph, idle_robots, stuck_robots
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, is_unexplained

RESTS_WITHIN = 0.3  # m or rad; a person or a piece of furniture that moves less is at rest


class _RestClock:
    """Clock of the time since which each of several things has rested.

    Args:
        count: things.
        columns: numbers that say where one is.
        order: of the norm of a move.
    """

    def __init__(self, count: int, columns: int, order: float) -> None:
        self._order = order
        self._place = np.full((count, columns), np.inf)
        self.since = np.zeros(count)  #: (count,) [s]

    def update(self, place: Array, time: float) -> None:
        """Take in where they are, ``(count, columns)``, at ``time`` [s]."""
        moved = ~(np.linalg.norm(place - self._place, self._order, axis=1) <= RESTS_WITHIN)
        self._place[moved] = place[moved]
        self.since[moved] = time


class Permanence:
    """Judges which obstacles are permanent; one object per episode.

    Args:
        world: of the episode.
        patience: how long a person, or furniture on wheels, must rest to count as permanent [s].
    """

    def __init__(self, world: World, patience: float) -> None:
        self._world = world
        self._patience = patience
        pieces = world.movable_furniture()
        self._piece = {item.name: k for k, item in enumerate(pieces)}
        self._people = _RestClock(len(world.humans), 2, 2)
        self._pieces = _RestClock(len(pieces), 3, np.inf)

    def update(self, sensed: Sensed) -> None:
        """Take in where people and movable furniture are."""
        if len(self._world.humans):
            self._people.update(sensed.human_position, sensed.time)
        if len(sensed.furniture_pose) == len(self._piece) > 0:
            self._pieces.update(sensed.furniture_pose, sensed.time)

    def reduce(self, edges: EdgesByRobot, time: float) -> ReducedGraph:
        """Reduce the wait-for graph of the moment ``time`` [s]."""
        idle = idle_robots(edges)
        permanent = frozenset(
            edge
            for own in edges.values()
            for edge in own
            if edge.cause != "task" and self._is_permanent(edge, idle, time)
        )
        if self._awaits_an_end(time):
            permanent = frozenset(edge for edge in permanent if not is_unexplained(edge))
        stuck = stuck_robots(edges, permanent, idle | self._in_outage(time))
        return ReducedGraph(edges, permanent, stuck)

    def _is_permanent(self, edge: BlockedBy, idle: set[int], time: float) -> bool:
        if edge.cause == "human":
            human = self._world.humans[edge.other]
            if len(human.route) == 1 or human.speed == 0.0:
                return human.leaves_at >= self._world.horizon
            return bool(time - self._people.since[edge.other] > self._patience)
        if edge.other >= 0:
            return edge.other in idle
        if edge.cause == "wall" and edge.resource in self._piece:
            rested = time - self._pieces.since[self._piece[edge.resource]]
            return bool(rested > self._patience)
        return not (edge.resource and is_temporary(self._world, edge.resource))

    def _awaits_an_end(self, time: float) -> bool:
        """Whether an outside event is in force that will end before the horizon."""
        return any(
            event.start <= time < event.end < self._world.horizon for event in self._world.events
        )

    def _in_outage(self, time: float) -> set[int]:
        """Find the robots whose links are down and will come up again before the horizon."""
        names = tuple(robot.name for robot in self._world.robots)
        cut: set[str] = set()
        for event in self._world.events:
            if not isinstance(event, CommsOutage) or event.end >= self._world.horizon:
                continue
            if event.start <= time < event.end:
                cut.update(event.robots or names)
        return {i for i, name in enumerate(names) if name in cut}
