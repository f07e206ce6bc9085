"""Who blocks whom: edges derived from motion, geometry, goals and paths.

The stack's own claims (phase, queue place, who leads) are not used, so a layer that emits nothing,
or lies, is judged just as well. Only of a robot that has a free path before it, the stack is asked
who has what it waits for (see :mod:`.locks`). An edge means *robot i cannot move on
until j moves*. A robot with a goal and without an edge is making progress or is being served.

Causes:
    ``queue``: waits at a spot (or outside) of a resource that ``other`` occupies or was granted,
        or stands behind ``other`` in its queue. Without a resource: the stack tells so.
    ``barrier``: robot ``other`` stands on the next metre of its path.
    ``human``: a person stands there.
    ``wall``: a solid (``resource`` names it) lies on the path, or holds the robot off.
    ``cluster``: the way is free, but a robot near by moves first.
    ``no-path``: has a goal, but no path; ``other`` is the robot that cuts it, if one does,
        ``resource`` the furniture or blockage, or ``unreachable`` if walls cut it off for good.
    ``stalled``: nothing at all is in the way.
    ``task``: has no goal: waits for a task and is not blocked.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.fleet import BlockedBy, Intent, Sensed, StackEvent, Tells
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.free_distance import FreeDistance, free_distance
from mrta_falsify.specs.deadlock.goals import GoalMap
from mrta_falsify.specs.deadlock.locks import Locks
from mrta_falsify.specs.deadlock.no_path import NoPathReasons
from mrta_falsify.specs.deadlock.obstruction import HUMAN_REACH, Obstruction
from mrta_falsify.specs.deadlock.occupancy import SolidGrid
from mrta_falsify.specs.deadlock.queue_edges import queue_edges, queue_edges_from_afar
from mrta_falsify.specs.deadlock.service_clock import ServiceClock
from mrta_falsify.specs.deadlock.snapshot import FleetSnapshot
from mrta_falsify.specs.deadlock.standstill import Standstill

STANDS_AFTER = 1.0  # s on its spot until a robot is asked what is in the way
EDGES_EVERY = 0.25  # s between two looks at the geometry
KEPT_OFF_BEYOND = 0.3  # m; a robot that is held off its goal by more than this is not served
CLUSTER_RANGE = 4.0  # m, neighbour distance of MRTA-Sim's clusters
OWN_CAUSES = ("barrier", "queue", "wall", "no-path", "human")  #: causes a robot has by itself


def look_stride(dt: float) -> int:
    """Find how many ticks of ``dt`` [s] lie between two looks at the geometry."""
    return max(1, round(EDGES_EVERY / dt))


@dataclass(slots=True)
class BlockedByTracker:
    """Derives the blocked-by edges of every tick; one object per episode."""

    world: World
    dt: float  #: control period [s]
    _standstill: Standstill = field(init=False)
    _space: SolidGrid = field(init=False)
    _service: ServiceClock = field(init=False)
    _obstruction: Obstruction = field(init=False)
    _no_path: NoPathReasons = field(init=False)
    _locks: Locks = field(init=False)
    _stride: int = field(init=False)
    _edges: tuple[BlockedBy, ...] = ()
    _joins: Array = field(init=False)
    _free: FreeDistance | None = None  #: for stacks that tell no paths

    def __post_init__(self) -> None:
        world = self.world
        self._standstill = Standstill(len(world.robots))
        self._space = SolidGrid(world)
        self._service = ServiceClock(world, GoalMap(world))
        self._obstruction = Obstruction(world, self._space)
        self._no_path = NoPathReasons(world, self._space)
        self._locks = Locks(world)
        self._stride = look_stride(self.dt)
        self._joins = np.array([robot.joins_at for robot in world.robots])

    def update(
        self,
        sensed: Sensed,
        intent: Intent,
        served: IntArray,
        tells: Tells = Tells(),  # noqa: B008 - immutable
        events: Iterable[StackEvent] = (),
    ) -> tuple[BlockedBy, ...]:
        """Derive the edges of this tick, sorted by robot.

        The result is the same object until the geometry is looked at again.

        Args:
            sensed: ground truth.
            intent: only goals, paths and the number of stops left are used.
            served: ``(N,)`` stops done to date.
            tells: whether the stack tells paths; without, robots are taken to drive the shortest
                way past walls and furniture.
            events: that the stack tells in this tick.
        """
        self._locks.update(events)
        since = self._standstill.update(sensed.pose, sensed.time, intent.goal)
        if sensed.tick % self._stride:
            return self._edges
        self._service.update(sensed, intent, served)
        self._space.furnish(sensed.furniture_pose)
        still = sensed.time - since >= STANDS_AFTER - 1e-9
        if not still.any():
            self._edges = ()
            return self._edges
        snapshot = FleetSnapshot(
            world=self.world,
            sensed=sensed,
            intent=intent,
            position=np.ascontiguousarray(sensed.pose[:, :2]),
            still=still,
            present=self._joins <= sensed.time,
            path=intent.path if tells.paths else self._shortest_ways(sensed, intent),
            goal=tuple(self._service.goal),
            at_goal=self._service.at_goal,
        )
        edges = self._edges_of(snapshot)
        if edges != self._edges:
            self._edges = edges
        return self._edges

    def _shortest_ways(self, sensed: Sensed, intent: Intent) -> tuple[Array, ...]:
        """Find the way past walls and furniture that each robot with a goal should take."""
        if self._free is None:
            self._free = free_distance(self.world)
        return tuple(
            self._free.way(position, goal, HUMAN_REACH)
            if np.isfinite(goal).all()
            else np.zeros((0, 2))
            for position, goal in zip(sensed.pose[:, :2], intent.goal, strict=True)
        )

    def _edges_of(self, fleet: FleetSnapshot) -> tuple[BlockedBy, ...]:
        found: dict[int, list[BlockedBy]] = {}
        unexplained = []
        for i in (fleet.still & fleet.present).nonzero()[0].tolist():
            if fleet.is_idle(i):
                found[i] = [BlockedBy(i, "task")]
            elif self._service.is_in_service(i):
                continue
            elif not self._service.is_serving(i) or self._is_kept_off(fleet, i):
                found[i] = self._own_edges(fleet, i) or self._locks.edges(fleet, i)
                if not found[i]:
                    unexplained.append(i)
        explained = {i for i, edges in found.items() if edges}
        groups = _groups(fleet) if unexplained else {}
        late = {
            i: self._cluster_edges(fleet, i, [j for j in groups[i] if j != i], found, explained)
            for i in unexplained
        }
        found.update(late)
        return tuple(
            edge
            for i in sorted(found)
            for edge in sorted(found[i], key=lambda e: (e.cause, e.other, e.resource))
        )

    def _is_kept_off(self, fleet: FleetSnapshot, i: int) -> bool:
        """Whether something stands between a robot near its goal and the goal."""
        away = np.hypot(*(fleet.position[i] - fleet.intent.goal[i]))
        return bool(away > KEPT_OFF_BEYOND) and any(
            edge.cause != "human" for edge in self._obstruction.edges(fleet, i)
        )

    def _own_edges(self, fleet: FleetSnapshot, i: int) -> list[BlockedBy]:
        """Derive the edges for causes that a robot has by itself."""
        goal = fleet.goal[i]
        assert goal is not None
        if fleet.at_goal[i] and goal.kind == "spot":
            return queue_edges(fleet, i, goal) or [BlockedBy(i, "stalled")]
        if fleet.at_goal[i] and goal.kind == "room":
            return self._obstruction.edges(fleet, i) or [BlockedBy(i, "stalled")]
        if len(fleet.path[i]) == 0:
            return self._no_path.edges(fleet, i, goal)
        found = self._obstruction.edges(fleet, i)
        if not found and goal.resource >= 0:
            found = queue_edges_from_afar(fleet, i, goal)
        return found

    def _cluster_edges(
        self,
        fleet: FleetSnapshot,
        i: int,
        near: list[int],
        found: dict[int, list[BlockedBy]],
        explained: set[int],
    ) -> list[BlockedBy]:
        """Derive an edge to a neighbour that makes progress, else to one that is blocked itself."""
        neighbours = [j for j in near if fleet.goal[j] is not None]
        away = np.hypot(*(fleet.position - fleet.position[i]).T).tolist()
        moving = [j for j in neighbours if j not in found and not fleet.is_idle(j)]
        blocked = [
            j
            for j in neighbours
            if j in explained
            and found[j][0].cause in OWN_CAUSES
            and all(edge.other != i for edge in found[j])
        ]
        if moving or blocked:
            return [BlockedBy(i, "cluster", min(moving or blocked, key=lambda j: (away[j], j)))]
        if self._obstruction.is_held_off(fleet, i):
            return [BlockedBy(i, "wall")]
        equal = [j for j in neighbours if not fleet.is_idle(j)]
        return [BlockedBy(i, "cluster", j) for j in equal] or [BlockedBy(i, "stalled")]


def _groups(fleet: FleetSnapshot) -> dict[int, list[int]]:
    """Find the robots that are joined by hops of at most 4 m, for each robot that is present."""
    offset = fleet.position[:, None] - fleet.position
    is_near = (np.hypot(offset[..., 0], offset[..., 1]) < CLUSTER_RANGE) & fleet.present
    group_of: dict[int, list[int]] = {}
    for i in fleet.present.nonzero()[0].tolist():
        if i in group_of:
            continue
        reached, border = np.zeros(len(is_near), dtype=np.bool_), np.arange(i, i + 1)
        while len(border):
            reached[border] = True
            border = (is_near[border].any(axis=0) & ~reached).nonzero()[0]
        group = reached.nonzero()[0].tolist()
        group_of.update(dict.fromkeys(group, group))
    return group_of
