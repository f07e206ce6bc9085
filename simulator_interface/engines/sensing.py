"""What an engine measures: least gaps over sub-steps, parked robots, obstacle points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import PARKED_AFTER, Sensed
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import Blockage, World
from simulator_interface.engines import gaps, rays
from simulator_interface.engines.bodies import Fleet
from simulator_interface.staging import Stage, first_inside, first_poses, pieces_of, without_later

SWEEP = 3  # ticks until the rays point the same way again
MOVED = 0.05  # m; a robot that stays within this of its place is at rest
PUT_DOWN = 0.02  # m clear of everybody, before a blockage is put down
#: s; a robot keeps its speed for so long before a body that is put down makes it brake: rays meet
#: it within three ticks, and the command after that brakes
REACTION = 0.2
WAY_STEP = 0.05  # m between two looks on a robot's way to a stop

_ANGLES = np.arange(12) * (2.0 * np.pi / 12)
DISC = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)  # outline of a body of radius 1

AT_ONCE = 1e-9  # s; a sub-step's time is a product of floats: what begins within this begins now

NO_FURNITURE = np.zeros((0, 3))

IsTaken = Callable[[Array], bool]  #: whether a robot or person is at a polygon ``(V, 2)`` [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class RayOptions:
    """How obstacles are measured."""

    count: int  #: rays per robot, evenly spaced from the heading counter-clockwise
    max_range: float  #: [m]


class Surroundings:
    """Solids and people of a world as they are at one time.

    A blockage is put down at its start, or once nobody is there any more: nobody puts a bed
    on top of a robot, or so close before one that it cannot stop. Until then it is no body;
    rays and gaps do not meet it.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        edges = rays.polygon_edges(world.solid_polygons())
        self.grid = rays.build_edge_grid(edges, world.bounds)
        self.blockages = tuple(event for event in world.events if isinstance(event, Blockage))
        self.pieces = pieces_of(world)
        self.furniture_pose = first_poses(self.pieces)  #: (F, 3) movable furniture
        self.inside = first_inside(world)  #: (H,) as far as the directives go
        self.human_radius = np.array([human.radius for human in world.humans])
        self._begun = False
        self.standing: tuple[int, ...] = ()  #: numbers of the blockages that stand
        self._awaited: tuple[int, ...] = ()  #: of those to be put down once nobody is there
        self._plan_changes()
        self.edges = np.zeros((0, 4))  #: (E, 4) theirs [m]
        self.present: BoolArray = np.zeros(len(world.humans), dtype=np.bool_)  #: (H,)
        self.solids = gaps.Solids(self.grid, self.edges)  #: walls and what stands now
        self._people = gaps.Pedestrians(np.zeros((0, 2)), self.human_radius, self.present)

    def people(self, position: Array) -> gaps.Pedestrians:
        """People at ``position`` ``(H, 2)`` [m]."""
        known = self._people
        if known.position is not position or known.present is not self.present:
            self._people = gaps.Pedestrians(position, self.human_radius, self.present)
        return self._people

    def is_settled(self, until: float) -> bool:
        """Whether nothing is due to change up to ``until`` [s], and nothing waits for anybody."""
        return until + AT_ONCE < self._due

    def update(self, time: float, is_taken: IsTaken) -> bool:
        """Bring everything to ``time`` [s], which never decreases; says whether it changed."""
        now = time + AT_ONCE
        if now < self._due:
            return False
        is_due = self._next < len(self._changes) and self._changes[self._next] <= now
        waits = self._begun and not is_due
        if waits and all(is_taken(self.blockages[k].polygon) for k in self._awaited):
            return False
        self._begun = True
        while self._next < len(self._changes) and self._changes[self._next] <= now:
            self._next += 1
        self._bring_to(now, is_taken)
        self._look_ahead()
        return True

    def arrange(self, stage: Stage, time: float, is_taken: IsTaken) -> None:
        """Take up what people did before the tick that begins at ``time`` [s]."""
        self.inside = stage.inside
        self.furniture_pose = stage.furniture_pose
        if stage.added:
            self.blockages += stage.added
            self._plan_changes()
        self._begun, self._due = False, -np.inf
        self.update(time, is_taken)

    def forget_after(self, time: float) -> None:
        """No blockage that starts after ``time`` [s] will ever stand."""
        self.blockages = tuple(without_later(self.blockages, time))
        self._plan_changes()

    def _plan_changes(self) -> None:
        times = {event.start for event in self.blockages} | {e.end for e in self.blockages}
        times |= {human.appears_at for human in self.world.humans}
        times |= {human.leaves_at for human in self.world.humans}
        self._changes = sorted(times)
        self._next = 0
        self._look_ahead()

    def _look_ahead(self) -> None:
        """Note until when there is nothing to update [s]."""
        is_open = not self._begun or self._awaited
        following = self._changes[self._next : self._next + 1]
        self._due = -np.inf if is_open else min(following, default=np.inf)

    def _bring_to(self, now: float, is_taken: IsTaken) -> None:
        humans = self.world.humans
        self.present = np.array([h.appears_at <= now < h.leaves_at for h in humans], dtype=np.bool_)
        self.present &= self.inside
        due = [k for k, event in enumerate(self.blockages) if event.start <= now < event.end]
        self._awaited = tuple(
            k for k in due if k not in self.standing and is_taken(self.blockages[k].polygon)
        )
        self.standing = tuple(k for k in due if k not in self._awaited)
        outlines = [self.blockages[k].polygon for k in self.standing]
        poses = zip(self.pieces, self.furniture_pose, strict=True)
        outlines += [piece.at(pose) for piece, pose in poses]
        self.edges = rays.polygon_edges(outlines)
        self.solids = gaps.Solids(self.grid, self.edges)


