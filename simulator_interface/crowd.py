"""People on their routes: which way each goes, and the model that moves them.

A route is a list of points; the way between two of them is planned on the costmap, so that
nobody is sent through a bed. The model (social force by default) only sees the next point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.costmap import INSCRIBED, Costmap
from mrta_falsify.core.fleet import Sensed
from mrta_falsify.core.protocols import CostmapSource, CrowdView, HumanModel, Planner
from mrta_falsify.core.world import Blockage, HumanSpec, World

LOOK_AHEAD = 0.8  # m along the way to the point that a person walks towards
ARRIVAL = 0.3  # m, goal switch distance of MRTA-Sim's people
LOST = 1.5  # m off the way: look for a new one
FREE_REACH = 2.0  # m, how far a route point inside an obstacle may be moved
PATIENCE = 8.0  # s without progress before a person turns to the next point of the route
WINDOW = 40  # points of the way that are looked at; they are about 0.1 m apart
NO_ROBOTS = np.zeros((0, 2))


@dataclass(slots=True)
class _Walker:
    """Where one person stands on the route."""

    spec: HumanSpec
    next_point: int  #: index into the route
    way: Array  #: (L, 2) planned points to the next route point
    passed: int = 0  #: points of the way already passed
    closest: float = np.inf  #: least distance to the end of the way so far [m]
    closest_at: float = 0.0  #: when that was [s]


@dataclass(slots=True)
class Crowd:
    """All people of a world."""

    world: World
    model: HumanModel
    planner: Planner
    source: CostmapSource
    dt: float  #: control period [s]
    _walkers: list[_Walker] = field(default_factory=list)
    _map: Costmap | None = None
    _blockages: tuple[Blockage, ...] = ()
    _edges: Array = field(default_factory=lambda: np.zeros((0, 4)))
    _radius: Array = field(init=False)
    _reacts: BoolArray = field(init=False)
    _robot_radius: Array = field(init=False)

    def __post_init__(self) -> None:
        humans = self.world.humans
        self._radius = np.array([human.radius for human in humans])
        self._reacts = np.array([human.reacts_to_robots for human in humans], dtype=np.bool_)
        self._robot_radius = np.array([robot.radius for robot in self.world.robots])

    def start(self) -> Array:
        """Start positions ``(H, 2)`` [m] of the people on their planned ways."""
        self._look(0.0)
        self._edges = solid_edges(self.world, 0.0)
        positions = np.zeros((len(self.world.humans), 2))
        for i, spec in enumerate(self.world.humans):
            positions[i], walker = self._start_of(spec)
            self._walkers.append(walker)
        return positions

    def velocities(self, sensed: Sensed) -> Array:
        """Velocities ``(H, 2)`` [m/s] for the tick after ``sensed``."""
        if not self._walkers:
            return np.zeros((0, 2))
        if self._look(sensed.time):
            self._edges = solid_edges(self.world, sensed.time)
        targets = np.empty_like(sensed.human_position)
        for i, walker in enumerate(self._walkers):
            targets[i] = self._target(walker, sensed.human_position[i], sensed.time)
        heading = sensed.pose[:, 2]
        forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
        robot_velocity = forward * sensed.velocity[:, :1] + left * sensed.velocity[:, 1:2]
        view = CrowdView(
            dt=self.dt,
            position=sensed.human_position,
            velocity=sensed.human_velocity,
            target=targets,
            desired_speed=np.array([self._speed(w) for w in self._walkers]),
            radius=self._radius,
            reacts_to_robots=self._reacts,
            present=present_humans(self.world, sensed.time),
            robot_position=sensed.pose[:, :2],
            robot_velocity=robot_velocity,
            robot_radius=self._robot_radius,
            walls=self._edges,
        )
        return self.model.velocities(view)

    @staticmethod
    def _speed(walker: _Walker) -> float:
        return walker.spec.speed if len(walker.way) else 0.0

    def _look(self, time: float) -> bool:
        """Take up the costmap of the moment; says whether solids changed."""
        costmap = self.source.costmap(time, NO_ROBOTS)
        if costmap is self._map:
            return False
        self._map = costmap
        self.planner.use(costmap)
        return True

    def _start_of(self, spec: HumanSpec) -> tuple[Array, _Walker]:
        route = [self._free_point(point) for point in spec.route]
        standing = _Walker(spec=spec, next_point=0, way=np.zeros((0, 2)))
        if len(route) < 2:
            return route[0], standing
        last = len(route) if spec.repeat else len(route) - 1
        legs = [self._way(route[i], route[(i + 1) % len(route)]) for i in range(last)]
        lengths = [_length(leg) for leg in legs]
        walked = spec.start * sum(lengths)
        for i, (leg, length) in enumerate(zip(legs, lengths, strict=True)):
            if len(leg) and (walked <= length or i == len(legs) - 1):
                point, rest = _cut(leg, min(walked, length))
                return point, _Walker(spec=spec, next_point=(i + 1) % len(route), way=rest)
            walked -= length
        return route[0], standing

    def _free_point(self, point: Array) -> Array:
        """``point``, or the nearest place beside the obstacle it lies in."""
        assert self._map is not None
        if self._map.cost_at(point) < INSCRIBED:
            return np.asarray(point)
        reach = int(FREE_REACH / self._map.resolution)
        offsets = np.arange(-reach, reach + 1)
        grid = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
        grid = grid[np.argsort((grid**2).sum(axis=1), kind="stable")]
        centers = self._map.centers(self._map.cells(point) + grid)
        free = self._map.cost_at(centers) < INSCRIBED
        return centers[int(np.argmax(free))] if free.any() else np.asarray(point)

    def _way(self, start: Array, goal: Array) -> Array:
        plan = self.planner.plan(np.asarray(start), np.asarray(goal))
        return plan.path if plan.found else np.zeros((0, 2))

    def _target(self, walker: _Walker, position: Array, time: float) -> Array:
        if not len(walker.way):
            return position
        end = float(np.hypot(*(walker.way[-1] - position)))
        if end < walker.closest - 0.2:
            walker.closest, walker.closest_at = end, time
        if end < ARRIVAL or time - walker.closest_at > PATIENCE:
            self._turn_to_next_point(walker, position, time)
        elif _off_way(walker.way, walker.passed, position) > LOST:
            self._find_way(walker, position, time)
        if not len(walker.way):
            return position
        walker.passed, ahead = _ahead(walker.way, walker.passed, position)
        return walker.way[ahead]

    def _turn_to_next_point(self, walker: _Walker, position: Array, time: float) -> None:
        points = len(walker.spec.route)
        is_last = walker.next_point == (0 if walker.spec.repeat else points - 1)
        if is_last and not walker.spec.repeat:
            walker.way = np.zeros((0, 2))
            return
        walker.next_point = (walker.next_point + 1) % points
        self._find_way(walker, position, time)

    def _find_way(self, walker: _Walker, position: Array, time: float) -> None:
        """A way to the next route point, or to the first after it that can be reached."""
        points = len(walker.spec.route)
        way = np.zeros((0, 2))
        for _ in range(points):
            way = self._way(position, self._free_point(walker.spec.route[walker.next_point]))
            if len(way) or not walker.spec.repeat:
                break
            walker.next_point = (walker.next_point + 1) % points
        if not len(way):  # shut in for now: keep the old way and ask again later
            way = walker.way[walker.passed :]
        walker.way, walker.passed = way, 0
        walker.closest, walker.closest_at = np.inf, time


def present_humans(world: World, time: float) -> BoolArray:
    """Which people ``(H,)`` are in the building at ``time`` [s]."""
    return np.array([h.appears_at <= time < h.leaves_at for h in world.humans], dtype=np.bool_)


def solid_edges(world: World, time: float) -> Array:
    """Edges ``(S, 4)`` x1, y1, x2, y2 [m] of everything solid at ``time`` [s]."""
    blockages = [
        event
        for event in world.events
        if isinstance(event, Blockage) and event.start <= time < event.end
    ]
    polygons = [*world.solid_polygons(), *(event.polygon for event in blockages)]
    if not polygons:
        return np.zeros((0, 4))
    return np.concatenate([np.hstack([p, np.roll(p, -1, axis=0)]) for p in polygons])


@njit(cache=True)
def _off_way(way: Array, passed: int, position: Array) -> float:
    """Distance [m] from ``position`` to the next stretch of ``way``."""
    best = np.inf
    for i in range(passed, min(passed + WINDOW, len(way))):
        best = min(best, np.hypot(way[i, 0] - position[0], way[i, 1] - position[1]))
    return best


@njit(cache=True)
def _ahead(way: Array, passed: int, position: Array) -> tuple[int, int]:
    """Index of the closest point not yet passed, and of the point to walk towards."""
    closest, best, stop = passed, np.inf, min(passed + WINDOW, len(way))
    for i in range(passed, stop):
        distance = np.hypot(way[i, 0] - position[0], way[i, 1] - position[1])
        if distance < best:
            closest, best = i, distance
    for i in range(closest, stop):
        if np.hypot(way[i, 0] - position[0], way[i, 1] - position[1]) >= LOOK_AHEAD:
            return closest, i
    return closest, stop - 1


def _length(points: Array) -> float:
    if len(points) < 2:
        return 0.0
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _cut(points: Array, distance: float) -> tuple[Array, Array]:
    """Point ``distance`` [m] along ``points`` and what follows it."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    i = int(np.searchsorted(reached, distance, side="right")) - 1
    i = min(max(i, 0), len(points) - 2)
    share = (distance - reached[i]) / steps[i] if steps[i] > 0.0 else 0.0
    point = points[i] + min(share, 1.0) * (points[i + 1] - points[i])
    return point, np.vstack([point, points[i + 1 :]])
