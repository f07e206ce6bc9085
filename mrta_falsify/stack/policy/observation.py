"""What a policy sees of its robot's surroundings, and what its actions mean.

Training and trial both build observations here, so they are equal bit for bit. An observation is a
function of one tick: nothing is remembered.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.core.world import CRUISE

Observations = NDArray[np.float32]

SIGHT = 5.0  # m; what is farther away is not seen. A robot stops from its 1.5 m/s within 1.2 m
SECTORS = 12  # directions of obstacles, 30 degrees each: the engines' default number of rays
ROBOTS = 4  # nearest robots that are seen: as many as can stand around one
PEOPLE = 3  # nearest people that are seen
ACTIONS = 2  # forward and turn, each in [-1, 1]


class Block(NamedTuple):
    """A part of an observation."""

    name: str
    size: int
    low: float  #: least value that it can have
    high: float  #: largest value


#: an observation ``(SIZE,)`` in order; places and velocities are forward and left of the robot
BLOCKS = (
    Block("pose", 4, -np.inf, np.inf),  # x [m], y [m] in the map frame, cos(yaw), sin(yaw)
    Block("velocity", 3, -np.inf, np.inf),  # forward, left [m/s], turn rate [rad/s]
    Block("limits", 4, 0.0, np.inf),  # speed, acceleration, turn rate, cruising speed now
    Block("target", 2, -SIGHT, SIGHT),  # point of the path ahead [m], 0: none
    Block("goal", 2, -SIGHT, SIGHT),  # end of the path [m], 0: none
    Block("flags", 3, 0.0, 1.0),  # has a target, works on a task, has joined
    Block(
        "obstacles", SECTORS, 0.0, SIGHT
    ),  # distance [m] by sector from straight ahead, leftwards
    Block("robots", 5 * ROBOTS, -np.inf, np.inf),  # each: place [m], velocity [m/s], 1: is there
    Block("people", 6 * PEOPLE, -np.inf, np.inf),  # each: place, velocity, radius [m], 1: is there
)
SIZE = sum(block.size for block in BLOCKS)


def _slices() -> dict[str, slice]:
    ends = list(itertools.accumulate(block.size for block in BLOCKS))
    return {
        block.name: slice(end - block.size, end) for block, end in zip(BLOCKS, ends, strict=True)
    }


#: where each block stands in an observation
PARTS = _slices()


def bounds() -> tuple[Observations, Observations]:
    """Give the least and largest observation ``(SIZE,)``."""
    sizes = [block.size for block in BLOCKS]
    low = np.repeat([block.low for block in BLOCKS], sizes)
    high = np.repeat([block.high for block in BLOCKS], sizes)
    return low.astype(np.float32), high.astype(np.float32)


def observe(view: ControlView) -> Observations:
    """Build what the N robots see.

    Args:
        view: of one tick.

    Returns:
        ``(N, SIZE)``, its columns as :data:`PARTS` says.
    """
    robots = len(view.pose)
    frame = _Frames(view.pose)
    cruise = np.full(robots, CRUISE) if view.cruise is None else view.cruise
    heading = view.pose[:, 2]
    has_target = np.isfinite(view.target).all(axis=1)
    parts = {
        "pose": np.column_stack((view.pose[:, :2], np.cos(heading), np.sin(heading))),
        "velocity": view.velocity,
        "limits": np.column_stack(
            (view.max_speed, view.max_acceleration, view.max_turn_rate, cruise)
        ),
        "target": frame.place(view.target),
        "goal": frame.place(view.goal),
        "flags": np.column_stack((has_target, view.active, view.present)),
        "obstacles": _obstacles(view, frame),
        "robots": _robots(view, frame),
        "people": _people(view, frame),
    }
    low, high = bounds()
    seen = np.concatenate([parts[block.name] for block in BLOCKS], axis=1, dtype=np.float32)
    return np.clip(seen, low, high)


def twists_of(actions: Array, view: ControlView) -> Array:
    """Turn actions ``(N, 2)`` into twists ``(N, 3)``; who has not joined gets none.

    Args:
        actions: shares of the largest speed and turn rate; they are clipped to [-1, 1].
        view: of the tick.
    """
    shares = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
    twist = np.zeros((len(view.pose), 3))
    twist[:, 0] = shares[:, 0] * view.max_speed
    twist[:, 2] = shares[:, 1] * view.max_turn_rate
    twist[~view.present] = 0.0
    return twist


class _Frames:
    """The N robots' own frames."""

    def __init__(self, pose: Array) -> None:
        self._place = pose[:, :2]
        self._cos, self._sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])

    def turned(self, vectors: Array) -> Array:
        """Turn map vectors ``(N, ..., 2)`` into the robots' frames; not finite ones become 0."""
        shape = (-1,) + (1,) * (vectors.ndim - 2)
        cos, sin = self._cos.reshape(shape), self._sin.reshape(shape)
        known = np.where(np.isfinite(vectors).all(axis=-1, keepdims=True), vectors, 0.0)
        x, y = known[..., 0], known[..., 1]
        return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)

    def offsets(self, points: Array) -> Array:
        """Give map points ``(M, 2)`` as ``(N, M, 2)`` from each robot, in the map frame."""
        offset: Array = points[None, :, :] - self._place[:, None, :]
        return offset

    def place(self, points: Array) -> Array:
        """Give a map point for each robot, ``(N, 2)``, in its frame."""
        return self.turned(points - self._place)