class Observer:
    """Collects one tick's measurements into a :class:`Sensed`."""

    def __init__(self, fleet: Fleet, surroundings: Surroundings, options: RayOptions) -> None:
        n = len(fleet.models)
        self._fleet = fleet
        self._surroundings = surroundings
        self._options = options
        self._noise = surroundings.world.ray_noise
        self._random = stream(surroundings.world.seed, "rays")
        self._rest = _Rest(np.full((n, 2), np.inf), np.zeros(n))
        self._sweep = 0  #: of SWEEP ray directions, the one of this tick
        #: angle [rad] from the heading at which this tick's first ray leaves. The fan of rays turns
        #: by a third of its spacing from tick to tick, as a scanner's does: a door jamb that slips
        #: between 12 fixed rays is seen within three ticks
        self._turned = 0.0
        #: footprints, placed as observed last
        self.prints = gaps.Footprints(
            fleet.outline,
            fleet.corners,
            fleet.reach,
            np.zeros_like(fleet.outline),
            near_robot=np.full(n, -1, dtype=np.int64),
            near_edge=np.full(n, -1, dtype=np.int64),
        )
        self.gap = np.full((n, 3), np.inf)  #: (N, 3) least gap to robot, human, static [m]
        self.nearest = np.full((n, 2), -1, dtype=np.int64)  #: (N, 2) robot, human
        self.contact = np.zeros((n, 3), dtype=np.bool_)  #: (N, 3) touched robot, human, static

    @property
    def placed(self) -> Array:
        """Footprints ``(N, V, 2)``, map frame [m], as observed last."""
        return self.prints.placed

    def begin_tick(self) -> None:
        """Forget the last tick's gaps and contacts."""
        gaps.forget(self.gap, self.nearest, self.contact)

    def observe(self, pose: Array, human_position: Array) -> float:
        """Take in the end of a sub-step: ``pose`` ``(N, 3)``, ``human_position`` ``(H, 2)``.

        Returns:
            Least gap of any robot so far in this tick [m].
        """
        around = self._surroundings
        least: float = gaps.fill_gaps(
            pose, self.prints, around.solids, around.people(human_position), self.gap, self.nearest
        )
        return least

    def is_taken(self, polygon: Array, pose: Array, velocity: Array, human_position: Array) -> bool:
        """Whether a body put down at ``polygon`` would be within 2 cm of a person or robot.

        For a robot that drives, the way to a stop counts as well, straight on from where it is.

        Args:
            polygon: ``(V, 2)`` [m].
            pose: ``(N, 3)`` of the robots.
            velocity: ``(N, 3)`` of theirs: forward, left [m/s], turn [rad/s].
            human_position: ``(H, 2)`` [m]; only people who are present count.
        """
        fleet, around = self._fleet, self._surroundings
        edges = rays.polygon_edges([polygon])
        placed = np.empty_like(fleet.outline[0]) if len(pose) else np.empty((0, 2))
        ways = _ways_to_a_stop(pose, velocity, fleet.max_acceleration)
        for i, corners in enumerate(fleet.corners):
            looks = 1 + int(np.ceil(np.hypot(*ways[i]) / WAY_STEP))
            for x, y in np.linspace(pose[i, :2], pose[i, :2] + ways[i], looks):
                there = np.array([x, y, pose[i, 2]])
                gaps.place_outline(fleet.outline[i], corners, there, placed)
                if gaps.blocks_gap(edges, placed, corners, x, y) < PUT_DOWN:
                    return True
        for h in np.flatnonzero(around.present):
            x, y = human_position[h]
            body = around.human_radius[h] * DISC + human_position[h]
            if gaps.blocks_gap(edges, body, len(body), x, y) < PUT_DOWN:
                return True
        return False

    def parked(self, pose: Array, time: float) -> BoolArray:
        """Which robots ``(N,)`` have been at rest for over 5 s.

        Call this or :meth:`exact_distances`, once per tick.
        """
        return _parked(pose, time, self._rest)

    def exact_distances(self, pose: Array, time: float) -> Array:
        """Distances ``(N, A)`` [m] to what the rays hit, inf: nothing; robots at rest count."""
        options, around = self._options, self._surroundings
        distances = np.empty((len(pose), options.count))
        fan = options.max_range, self._turned
        _fill_distances(distances, fan, pose, time, self._rest, around.solids, self.prints)
        return distances

    def aimed(self, pose: Array) -> Array:
        """``pose`` ``(N, 3)`` with the yaw that this tick's first ray leaves at."""
        turned = pose.copy()
        turned[:, 2] += self._turned
        return turned

    def sensed(
        self,
        *,
        tick: int,
        time: float,
        pose: Array,
        velocity: Array,
        human_position: Array,
        human_velocity: Array,
        distances: Array,
    ) -> Sensed:
        """Close the tick; arguments as the fields of :class:`Sensed`, distances ``(N, A)`` [m]."""
        if self._noise > 0.0:
            noise = self._random.normal(size=distances.shape) * self._noise
            distances = np.maximum(distances + noise, 0.0)
        points = np.empty((*distances.shape, 2))
        gap_robot, gap_human, gap_static = reported = np.empty((3, len(pose)))
        _fill_reported(self.gap, pose, distances, self._turned, reported, points)
        nearest_robot, nearest_human = self.nearest.T.copy()
        self._sweep = (self._sweep + 1) % SWEEP
        self._turned = self._sweep * (2.0 * np.pi / (SWEEP * self._options.count))
        return Sensed(
            tick=tick,
            time=time,
            pose=pose,
            velocity=velocity,
            human_position=human_position,
            human_velocity=human_velocity,
            obstacle_points=points,
            gap_robot=gap_robot,
            gap_human=gap_human,
            gap_static=gap_static,
            nearest_robot=nearest_robot,
            nearest_human=nearest_human,
            contact=self.contact.copy(),
            furniture_pose=NO_FURNITURE,
        )


