"""Pushing furniture: where each movable piece is, and how a person steers one.

The piece and the person at its end are one rigid body on swivel castors: its centre follows a
planned way, the end that goes first is turned onto that way. A step that would bring it nearer
than a hand's breadth to a robot, a person or a wall is not taken; others are tried instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.geometry import wrap_angle
from mrta_falsify.core.world import World
from simulator_interface.engines import rays
from simulator_interface.engines.gaps import disc_clear, polygon_gap, polygon_point_gap, static_gap
from simulator_interface.people.walking import Walker, Walking, ahead_on
from simulator_interface.staging import Piece, first_poses, pieces_of

GRIP = 0.05  # m between the pushing person and the piece
AT_HAND = 0.4  # m from the handle, from where the person steps straight to it
TOP_SPEED = 0.8  # m/s, of a person behind a bed; a free choice, slower than walking
TURN_RATE = 0.5  # rad/s
AIM = math.radians(60.0)  # off by more than this, the piece turns before it rolls
STRIDE = 0.3  # m; the centre makes for the point of its way this far ahead
CREEP = 0.4  # of its speed, when it must find its way past something
BEHIND = math.radians(110.0)  # what lies farther round than this is reached the other way
ARRIVED = 0.1  # m from the goal
ROBOT_MARGIN = 0.15  # m kept from robots' discs; a robot drives 0.075 m per tick
PERSON_MARGIN = 0.05  # m
WALL_MARGIN = 0.01  # m
SHOVED = 0.05  # m; a person pushed off the handle by more goes back before going on
PATIENCE = 20.0  # s without progress before a person leaves the piece where it is
RESTED = 5.0  # s at rest, after which a piece is on the map again, as a parked robot is
MOVED = 0.05  # m or rad; less is rest
WAY_MARGIN = 0.05  # m added to half the width of a piece when its way is planned
PEOPLES_RADIUS = 0.3  # m; the way of last resort


class Furnishings:
    """Where the movable furniture of a world is, and what of it rests."""

    def __init__(self, world: World) -> None:
        self.pieces = pieces_of(world)
        self.pose = first_poses(self.pieces)  #: (F, 3)
        self._anchor = self.pose.copy()
        self._since = np.full(len(self.pieces), -np.inf)

    def number(self, name: str) -> int:
        """Number of a piece by the name of its furniture."""
        return [piece.item.name for piece in self.pieces].index(name)

    def move(self, number: int, pose: Array, time: float) -> None:
        """Put a piece somewhere at ``time`` [s]."""
        self.pose = self.pose.copy()
        self.pose[number] = pose
        if np.abs(pose - self._anchor[number]).max() > MOVED:
            self._anchor[number], self._since[number] = pose, time

    def outline(self, number: int) -> Array:
        """Outline ``(V, 2)`` [m] of a piece."""
        return self.pieces[number].at(self.pose[number])

    def at_rest(self, time: float) -> tuple[int, ...]:
        """Numbers of the pieces that have been at rest for over 5 s."""
        return tuple(np.flatnonzero(time - self._since > RESTED).tolist())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bystanders:
    """Everything a piece must not run into at one tick."""

    robot: Array  #: (N, 2) [m]
    robot_radius: Array  #: (N,) [m]
    person: Array  #: (H, 2) [m]
    person_radius: Array  #: (H,) [m]
    present: BoolArray  #: (H,)
    blocks: Array  #: (E, 4) edges of blockages that stand [m]


@dataclass(slots=True)
class Pushing:
    """One person's work on one piece."""

    number: int  #: of the piece
    goal: Array  #: (2,) for its centre [m]
    speed: float  #: [m/s]
    backwards: bool = False  #: the person stands at the end that the axis points to
    grips: bool = False
    pulls: bool = False  #: the person goes first
    way: Array = field(default_factory=lambda: np.zeros((0, 2)))  #: of the centre
    passed: int = 0
    walker: Walker | None = None  #: to the handle
    closest: float = np.inf  #: least distance to the goal so far [m]
    closest_at: float = 0.0  #: when that was [s]


@dataclass(frozen=True, slots=True, eq=False)
class PushStep:
    """What a pushing person does in the next tick."""

    finished: bool = False
    target: Array | None = None  #: (2,) walks there by itself [m]
    velocity: Array | None = None  #: (2,) is moved like this [m/s]


