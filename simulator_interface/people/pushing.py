"""Pushing furniture: how a person steers a piece to its goal.

The piece and the person at its end are one rigid body on swivel castors: its centre follows a
planned way, the end that goes first is turned onto that way. A move that would not keep its
distances (:mod:`.margins`) is not made; others are tried instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.geometry import wrap_angle
from mrta_falsify.core.world import World
from simulator_interface.people.furnishings import MOVED, Furnishings
from simulator_interface.people.margins import Bystanders, Margins, PushMove
from simulator_interface.people.walking import (
    NO_WAY,
    PEOPLES_RADIUS,
    Walker,
    Walking,
    look_ahead,
    way_length,
)

GRIP = 0.05  # m between the pushing person and the piece
AT_HAND = 0.4  # m from the handle, from where the person steps straight to it
AT_HANDLE = 1e-6  # m; nearer than this the person grips
TOP_SPEED = 0.8  # m/s, of a person behind a bed; a free choice, slower than walking
TURN_RATE = 0.5  # rad/s
AIM = math.radians(60.0)  # off by more than this, the piece turns before it rolls
STRIDE = 0.3  # m; the centre makes for the point of its way this far ahead
CREEP = 0.4  # of its speed, when it must find its way past something
SIDESTEPS = (0.25, -0.25, 0.5, -0.5)  # of half a turn from the course, tried in this order
BEHIND = math.radians(110.0)  # what lies farther round than this is reached by pulling
ARRIVED = 0.1  # m from the goal
NEARLY = 0.3  # m from the goal, where a kept piece that cannot come nearer may stay
SHOVED = 0.05  # m; a person pushed off the handle by more goes back before going on
LEAVE_AFTER = 20.0  # s without progress before a person leaves the piece where it is
APPROACH_LIMIT = 100.0  # s on the way to the handle before a person gives up
WAY_MARGIN = 0.05  # m added to half the width of a piece when its way is planned


@dataclass(slots=True)
class Pushing:
    """One person's work on one piece."""

    number: int  #: of the piece
    goal: Array  #: (2,) for its centre [m]
    speed: float  #: [m/s]
    keeps: bool  #: the piece is not left on the way
    backwards: bool = False  #: the person stands at the end that the axis points to
    grips: bool = False  #: the person is at the handle, and the piece rolls
    pulls: bool = False  #: the person goes first
    way: Array = field(default_factory=lambda: NO_WAY)  #: (L, 2) of the centre [m]
    passed: int = 0  #: points of the way already passed
    walker: Walker | None = None  #: to the handle
    closest: float = np.inf  #: least distance to the goal so far, of a kept piece along its way [m]
    closest_at: float = 0.0  #: when that was [s]
    track: list[Array] = field(default_factory=list)  #: poses (3,) since the piece was gripped
    returns: bool = False  #: the piece is brought back along its track


@dataclass(frozen=True, slots=True, eq=False)
class PushStep:
    """What a pushing person does in the next tick."""

    finished: bool = False
    target: Array | None = None  #: (2,) walks there by itself [m]
    velocity: Array | None = None  #: (2,) is moved like this [m/s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pusher:
    """A pushing person at one tick, and what is around."""

    person: int
    place: Array  #: (2,) [m]
    time: float  #: [s]
    around: Bystanders

    @property
    def radius(self) -> float:
        """Radius of the person [m]."""
        return float(self.around.person_radius[self.person])