class _Rest(NamedTuple):
    """Where each robot came to rest."""

    anchor: Array  #: (N, 2) places [m]
    since: Array  #: (N,) [s]


@njit(cache=True)
def _parked(pose: Array, time: float, rest: _Rest) -> BoolArray:
    """Bring ``rest`` up to date, and say who ``(N,)`` counts as an obstacle by now."""
    fill_rest(pose, time, rest.anchor, rest.since)
    return time - rest.since > PARKED_AFTER


@njit(cache=True)
def _fill_distances(
    distances: Array,
    fan: tuple[float, float],
    pose: Array,
    time: float,
    rest: _Rest,
    solids: gaps.Solids,
    prints: gaps.Footprints,
) -> None:
    """Write what the rays of ``fan``, their range [m] and turn [rad], hit to ``distances``."""
    edges, owner = solids.extra, np.full(len(solids.extra), -1)
    parked = _parked(pose, time, rest)
    if parked.any():
        edges, owner = rays.with_bodies(edges, owner, prints.placed, prints.corners, parked)
    max_range, turned = fan
    count = distances.shape[1]
    distances[:] = rays.cast_rays(solids.grid, edges, owner, pose, count, max_range, turned)


@njit(cache=True)
def _fill_reported(
    gap: Array, pose: Array, distances: Array, turned: float, reported: Array, points: Array
) -> None:
    """Write least gaps ``(3, N)`` of ``fill_gaps``, inf: far; and the points that rays hit."""
    reported[:] = np.inf
    for i in range(gap.shape[0]):
        for k in range(gap.shape[1]):
            if gap[i, k] < gaps.FAR:
                reported[k, i] = gap[i, k]
    points[:] = rays.hit_points(pose, distances, turned)


@njit(cache=True)
def fill_rest(pose: Array, time: float, anchor: Array, since: Array) -> None:
    """Write since when each robot is at rest: the last ``time`` it was away from its place.

    Args:
        pose: ``(N, 3)`` of the moment.
        time: of the moment [s].
        anchor: ``(N, 2)`` places [m]; moved along.
        since: ``(N,)`` [s]; updated.
    """
    for i in range(len(pose)):
        dx, dy = pose[i, 0] - anchor[i, 0], pose[i, 1] - anchor[i, 1]
        if not dx * dx + dy * dy <= MOVED * MOVED:
            anchor[i, 0], anchor[i, 1] = pose[i, 0], pose[i, 1]
            since[i] = time


def _ways_to_a_stop(pose: Array, velocity: Array, max_acceleration: Array) -> Array:
    """How far robots still drive ``(N, 2)`` [m], map frame, if something is put before them now."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    forward, left = velocity[:, 0], velocity[:, 1]
    course = np.stack([c * forward - s * left, s * forward + c * left], axis=1)
    lasts = REACTION + 0.5 * np.hypot(forward, left) / max_acceleration
    return np.asarray(course * lasts[:, None])
