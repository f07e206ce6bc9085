"""What people change in the building while an episode runs.

People come and go, push furniture and put things down. The crowd decides it; the engine and the
costmaps carry it out. Components that cannot are refused before the start.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.directives import begins_outside
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.world import Blockage, CommsOutage, Furniture, World

Event = TypeVar("Event", bound=Blockage | CommsOutage)

FAR_FUTURE = 1e9  # s; what ends then stays, what begins then never comes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """Changes that the engine takes in before a tick; H people, F movable pieces of furniture."""

    inside: BoolArray  #: (H,) in the building as far as their directives go
    placed: Array  #: (H, 2) where people are put down before the tick [m], nan: they stay
    furniture_pose: Array  #: (F, 3) centre x, y [m] and turn since the start [rad]
    added: tuple[Blockage, ...] = ()  #: put down since the last stage


@runtime_checkable
class StagedEngine(Protocol):
    """An engine for worlds in which people come, go and push."""

    def arrange(self, stage: Stage) -> None:
        """Take in ``stage``; called between two steps, and only if something changed."""


@runtime_checkable
class StagedSource(Protocol):
    """A costmap source for such worlds."""

    def furnish(self, outlines: tuple[Array, ...]) -> None:
        """Show movable furniture at rest, outlines ``(V, 2)`` [m], from now on."""

    def add_blockage(self, blockage: Blockage) -> None:
        """Add a blockage that is put down while the episode runs."""


@runtime_checkable
class ForgettingPart(Protocol):
    """An engine or a costmap source that can leave out later events."""

    def forget_after(self, time: float) -> None:
        """Leave out all blockages that start after ``time`` [s]."""


@runtime_checkable
class RemovingEngine(Protocol):
    """An engine that can take a robot out of the building."""

    def remove(self, robot: int) -> None:
        """Put ``robot`` far outside the map, in no other robot's way."""


@runtime_checkable
class ReadableEngine(Protocol):
    """An engine whose whole state stands in its Python objects, for whoever compares it."""

    has_no_hidden_state: bool  #: always true; a physics library's client keeps state of its own


@runtime_checkable
class ShiftingEngine(Protocol):
    """An engine that can move robots a little."""

    def shift(self, offset: Array) -> None:
        """Move robots by ``offset`` ``(N, 2)`` [m], between two steps."""


def needs_stage(world: World) -> bool:
    """Whether a world asks for more than routes: coming, going, pushing."""
    return bool(world.movable_furniture()) or any(h.directives for h in world.humans)


def without_later(events: Iterable[Event], time: float) -> list[Event]:
    """Postpone events that begin after ``time`` [s] beyond any episode; numbers stay the same."""
    return [
        dataclasses.replace(event, start=FAR_FUTURE, end=FAR_FUTURE)
        if event.start > time
        else event
        for event in events
    ]


def first_inside(world: World) -> BoolArray:
    """Say which people ``(H,)`` are inside at time 0, as far as the directives go."""
    return np.array([not begins_outside(h.directives) for h in world.humans], dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A movable piece of furniture around its own centre."""

    item: Furniture
    center: Array  #: (2,) at the start [m]
    outline: Array  #: (V, 2) around the centre, as it stands at the start [m]
    axis: float  #: direction of the longest side at the start [rad]
    half_length: float  #: along the axis [m]
    half_width: float  #: [m]

    def at(self, pose: Array) -> Array:
        """Place the outline ``(V, 2)`` [m] at a pose ``(3,)``: centre, and turn since the start."""
        return transform(self.outline, pose)


def pieces_of(world: World) -> tuple[Piece, ...]:
    """List the movable furniture of a world."""
    pieces = []
    for item in world.movable_furniture():
        polygon, center = np.asarray(item.polygon), item.center
        sides = np.roll(polygon, -1, axis=0) - polygon
        longest = sides[int(np.argmax(np.hypot(*sides.T)))]
        axis = float(np.arctan2(longest[1], longest[0]))
        outline = polygon - center
        along = outline @ np.array([np.cos(axis), np.sin(axis)])
        across = outline @ np.array([-np.sin(axis), np.cos(axis)])
        pieces.append(
            Piece(item, center, outline, axis, float(np.ptp(along)) / 2, float(np.ptp(across)) / 2)
        )
    return tuple(pieces)


def first_poses(pieces: tuple[Piece, ...]) -> Array:
    """List the poses ``(F, 3)`` of movable furniture at the start."""
    return np.array([(*piece.center, 0.0) for piece in pieces]).reshape(-1, 3)
