"""Who blocks whom: edges derived from motion, geometry, goals and paths.

The stack's own claims (phase, queue place, what it waits for, who leads) are not used, so a
layer that emits nothing, or lies, is judged just as well. An edge means *robot i cannot go on
until j moves*; a robot with a goal and without an edge is getting on or being served.

Causes:
    ``queue``: waits at a spot (or outside) of a resource that ``other`` occupies, or stands
        behind ``other`` in its queue.
    ``barrier``: robot ``other`` stands on the next metre of its path.
    ``human``: a person stands there.
    ``wall``: a solid (``resource`` names it) lies on the path, or holds the robot off.
    ``cluster``: the way is free, but a robot near by moves first.
    ``no-path``: has a goal, but no path; ``other`` is the robot that cuts it, if one does,
        ``resource`` the blockage, or ``unreachable`` if solids cut it off for good.
    ``stalled``: nothing at all is in the way.
    ``task``: has no goal: waits for a task and is not blocked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import BlockedBy, Command, Intent, Sensed, StackEvent
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.goals import Place, Places, contains
from mrta_falsify.specs.deadlock.motion import Standstill, first_conflicts, points_ahead
from mrta_falsify.specs.deadlock.occupancy import FreeSpace
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL, ServiceClock

STILL_FOR = 1.0  # s without progress before somebody is asked what is in the way
EVALUATE_EVERY = 0.25  # s between two looks at the geometry
ARRIVED = 0.3  # m, a robot that is kept off its goal by more than this is not served
REACH = 1.2  # m of path ahead on which a robot is in the way
HUMAN_REACH = 1.5  # m of path ahead on which a person is in the way
SOLID_REACH = 1.0  # m of path ahead on which a solid is in the way
ROBOT_CLEARANCE = 0.65  # m centre to centre: barrier distance 0.6 m and a margin
HUMAN_CLEARANCE = 0.3  # m between a robot's and a person's outline
HUMAN_NEAR = 0.8  # m centre to centre at which a person stops a robot from any side
SAME_TIME = 0.4  # m of path: obstacles this close behind the first one block as well
CLUSTER_RANGE = 4.0  # m, neighbour distance of MRTA-Sim's clusters
OBSTACLE_NEAR = 0.7  # m to a solid ahead that may hold a robot off
OBSTACLE_CONE = np.cos(np.radians(75.0))  # of the direction of travel
STEP = 0.1  # m between points looked at on a path
OWN_CAUSES = ("barrier", "queue", "wall", "no-path", "human")  #: causes a robot has by itself
UNREACHABLE = "unreachable"  #: ``resource`` of a no-path edge whose goal solids cut off for good


@dataclass(slots=True)
class BlockedByTracker:
    """Derives the blocked-by edges of every tick; one object per episode."""

    world: World
    dt: float  #: control period [s]
    _still: Standstill = field(init=False)
    _places: Places = field(init=False)
    _space: FreeSpace = field(init=False)
    _service: ServiceClock = field(init=False)
    _stride: int = field(init=False)
    _edges: tuple[BlockedBy, ...] = ()
    _radius: Array = field(init=False)
    _human_radius: Array = field(init=False)
    _joins: Array = field(init=False)
    _cut: dict[tuple[int, ...], tuple[BlockedBy, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        robots = self.world.robots
        self._still = Standstill(len(robots))
        self._places = Places(self.world)
        self._space = FreeSpace(self.world)
        self._service = ServiceClock(self.world, self._places)
        self._stride = max(1, round(EVALUATE_EVERY / self.dt))
        self._radius = np.array([robot.radius for robot in robots])
        self._human_radius = np.array([human.radius for human in self.world.humans])
        self._joins = np.array([robot.joins_at for robot in robots])

    def update(
        self, sensed: Sensed, command: Command, intent: Intent, events: Sequence[StackEvent]
    ) -> tuple[BlockedBy, ...]:
        """Edges of this tick, sorted by robot; the same object until they are looked at anew.

        Args:
            sensed: ground truth.
            command: not used; commands are claims until they move something.
            intent: only goals, paths and the number of stops left are used.
            events: not used.
        """
        del command, events
        since = self._still.update(sensed.pose, sensed.time, intent.goal)
        if sensed.tick % self._stride:
            return self._edges
        self._service.update(sensed, intent)
        self._space.furnish(sensed.furniture_pose)
        still = sensed.time - since >= STILL_FOR - 1e-9
        if not still.any():
            self._edges = ()
            return self._edges
        edges = _Look(self, sensed, intent, still).edges()
        if edges != self._edges:
            self._edges = edges
        return self._edges


class _Look:
    """One look at the geometry around the robots that stand still."""

    def __init__(
        self, tracker: BlockedByTracker, sensed: Sensed, intent: Intent, still: BoolArray
    ) -> None:
        self.tracker = tracker
        self.sensed = sensed
        self.intent = intent
        self.still = still
        self.position = np.ascontiguousarray(sensed.pose[:, :2])
        self.place = tracker._service.place
        self.at_goal = tracker._service.at_goal
        self.present = tracker._joins <= sensed.time
        self.found: dict[int, list[BlockedBy]] = {}

    def edges(self) -> tuple[BlockedBy, ...]:
        unexplained = []
        for i in np.flatnonzero(self.still & self.present).tolist():
            if self._is_idle(i):
                self.found[i] = [BlockedBy(i, "task")]
            elif self.tracker._service.is_in_service(i):
                continue
            elif not self.tracker._service.is_serving(i) or self._is_kept_off(i):
                self.found[i] = self._own_edges(i)
                if not self.found[i]:
                    unexplained.append(i)
        if unexplained:
            explained = {i for i, edges in self.found.items() if edges}
            late = {i: self._other_edges(i, explained) for i in unexplained}
            self.found.update(late)
        return tuple(
            edge
            for i in sorted(self.found)
            for edge in sorted(self.found[i], key=lambda e: (e.cause, e.other, e.resource))
        )

    def _is_kept_off(self, i: int) -> bool:
        """Whether something stands between a robot near its goal and the goal."""
        away = np.hypot(*(self.position[i] - self.intent.goal[i]))
        return bool(away > ARRIVED) and any(e.cause != "human" for e in self._in_the_way(i))

    def _is_idle(self, i: int) -> bool:
        place = self.place[i]
        if place is None:
            return True
        return bool(self.at_goal[i]) and place.kind in ("parking", "elsewhere")

    # --- causes a robot has by itself --------------------------------------------------

    def _own_edges(self, i: int) -> list[BlockedBy]:
        place = self.place[i]
        assert place is not None
        if self.at_goal[i] and place.kind == "spot":
            return self._queue_edges(i, place) or [BlockedBy(i, "stalled")]
        if self.at_goal[i] and place.kind == "room":
            return self._in_the_way(i) or [BlockedBy(i, "stalled")]
        if len(self.intent.path[i]) == 0:
            return self._no_path_edges(i, place)
        found = self._in_the_way(i)
        if not found and place.resource >= 0:
            found = self._queue_edges_from_afar(i, place)
        return found

    def _queue_edges(self, i: int, place: Place) -> list[BlockedBy]:
        resource = self.tracker.world.resources[place.resource]
        ahead = [
            (other.spot, j)
            for j, other in enumerate(self.place)
            if j != i
            and other is not None
            and other.kind == "spot"
            and other.resource == place.resource
            and other.spot < place.spot
        ]
        if ahead:
            return [BlockedBy(i, "queue", max(ahead)[1], resource.name)]
        return [BlockedBy(i, "queue", j, resource.name) for j in self._occupants(i, place)]

    def _occupants(self, i: int, place: Place) -> list[int]:
        """Robots that keep ``i`` out: inside first, then heading in, then still leaving."""
        world, places = self.tracker.world, self.tracker._places
        resource = world.resources[place.resource]
        inside, entering, leaving, coming = [], [], [], []
        for j, position in enumerate(self.position):
            other = self.place[j]
            waits = other is not None and other.kind == "spot" and other.resource == place.resource
            if j == i or waits:
                continue
            heads_in = (
                other is not None and other.kind == "room" and other.resource == place.resource
            )
            near = contains(resource.release_area, position)
            if places.is_inside(resource, position):
                inside.append(j)
            elif heads_in and near:
                entering.append(j)
            elif heads_in:
                coming.append(j)
            elif near and not self._is_idle(j):
                leaving.append(j)
        return inside + entering or leaving or coming

    def _queue_edges_from_afar(self, i: int, place: Place) -> list[BlockedBy]:
        """A robot that waits outside the queue, because it is full or has no spots."""
        resource = self.tracker.world.resources[place.resource]
        near = contains(resource.request_area, self.position[i]) or contains(
            resource.release_area, self.position[i]
        )
        if not near:
            return []
        if place.kind == "spot":
            spot = resource.spots[place.spot]
            taken = np.hypot(*(self.position - spot).T) <= AT_GOAL
            taken[i] = False
            return [BlockedBy(i, "queue", int(j), resource.name) for j in np.flatnonzero(taken)]
        own = float(np.hypot(*(self.position[i] - self.intent.goal[i])))
        return [
            BlockedBy(i, "queue", j, resource.name)
            for j in self._occupants(i, place)
            if np.hypot(*(self.position[j] - self.intent.goal[i])) < own
        ]

    def _in_the_way(self, i: int) -> list[BlockedBy]:
        """Robots, people and solids on the next metre of the path."""
        tracker = self.tracker
        path = self._way(i)
        x, y = self.position[i]
        ahead = points_ahead(path, x, y, HUMAN_REACH, STEP)
        humans = self.sensed.human_position
        others = np.array([j for j in range(len(self.position)) if j != i], dtype=np.int64)
        bodies = np.concatenate([self.position[others], humans])
        clearance = np.concatenate(
            [
                np.full(len(others), ROBOT_CLEARANCE),
                tracker._radius[i] + tracker._human_radius + HUMAN_CLEARANCE,
            ]
        )
        arcs = first_conflicts(ahead, x, y, bodies, clearance, STEP)
        arcs[: len(others)][arcs[: len(others)] > REACH] = np.inf
        solid_ahead = ahead[: int(SOLID_REACH / STEP) + 1]
        hit, name = tracker._space.solid_at(solid_ahead, self.sensed.time)
        solid_arc = hit * STEP if hit >= 0 else np.inf
        first = min(float(arcs.min(initial=np.inf)), solid_arc)
        found = []
        if np.isfinite(first):
            for k in np.flatnonzero(arcs <= first + SAME_TIME):
                if k < len(others):
                    found.append(BlockedBy(i, "barrier", int(others[k])))
                else:
                    found.append(BlockedBy(i, "human", int(k - len(others))))
            if solid_arc <= first + SAME_TIME:
                found.append(BlockedBy(i, "wall", -1, name))
            return found
        near = np.hypot(*(humans - self.position[i]).T) <= HUMAN_NEAR
        return [BlockedBy(i, "human", int(h)) for h in np.flatnonzero(near)]

    def _way(self, i: int) -> Array:
        path = self.intent.path[i]
        if len(path):
            return np.ascontiguousarray(path, dtype=np.float64)
        return np.stack([self.position[i], self.intent.goal[i]])

    def _no_path_edges(self, i: int, place: Place) -> list[BlockedBy]:
        """Why there is no path: solids, robots at rest, or nobody knows."""
        tracker, space = self.tracker, self.tracker._space
        resting = [j for j in np.flatnonzero(self.still) if j != i]
        goal = self.intent.goal[i]
        key = (
            i,
            *np.round(np.concatenate([goal, self.position[i]]) / 0.1).astype(int).tolist(),
            *np.round(self.position[resting].ravel() / 0.1).astype(int).tolist(),
            *(k for k, e in enumerate(tracker.world.events) if e.start <= self.sensed.time < e.end),
            *np.round(self.sensed.furniture_pose.ravel() / 0.1).astype(int).tolist(),
        )
        if key not in tracker._cut:
            if len(tracker._cut) > 256:
                tracker._cut.clear()
            tracker._cut[key] = self._why_no_path(i, goal, resting, space)
        found = list(tracker._cut[key])
        if place.resource >= 0 and all(edge.other < 0 and not edge.resource for edge in found):
            return self._queue_edges_from_afar(i, place) or found
        return found

    def _why_no_path(
        self, i: int, goal: Array, resting: list[np.intp], space: FreeSpace
    ) -> tuple[BlockedBy, ...]:
        time, start = self.sensed.time, self.position[i]
        gap = 2.0 * float(self.tracker._radius[i])
        nobody = np.zeros((0, 2))
        if not space.reachable(start, goal, time, others=nobody, gap=gap):
            later = space.reachable(
                start, goal, time, others=nobody, gap=gap, ignore_temporary=True
            )
            return (BlockedBy(i, "no-path", -1, self._blockage_now() if later else UNREACHABLE),)
        bodies = self.position[resting]
        if space.reachable(start, goal, time, others=bodies, gap=gap):
            return (BlockedBy(i, "no-path"),)
        alone = [
            j
            for j in resting
            if not space.reachable(start, goal, time, others=self.position[[j]], gap=gap)
        ]
        return tuple(BlockedBy(i, "no-path", int(j)) for j in alone or resting)

    def _blockage_now(self) -> str:
        for event in self.tracker.world.events:
            if event.start <= self.sensed.time < event.end and self.tracker._space.is_temporary(
                event.name
            ):
                return event.name
        return ""

    # --- causes that lie with others ---------------------------------------------------

    def _other_edges(self, i: int, explained: set[int]) -> list[BlockedBy]:
        """Cluster edges: to a neighbour that gets on, else to one with a reason of its own."""
        neighbours = [j for j in self._component(i) if self.place[j] is not None]
        distance = {j: float(np.hypot(*(self.position[j] - self.position[i]))) for j in neighbours}
        moving = [j for j in neighbours if j not in self.found and not self._is_idle(j)]
        if moving:
            return [BlockedBy(i, "cluster", min(moving, key=lambda j: (distance[j], j)))]
        reasons = [
            j
            for j in neighbours
            if j in explained
            and self.found[j][0].cause in OWN_CAUSES
            and all(edge.other != i for edge in self.found[j])
        ]
        if reasons:
            return [BlockedBy(i, "cluster", min(reasons, key=lambda j: (distance[j], j)))]
        if self._is_held_off(i):
            return [BlockedBy(i, "wall")]
        equal = [j for j in neighbours if not self._is_idle(j)]
        return [BlockedBy(i, "cluster", j) for j in equal] or [BlockedBy(i, "stalled")]

    def _component(self, i: int) -> list[int]:
        """Other robots joined to ``i`` by hops of at most 4 m."""
        reached, border = {i}, [i]
        while border:
            near = np.hypot(*(self.position - self.position[border.pop()]).T) < CLUSTER_RANGE
            new = [int(j) for j in np.flatnonzero(near & self.present) if j not in reached]
            reached.update(new)
            border.extend(new)
        return sorted(reached - {i})

    def _is_held_off(self, i: int) -> bool:
        """Whether a solid lies close ahead, as where a barrier row balances the pull."""
        offset = self.sensed.obstacle_points[i] - self.position[i]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        near = distance <= OBSTACLE_NEAR
        if not near.any():
            return False
        x, y = self.position[i]
        ahead = points_ahead(self._way(i), x, y, 0.5, STEP)
        pull = ahead[-1] - self.position[i]
        cosine = (offset[near] @ pull) / (distance[near] * np.hypot(*pull) + 1e-12)
        return bool((cosine >= OBSTACLE_CONE).any())
