"""Which robots wait only for what never moves, or for each other."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy, Sensed
from mrta_falsify.core.world import CommsOutage, World
from mrta_falsify.specs.deadlock.occupancy import FreeSpace
from mrta_falsify.specs.deadlock.wait_graph import is_unexplained

STILL = 0.3  # m or rad; a person, or a piece of furniture, that stays within this stands


class _Rested:
    """Since when each of several things has stood; ``order`` is that of the norm of a move."""

    def __init__(self, count: int, columns: int, order: float) -> None:
        self._order = order
        self._place = np.full((count, columns), np.inf)
        self.since = np.zeros(count)  #: (count,) [s]

    def note(self, place: Array, time: float) -> None:
        """Take in where they are, ``(count, columns)``, at ``time`` [s]."""
        moved = ~(np.linalg.norm(place - self._place, self._order, axis=1) <= STILL)
        self._place[moved] = place[moved]
        self.since[moved] = time


class Hope:
    """Tells robots that may still get going from those that are lost; one object per episode.

    Args:
        world: of the episode.
        space: knows which solids are there for a time only.
        patience: how long a person, or furniture on wheels, stands before it counts as
            permanent [s].
    """

    def __init__(self, world: World, space: FreeSpace, patience: float) -> None:
        self._world = world
        self._space = space
        self._patience = patience
        self._names = tuple(robot.name for robot in world.robots)
        pieces = world.movable_furniture()
        self._piece = {item.name: k for k, item in enumerate(pieces)}
        self._people = _Rested(len(world.humans), 2, 2)
        self._pieces = _Rested(len(pieces), 3, np.inf)

    def note(self, sensed: Sensed) -> None:
        """Take in where people and movable furniture are."""
        if len(self._world.humans):
            self._people.note(sensed.human_position, sensed.time)
        if len(sensed.furniture_pose) == len(self._piece) > 0:
            self._pieces.note(sensed.furniture_pose, sensed.time)

    def lost(
        self, edges: dict[int, list[BlockedBy]], time: float
    ) -> tuple[set[int], set[BlockedBy]]:
        """Robots without hope at ``time`` [s], and the edges that lead to something permanent.

        Found by striking out those that wait for something that may move.
        """
        idle = {i for i, own in edges.items() if own[0].cause == "task"}
        permanent = {
            edge
            for own in edges.values()
            for edge in own
            if edge.cause != "task" and self._is_permanent(edge, idle, time)
        }
        if self._awaits_an_end(time):
            permanent = {edge for edge in permanent if not is_unexplained(edge)}
        cut_off = self._in_outage(time)
        lost = {i for i in edges if i not in idle and i not in cut_off}
        while True:
            hopeful = {
                i
                for i in lost
                if any(
                    edge not in permanent and (edge.cause == "human" or edge.other not in lost)
                    for edge in edges[i]
                )
            }
            if not hopeful:
                return lost, permanent
            lost -= hopeful

    def _is_permanent(self, edge: BlockedBy, idle: set[int], time: float) -> bool:
        if edge.cause == "human":
            human = self._world.humans[edge.other]
            if len(human.route) == 1 or human.speed == 0.0:
                return human.leaves_at >= self._world.horizon
            return bool(time - self._people.since[edge.other] > self._patience)
        if edge.other >= 0:
            return edge.other in idle
        if edge.cause == "wall" and edge.resource in self._piece:
            rests = time - self._pieces.since[self._piece[edge.resource]]
            return bool(rests > self._patience)
        return not (edge.resource and self._space.is_temporary(edge.resource))

    def _awaits_an_end(self, time: float) -> bool:
        """Whether something from outside is in force that will end before the horizon."""
        return any(
            event.start <= time < event.end < self._world.horizon for event in self._world.events
        )

    def _in_outage(self, time: float) -> set[int]:
        """Robots whose links are down and will come up again before the horizon."""
        cut: set[str] = set()
        for event in self._world.events:
            if not isinstance(event, CommsOutage) or event.end >= self._world.horizon:
                continue
            if event.start <= time < event.end:
                cut.update(event.robots or self._names)
        return {i for i, name in enumerate(self._names) if name in cut}
