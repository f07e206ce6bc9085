"""The distances that a pushed piece of furniture and its pusher keep."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.world import World
from simulator_interface.engines import rays
from simulator_interface.engines.gaps import disc_clear, polygon_gap, polygon_point_gap, static_gap
from simulator_interface.people.furnishings import Furnishings

ROBOT_MARGIN = 0.15  # m kept from robots' discs; a robot drives 0.075 m per tick
PERSON_MARGIN = 0.05  # m
WALL_MARGIN = 0.01  # m, from solids and from other pieces
IN_VIEW = 2.0  # m beyond the piece; bodies farther away are left out
PIECE_CUTOFF = 1.0  # m; gaps between pieces are exact below this only


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bystanders:
    """Everything that a piece must not run into at one tick."""

    robot: Array  #: (N, 2) [m]
    robot_radius: Array  #: (N,) [m]
    person: Array  #: (H, 2) [m]
    person_radius: Array  #: (H,) [m]
    present: BoolArray  #: (H,)
    blocks: Array  #: (E, 4) edges of blockages that stand [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PushMove:
    """A move of a piece together with its pusher."""

    piece: int  #: number of the piece
    person: int  #: number of the pusher
    pose: Array  #: (3,) of the piece, before
    new_pose: Array  #: (3,)
    place: Array  #: (2,) of the pusher, before [m]
    new_place: Array  #: (2,) [m]


class Margins:
    """Judges moves of the pieces of a world."""

    def __init__(self, world: World, furnishings: Furnishings) -> None:
        self._things = furnishings
        if furnishings.pieces:
            edges = rays.polygon_edges(world.solid_polygons())
            self._grid = rays.build_edge_grid(edges, world.bounds)

    def are_kept(self, move: PushMove, around: Bystanders) -> bool:
        """Whether a move keeps its distances, or narrows none of those that are too small."""
        return (
            self._keeps_from_bodies(move, around)
            and self._piece_keeps_from_solids(move, around.blocks)
            and self._pusher_keeps_from_solids(move, around)
            and self._keeps_from_pieces(move)
        )

    def are_kept_going_back(self, move: PushMove, around: Bystanders) -> bool:
        """Whether a move back to where the piece was keeps its distances from what may have come.

        The walls are where they were, so a distance from them may narrow as it once widened.
        """
        is_clear = not len(around.blocks) or (
            self._piece_keeps_from_solids(move, around.blocks)
            and self._pusher_keeps_from_solids(move, around)
        )
        return is_clear and self._keeps_from_bodies(move, around) and self._keeps_from_pieces(move)

    def _keeps_from_bodies(self, move: PushMove, around: Bystanders) -> bool:
        piece = self._things.pieces[move.piece]
        before, after = piece.at(move.pose), piece.at(move.new_pose)
        view = piece.half_length + piece.half_width + IN_VIEW
        own = float(around.person_radius[move.person])

        def piece_gap(outline: Array, place: Array, radius: float) -> float:
            return float(polygon_point_gap(outline, len(outline), place[0], place[1]) - radius)

        def pusher_gap(pusher: Array, place: Array, radius: float) -> float:
            return math.hypot(*(pusher - place)) - own - radius

        for place, radius, margin in _bodies(around, move.person):
            if math.hypot(*(place - move.new_pose[:2])) > view + radius:
                continue
            if _is_narrowed(piece_gap, after, before, (place, radius), margin):
                return False
            if _is_narrowed(pusher_gap, move.new_place, move.place, (place, radius), margin):
                return False
        return True

    def _piece_keeps_from_solids(self, move: PushMove, blocks: Array) -> bool:
        piece = self._things.pieces[move.piece]
        reach = float(np.hypot(*piece.outline.T).max())

        def gap(pose: Array) -> float:
            x, y, body = pose[0], pose[1], piece.at(pose)
            found: float = static_gap(self._grid, blocks, body, len(body), x, y, reach, WALL_MARGIN)
            return found

        after = gap(move.new_pose)
        if after >= WALL_MARGIN:
            return True
        before = gap(move.pose)
        # The first move that comes too near is allowed; only the next may not come nearer.
        return before >= WALL_MARGIN or after >= before

    def _pusher_keeps_from_solids(self, move: PushMove, around: Bystanders) -> bool:
        radius = float(around.person_radius[move.person])

        def room(place: Array) -> float:
            found: float = disc_clear(self._grid, around.blocks, place[0], place[1], radius)
            return found

        return not _is_narrowed(room, move.new_place, move.place, (), radius)

    def _keeps_from_pieces(self, move: PushMove) -> bool:
        piece = self._things.pieces[move.piece]
        before, after = piece.at(move.pose), piece.at(move.new_pose)

        def gap(outline: Array, other: Array) -> float:
            found: float = polygon_gap(outline, len(outline), other, len(other), PIECE_CUTOFF)
            return found

        others = (
            self._things.outline(k) for k in range(len(self._things.pieces)) if k != move.piece
        )
        return not any(_is_narrowed(gap, after, before, (o,), WALL_MARGIN) for o in others)


def _bodies(around: Bystanders, pusher: int) -> Iterator[tuple[Array, float, float]]:
    """Yield place ``(2,)``, radius and margin [m] of all robots and people but the pusher."""
    for place, radius in zip(around.robot, around.robot_radius, strict=True):
        yield place, radius, ROBOT_MARGIN
    for h in np.flatnonzero(around.present):
        if h != pusher:
            yield around.person[h], around.person_radius[h], PERSON_MARGIN


def _is_narrowed(
    gap: Callable[..., float], after: Array, before: Array, other: tuple[Any, ...], margin: float
) -> bool:
    """Whether a gap to ``other`` is below its margin and narrower after a move than before."""
    left = gap(after, *other)
    return left < margin and left < gap(before, *other)