class Pushers:
    """All pushing in a world."""

    def __init__(self, world: World, furnishings: Furnishings, walking: Walking, dt: float) -> None:
        self._world = world
        self._things = furnishings
        self._walking = walking
        self._dt = dt
        self._margins = Margins(world, furnishings)

    def step(self, push: Pushing, pusher: Pusher) -> PushStep:
        """Take the next step of a push; the piece is moved along."""
        if not push.grips:
            return self._approach(push, pusher)
        handle = self._handle(push, self._things.pose[push.number], pusher.radius)
        if float(np.hypot(*(handle - pusher.place))) > SHOVED:
            if pusher.time - push.closest_at > LEAVE_AFTER and not push.keeps:
                return PushStep(finished=True)
            return PushStep(velocity=self._towards(handle, pusher.place, push.speed))
        return self._roll(push, pusher)

    def _towards(self, goal: Array, place: Array, speed: float) -> Array:
        """Velocity ``(2,)`` [m/s] straight to a goal, not beyond it in one tick."""
        offset = goal - place
        distance = float(np.hypot(*offset))
        velocity: Array = offset * (min(speed, distance / self._dt) / distance)
        return velocity

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

    def _approach(self, push: Pushing, pusher: Pusher) -> PushStep:
        if push.walker is None:
            push.walker = self._nearer_end(push, pusher)
            push.closest_at = pusher.time
        if push.walker is None or pusher.time - push.closest_at > APPROACH_LIMIT:
            return PushStep(finished=True)
        handle = self._handle(push, self._things.pose[push.number], pusher.radius)
        distance = float(np.hypot(*(handle - pusher.place)))
        if distance > AT_HAND:
            target = self._walking.target(push.walker, pusher.place, pusher.time)
            if len(push.walker.way):
                return PushStep(target=target)
            return PushStep(finished=True)  # the handle cannot be reached
        if distance > AT_HANDLE:
            return PushStep(velocity=self._towards(handle, pusher.place, push.speed))
        push.grips, push.closest, push.closest_at = True, np.inf, pusher.time
        push.way, push.passed = self._plan(push, pusher.time), 0
        return PushStep(finished=not len(push.way), velocity=np.zeros(2))

    def _nearer_end(self, push: Pushing, pusher: Pusher) -> Walker | None:
        """Choose the end with the shorter way to it; None: neither can be reached."""
        best: tuple[float, bool, Walker] | None = None
        for backwards in (False, True):
            push.backwards = backwards
            handle = self._handle(push, self._things.pose[push.number], pusher.radius)
            place = self._walking.free_point(handle)
            if np.hypot(*(place - handle)) > AT_HAND:
                continue
            walker = self._walking.set_out(
                place[None], repeat=False, speed=push.speed, start=pusher.place
            )
            length = way_length(walker.way)
            if len(walker.way) and (best is None or length < best[0]):
                best = (length, backwards, walker)
        if best is None:
            return None
        push.backwards = best[1]
        return best[2]

    # --- to the goal ---------------------------------------------------------------------

    def _plan(self, push: Pushing, time: float) -> Array:
        """Way ``(L, 2)`` [m] of the centre, as wide as the piece if there is such a way.

        Who keeps the piece takes no narrower one.
        """
        piece, start = self._things.pieces[push.number], self._things.pose[push.number, :2]
        others = tuple(
            self._things.outline(k) for k in self._things.at_rest(time) if k != push.number
        )
        wide_enough = piece.half_width + WAY_MARGIN
        for radius in (wide_enough,) if push.keeps else (wide_enough, PEOPLES_RADIUS):
            layer = registry.build("costmap", Choice("layered", {"robot_radius": radius}))
            source = layer.bind(self._world)
            source.furnish(others)
            wide = Walking(registry.build("planner", StackConfig().planner), source)
            wide.look(time)
            way = wide.way(wide.free_point(start), wide.free_point(push.goal))
            if len(way):
                return np.vstack([start, way])
        return NO_WAY

    def _roll(self, push: Pushing, pusher: Pusher) -> PushStep:
        pose = self._things.pose[push.number]
        if push.returns:
            return self._return(push, pusher)
        left = float(np.hypot(*(push.way[-1] - pose[:2])))
        ahead = _way_ahead(push, pose[:2]) if push.keeps else left
        if ahead < push.closest - MOVED:
            push.closest, push.closest_at = ahead, pusher.time
        if left < ARRIVED:
            return PushStep(finished=True)
        if pusher.time - push.closest_at > LEAVE_AFTER:
            if not push.keeps or left < NEARLY:
                return PushStep(finished=True)
            push.returns = True
            return self._return(push, pusher)
        push.passed = look_ahead(push.way, push.passed, pose[:2]).passed
        for velocity, rate in self._options(push, pose, left, pusher.radius):
            new_pose = pose + self._dt * np.array([*velocity, rate])
            new_pose[2] = float(wrap_angle(new_pose[2]))
            handle = self._handle(push, new_pose, pusher.radius)
            move = PushMove(
                piece=push.number,
                person=pusher.person,
                pose=pose,
                new_pose=new_pose,
                place=pusher.place,
                new_place=handle,
            )
            if self._margins.are_kept(move, pusher.around):
                if push.keeps and (new_pose != pose).any():
                    push.track.append(pose)
                self._things.move(push.number, new_pose, pusher.time)
                return PushStep(velocity=(handle - pusher.place) / self._dt)
        return PushStep(velocity=np.zeros(2))

    def _return(self, push: Pushing, pusher: Pusher) -> PushStep:
        """Take the last step back; the push ends where the piece was gripped."""
        if not push.track:
            return PushStep(finished=True)
        pose = self._things.pose[push.number]
        handle = self._handle(push, push.track[-1], pusher.radius)
        move = PushMove(
            piece=push.number,
            person=pusher.person,
            pose=pose,
            new_pose=push.track[-1],
            place=pusher.place,
            new_place=handle,
        )
        if not self._margins.are_kept_going_back(move, pusher.around):
            return PushStep(velocity=np.zeros(2))
        self._things.move(push.number, push.track.pop(), pusher.time)
        return PushStep(velocity=(handle - pusher.place) / self._dt)

    def _options(
        self, push: Pushing, pose: Array, left: float, radius: float
    ) -> Iterator[tuple[Array, float]]:
        """Yield velocities ``(2,)`` [m/s] and turn rates [rad/s] to try, the best first.

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
        for aside in SIDESTEPS:
            angle = course + aside * math.pi
            slide = CREEP * speed * np.array([math.cos(angle), math.sin(angle)])
            yield slide, rate
            yield slide, 0.0


def _way_ahead(push: Pushing, place: Array) -> float:
    """Length of the way that is left [m]."""
    return way_length(np.vstack([place, push.way[push.passed :]]))


def _beyond(way: Array, passed: int, place: Array, distance: float) -> Array:
    """The first point ``(2,)`` of a way after ``passed`` that is ``distance`` [m] from a place."""
    apart = np.hypot(*(way[passed:] - place).T)
    far = np.flatnonzero(apart >= distance)
    point: Array = way[passed + int(far[0])] if len(far) else way[-1]
    return point