def _obstacles(view: ControlView, frame: _Frames) -> Array:
    offset = view.obstacle_points - view.pose[:, None, :2]
    away = np.hypot(offset[..., 0], offset[..., 1])
    away = np.where(np.isfinite(away), away, SIGHT)
    own = frame.turned(offset)
    width = 2.0 * np.pi / SECTORS
    bearing = np.arctan2(own[..., 1], own[..., 0])
    sector = np.floor(bearing / width + 0.5).astype(np.int64) % SECTORS
    nearest = np.full((len(view.pose), SECTORS), SIGHT)
    rows = np.broadcast_to(np.arange(len(view.pose))[:, None], sector.shape)
    np.minimum.at(nearest, (rows, sector), away)
    return nearest


def _robots(view: ControlView, frame: _Frames) -> Array:
    cos, sin = np.cos(view.pose[:, 2]), np.sin(view.pose[:, 2])
    forward, left = view.velocity[:, 0], view.velocity[:, 1]
    moves = np.column_stack((cos * forward - sin * left, sin * forward + cos * left))
    told = view.present & view.states_link
    seen = told[:, None] & told[None, :] & ~np.eye(len(told), dtype=np.bool_)
    return _nearest(frame, view.pose[:, :2], moves, seen, ROBOTS, np.zeros((len(moves), 0)))


def _people(view: ControlView, frame: _Frames) -> Array:
    place = view.human_position
    there = np.isfinite(place[:, 0]) & np.isfinite(place[:, 1])
    seen = np.broadcast_to(there, (len(view.pose), len(place)))
    radius = view.human_radius[:, None]
    return _nearest(frame, place, view.human_velocity, seen, PEOPLE, radius)


def _nearest(
    frame: _Frames, points: Array, moves: Array, seen: BoolArray, most: int, more: Array
) -> Array:
    """List the nearest bodies of each robot, nearest first, zeros where there is none.

    Args:
        frame: of the N robots.
        points: ``(M, 2)`` [m] of the bodies.
        moves: ``(M, 2)`` [m/s].
        seen: ``(N, M)`` whether a robot may see a body.
        most: how many are listed.
        more: ``(M, C)`` further columns.
    """
    robots, bodies = seen.shape
    columns = 5 + more.shape[1]
    table = np.zeros((robots, max(bodies, most), columns))
    if bodies:
        offset = frame.offsets(points)
        away = np.hypot(offset[..., 0], offset[..., 1])
        is_near = seen & (away <= SIGHT)
        velocity = np.broadcast_to(moves, (robots, bodies, 2))
        extra = np.broadcast_to(more, (robots, bodies, more.shape[1]))
        flag = np.ones((robots, bodies, 1))
        rows = np.concatenate((frame.turned(offset), frame.turned(velocity), extra, flag), axis=2)
        rows = np.where(is_near[..., None], rows, 0.0)
        order = np.argsort(np.where(is_near, away, np.inf), axis=1, kind="stable")
        table[:, :bodies] = np.take_along_axis(rows, order[..., None], axis=1)
    return table[:, :most].reshape(robots, most * columns)
