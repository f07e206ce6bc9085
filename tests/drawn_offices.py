"""Office floors that tests draw themselves, with the doors that are there.

A floor is a list of boxes that are free and of boxes that are solid again, so that it can be
drawn at any resolution, turned by any angle, and as a mapping run would leave it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

Box = tuple[float, float, float, float]  # x min, y min, x max, y max [m]
OPENINGS = ("opening", "alcove")  # kinds of floor whose middle rooms have no door


@dataclass(frozen=True)
class Place:
    """A room as it was drawn."""

    name: str
    point: tuple[float, float]
    box: Box  #: of its floor
    doors: tuple[Box, ...]  #: the holes in its walls; empty: it has no door


@dataclass
class Office:
    """A floor as it was drawn, in metres."""

    size: tuple[float, float]
    free: list[Box] = field(default_factory=list)
    solid: list[Box] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)

    def is_free(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether points lie on the floor."""
        found = np.zeros(np.shape(x), dtype=bool)
        for boxes, value in ((self.free, True), (self.solid, False)):
            for x1, y1, x2, y2 in boxes:
                found[(x >= x1) & (x < x2) & (y >= y1) & (y < y2)] = value
        return found


def office(kind: str = "plain", *, door: float = 1.0, corridor: float = 1.75, wall: float = 0.15):
    """Three rooms on either side of a corridor, and one at its end.

    Args:
        kind: ``plain`` (doors opposite each other), ``shifted``, ``corners``, ``series`` (a room
            behind another), ``two_doors``, ``furniture``, ``alcove`` and ``opening`` (rooms that
            are open to the corridor over 2.6 m or their whole width).
        door: width [m].
        corridor: width [m].
        wall: thickness [m].
    """
    width, depth = 4.6, 4.0
    below, above = wall, wall + depth + 2 * wall + corridor
    low, high = wall + depth + wall, wall + depth + wall + corridor  # of the corridor
    length = 3 * (width + wall)
    plan = Office((wall + length + width + wall, above + depth + wall))
    plan.free.append((wall, low, length, high))
    for i in range(3):
        x1 = wall + i * (width + wall)
        for y1, (d1, d2), row in (
            (below, (low - wall, low), "s"),
            (above, (high, high + wall), "n"),
        ):
            box = (x1, y1, x1 + width, y1 + depth)
            x = x1 + width / 2.0 + (0.7 if kind == "shifted" and row == "n" else 0.0)
            gap = door
            if kind == "corners":
                x = x1 + door / 2.0 + 0.001 if (i + (row == "n")) % 2 else x1 + width - door / 2.0
            if i == 1 and kind in OPENINGS:
                gap = {"opening": width, "alcove": 2.6}[kind]
            hole = (x - gap / 2.0, d1 - 0.01, x + gap / 2.0, d2 + 0.01)
            plan.free += [box, hole]
            point = (x1 + width / 2.0 - 0.6, y1 + depth / 2.0)
            is_open = i == 1 and kind in OPENINGS
            holes = () if is_open else (hole,)
            if kind == "two_doors" and i == 1:
                other = (x + 1.2, hole[1], x + 1.2 + min(door, 1.0), hole[3])
                plan.free.append(other)
                holes = (hole, other)
            plan.places.append(Place(f"{row}{i}", point, box, holes))
            if kind == "furniture":
                away = y1 if row == "s" else y1 + depth - 0.8
                inner = y1 + depth - 1.2 if row == "s" else y1 + 0.9
                plan.solid += [
                    (x1, away, x1 + 1.6, away + 0.8),
                    (x1 + 3.2, inner, x1 + 3.5, inner + 0.3),
                ]
                if i == 2:  # two desks against the walls, a gap between them
                    desk = point[1] + (0.55 if row == "s" else -1.25)
                    plan.solid += [
                        (x1, desk, x1 + 1.7, desk + 0.7),
                        (x1 + 2.7, desk, x1 + width, desk + 0.7),
                    ]
    x1 = wall + length
    end = (x1, low - 1.0, x1 + width, high + 1.0)
    hole = (
        x1 - wall - 0.01,
        low + corridor / 2 - door / 2,
        x1 + 0.01,
        low + corridor / 2 + door / 2,
    )
    hole = (hole[0], max(hole[1], low), hole[2], min(hole[3], high))
    if door < corridor - 0.05:
        plan.free += [end, hole]
        plan.places.append(Place("end", (x1 + width / 2, (low + high) / 2), end, (hole,)))
    if kind == "series":
        back = (wall, above + depth + wall, wall + width, above + 2 * depth + wall)
        x = wall + width / 2.0 + 0.8
        hole = (x - door / 2, back[1] - wall - 0.01, x + door / 2, back[1] + 0.01)
        plan.free += [back, hole]
        plan.places.append(Place("back", (wall + 2.0, back[1] + 2.0), back, (hole,)))
        plan.size = (plan.size[0], plan.size[1] + depth + wall)
    return plan


def occupancy(
    plan: Office, *, resolution: float = 0.05, turned: float = 0.0, noise: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a floor.

    Returns:
        ``(rows, cols)`` occupancy 0 or 100, row 0 southernmost; the map's origin ``(2,)`` [m];
        the matrix ``(2, 2)`` that turns points of the plan.
    """
    cos, sin = np.cos(turned), np.sin(turned)
    turn = np.array([[cos, -sin], [sin, cos]])
    width, depth = plan.size
    ends = np.array([[0, 0], [width, 0], [width, depth], [0, depth]]) @ turn.T
    low, high = ends.min(axis=0) - 0.5, ends.max(axis=0) + 0.5
    cols, rows = np.ceil((high - low) / resolution).astype(int)
    x = low[0] + (np.arange(cols) + 0.5) * resolution
    y = low[1] + (np.arange(rows) + 0.5) * resolution
    at = np.stack(np.meshgrid(x, y), axis=-1) @ turn
    grid = np.where(plan.is_free(at[..., 0], at[..., 1]), 0, 100).astype(np.int8)
    if noise is not None:
        grid = ragged(grid, noise)
    return grid, low, turn


def ragged(grid: np.ndarray, seed: int) -> np.ndarray:
    """Roughen walls by a cell here and there, and add specks, as a mapping run does."""
    rng = np.random.default_rng(seed)
    occupied = grid == 100
    edge = ndimage.binary_dilation(occupied) & ~occupied
    rough = occupied | (edge & (rng.random(grid.shape) < 0.3))
    rim = occupied & ndimage.binary_dilation(~occupied)
    rough &= ~(
        rim & (rng.random(grid.shape) < 0.2) & ndimage.binary_erosion(occupied, iterations=1)
    )
    rough |= rng.random(grid.shape) < 0.0002
    return np.where(rough, 100, 0).astype(np.int8)