class Pushers:
    """All pushing in a world."""

    def __init__(self, world: World, furnishings: Furnishings, walking: Walking, dt: float) -> None:
        self._world = world
        self._things = furnishings
        self._walking = walking
        self._dt = dt
        if furnishings.pieces:
            edges = rays.polygon_edges(world.solid_polygons())
            self._grid = rays.build_edge_grid(edges, world.bounds)

    def step(
        self, push: Pushing, person: int, position: Array, time: float, around: Bystanders
    ) -> PushStep:
        """The next tick of a push that a person at ``position`` ``(2,)`` [m] is at."""
        radius = float(around.person_radius[person])
        if not push.grips:
            return self._approach(push, radius, position, time)
        handle = self._handle(push, self._things.pose[push.number], radius)
        offset = handle - position
        distance = float(np.hypot(*offset))
        if distance > SHOVED:
            if time - push.closest_at > PATIENCE:
                return PushStep(finished=True)
            return PushStep(velocity=offset * (min(push.speed, distance / self._dt) / distance))
        return self._roll(push, person, position, time, around)

    # --- to the handle -------------------------------------------------------------------

    def _direction(self, push: Pushing, pose: Array) -> float:
        turn = math.pi if push.backwards else 0.0
        return float(self._things.pieces[push.number].axis + pose[2] + turn)

    def _handle(self, push: Pushing, pose: Array, radius: float) -> Array:
        """Where the person stands, ``(2,)`` [m]."""
        angle = self._direction(push, pose)
        reach = self._things.pieces[push.number].half_length + radius + GRIP
        place: Array = pose[:2] - reach * np.array([math.cos(angle), math.sin(angle)])
        return place

    def _approach(self, push: Pushing, radius: float, position: Array, time: float) -> PushStep:
        if push.walker is None:
            push.walker = self._nearer_end(push, radius, position)
            push.closest_at = time
        if push.walker is None or time - push.closest_at > 5.0 * PATIENCE:
            return PushStep(finished=True)
        handle = self._handle(push, self._things.pose[push.number], radius)
        offset = handle - position
        distance = float(np.hypot(*offset))
        if distance > AT_HAND:
            target = self._walking.target(push.walker, position, time)
            if len(push.walker.way):
                return PushStep(target=target)
            return PushStep(finished=True)  # the handle cannot be reached
        if distance > 1e-6:
            return PushStep(velocity=offset * (min(push.speed, distance / self._dt) / distance))
        push.grips, push.closest, push.closest_at = True, np.inf, time
        push.way, push.passed = self._plan(push, time), 0
        return PushStep(finished=not len(push.way), velocity=np.zeros(2))

    def _nearer_end(self, push: Pushing, radius: float, position: Array) -> Walker | None:
        best: tuple[float, bool, Walker] | None = None
        for backwards in (False, True):
            push.backwards = backwards
            handle = self._handle(push, self._things.pose[push.number], radius)
            place = self._walking.free_point(handle)
            if np.hypot(*(place - handle)) > AT_HAND:
                continue
            walker = self._walking.set_out(
                place[None], repeat=False, speed=push.speed, start=position
            )
            length = float(np.hypot(*np.diff(walker.way, axis=0).T).sum())
            if len(walker.way) and (best is None or length < best[0]):
                best = (length, backwards, walker)
        if best is None:
            return None
        push.backwards = best[1]
        return best[2]

    # --- to the goal ---------------------------------------------------------------------

    def _plan(self, push: Pushing, time: float) -> Array:
        """Way ``(L, 2)`` [m] of the centre, as wide as the piece if there is such a way."""
        piece, start = self._things.pieces[push.number], self._things.pose[push.number, :2]
        others = tuple(
            self._things.outline(k) for k in self._things.at_rest(time) if k != push.number
        )
        for radius in (piece.half_width + WAY_MARGIN, PEOPLES_RADIUS):
            layer = registry.build("costmap", Choice("layered", {"robot_radius": radius}))
            source = layer.bind(self._world)
            source.furnish(others)
            wide = Walking(registry.build("planner", StackConfig().planner), source)
            wide.look(time)
            way = wide.way(wide.free_point(start), wide.free_point(push.goal))
            if len(way):
                return np.vstack([start, way])
        return np.zeros((0, 2))

    def _roll(
        self, push: Pushing, person: int, position: Array, time: float, around: Bystanders
    ) -> PushStep:
        pose = self._things.pose[push.number]
        left = float(np.hypot(*(push.way[-1] - pose[:2])))
        if left < push.closest - MOVED:
            push.closest, push.closest_at = left, time
        if left < ARRIVED or time - push.closest_at > PATIENCE:
            return PushStep(finished=True)
        push.passed, _ = ahead_on(push.way, push.passed, pose[:2])
        radius = float(around.person_radius[person])
        for velocity, rate in self._options(push, pose, left, radius):
            there = pose + self._dt * np.array([*velocity, rate])
            there[2] = float(wrap_angle(there[2]))
            handle = self._handle(push, there, radius)
            if self._is_clear(push, person, pose, there, position, handle, around):
                self._things.move(push.number, there, time)
                return PushStep(velocity=(handle - position) / self._dt)
        return PushStep(velocity=np.zeros(2))

    def _options(
        self, push: Pushing, pose: Array, left: float, radius: float
    ) -> Iterator[tuple[Array, float]]:
        """Velocities ``(2,)`` [m/s] and turn rates [rad/s] to try, the best first.

        The centre follows the way, and the end that goes first is turned onto it; where that
        is blocked, only one of both, and then past the obstacle to either side.
        """
        piece = self._things.pieces[push.number]
        reach = piece.half_length + (2.0 * radius if push.pulls else 0.0)
        near = _beyond(push.way, push.passed, pose[:2], STRIDE) - pose[:2]
        far = _beyond(push.way, push.passed, pose[:2], reach) - pose[:2]
        bearing = math.atan2(far[1], far[0]) - self._direction(push, pose)
        error = float(wrap_angle(bearing + (math.pi if push.pulls else 0.0)))
        if abs(error) > BEHIND:
            push.pulls = not push.pulls
            error = float(wrap_angle(error + math.pi))
        if np.hypot(*far) < STRIDE:
            error = 0.0
        rate = min(max(error / self._dt, -TURN_RATE), TURN_RATE)
        course = math.atan2(near[1], near[0])
        speed = min(push.speed, left / self._dt)
        share = math.cos(error) if abs(error) < AIM else 0.0
        stands = np.zeros(2)
        ahead = speed * np.array([math.cos(course), math.sin(course)])
        yield share * ahead, rate
        yield stands, rate
        yield CREEP * ahead, 0.0
        for aside in (0.25, -0.25, 0.5, -0.5):
            angle = course + aside * math.pi
            slide = CREEP * speed * np.array([math.cos(angle), math.sin(angle)])
            yield slide, rate
            yield slide, 0.0

    def _is_clear(
        self,
        push: Pushing,
        person: int,
        pose: Array,
        there: Array,
        position: Array,
        handle: Array,
        around: Bystanders,
    ) -> bool:
        """Whether a step keeps its distances, or does not lower those that are too small."""
        piece = self._things.pieces[push.number]
        before, after = piece.at(pose), piece.at(there)
        margins = [
            *((p, r, ROBOT_MARGIN) for p, r in zip(around.robot, around.robot_radius, strict=True)),
            *(
                (around.person[h], around.person_radius[h], PERSON_MARGIN)
                for h in np.flatnonzero(around.present)
                if h != person
            ),
        ]
        near = piece.half_length + piece.half_width + 2.0
        own = float(around.person_radius[person])
        for place, radius, margin in margins:
            if math.hypot(place[0] - there[0], place[1] - there[1]) > near + radius:
                continue
            gap = polygon_point_gap(after, len(after), place[0], place[1]) - radius
            if gap < margin and gap < polygon_point_gap(before, len(before), *place) - radius:
                return False
            gap = math.hypot(*(handle - place)) - own - radius
            if gap < margin and gap < math.hypot(*(position - place)) - own - radius:
                return False
        if not self._is_clear_of_solids(piece, pose, there, around.blocks):
            return False
        room = disc_clear(self._grid, around.blocks, handle[0], handle[1], own)
        if room < own and room < disc_clear(
            self._grid, around.blocks, position[0], position[1], own
        ):
            return False
        return all(
            polygon_gap(after, len(after), other, len(other), 1.0) >= WALL_MARGIN
            or polygon_gap(after, len(after), other, len(other), 1.0)
            >= polygon_gap(before, len(before), other, len(other), 1.0)
            for k in range(len(self._things.pieces))
            if k != push.number
            for other in (self._things.outline(k),)
        )

    def _is_clear_of_solids(self, piece: Piece, pose: Array, there: Array, blocks: Array) -> bool:
        reach = float(np.hypot(*piece.outline.T).max())
        gaps = []
        for where in (there, pose):
            body = piece.at(where)
            gap = static_gap(
                self._grid, blocks, body, len(body), where[0], where[1], reach, WALL_MARGIN
            )
            if gap >= WALL_MARGIN:
                return True
            gaps.append(gap)
        return bool(gaps[0] >= gaps[1])


def _beyond(way: Array, passed: int, place: Array, distance: float) -> Array:
    """The first point ``(2,)`` of a way after ``passed`` that is ``distance`` [m] from a place."""
    apart = np.hypot(*(way[passed:] - place).T)
    far = np.flatnonzero(apart >= distance)
    point: Array = way[passed + int(far[0])] if len(far) else way[-1]
    return point
