"""What changes in the building by people's hands while an episode runs.

People come and go, furniture is pushed, things are put down. The crowd decides it, the
engine and the costmaps carry it out; components that cannot are refused before the start.
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

FAR_FUTURE = 1e9  # s; what is put down stays, and whose time is this never comes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """What the engine is told before a tick; H people, F movable pieces of furniture."""

    inside: BoolArray  #: (H,) in the building as far as their directives go
    placed: Array  #: (H, 2) where people are put down before the tick [m], nan: they stay
    furniture_pose: Array  #: (F, 3) centre x, y [m] and turn since the start [rad]
    added: tuple[Blockage, ...] = ()  #: put down since the last stage


@runtime_checkable
class StagedEngine(Protocol):
    """An engine for worlds in which people come, go and push."""

    def arrange(self, stage: Stage) -> None:
        """Take up ``stage``; called between two steps, and only if something changed."""


@runtime_checkable
class StagedSource(Protocol):
    """A costmap source for such worlds."""

    def furnish(self, outlines: tuple[Array, ...]) -> None:
        """Movable furniture at rest, outlines ``(V, 2)`` [m], that is on the map from now on."""

    def add_blockage(self, blockage: Blockage) -> None:
        """Something put down while the episode runs."""


@runtime_checkable
class ForgettingPart(Protocol):
    """An engine or a costmap source that can leave out what is to come."""

    def forget_after(self, time: float) -> None:
        """No blockage that starts after ``time`` [s] will ever stand."""


@runtime_checkable
class RemovingEngine(Protocol):
    """An engine that can take a robot out of the building."""

    def remove(self, robot: int) -> None:
        """From now on ``robot`` is far outside the map and in nobody's way."""


def needs_stage(world: World) -> bool:
    """Whether a world asks for more than routes: coming, going, pushing."""
    return bool(world.movable_furniture()) or any(h.directives for h in world.humans)


def without_later(events: Iterable[Event], time: float) -> list[Event]:
    """``events``, but those that begin after ``time`` [s] never do; numbers stay the same."""
    return [
        dataclasses.replace(event, start=FAR_FUTURE, end=FAR_FUTURE)
        if event.start > time
        else event
        for event in events
    ]


def first_inside(world: World) -> BoolArray:
    """Who ``(H,)`` is inside at time 0, as far as the directives go."""
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
        """Outline ``(V, 2)`` [m] at a pose ``(3,)``: centre, and turn since the start."""
        return transform(self.outline, pose)


def pieces_of(world: World) -> tuple[Piece, ...]:
    """The movable furniture of a world."""
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
    """Poses ``(F, 3)`` of movable furniture at the start."""
    return np.array([(*piece.center, 0.0) for piece in pieces]).reshape(-1, 3)
