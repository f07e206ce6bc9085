"""What a model of people works on: bodies, walls that push, and steps that stay beside them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.protocols import CrowdView
from mrta_falsify.stack.wall_grid import (
    SIGHT,
    Stride,
    WallGrid,
    Walls,
    cell_of,
    edge_at,
    nearest_on_edge,
    step_beside_walls,
)

NEAREST = 1e-6  # m, distances below count as this: a direction is needed


class Walkers(NamedTuple):
    """People, as :class:`~mrta_falsify.core.protocols.CrowdView` has them."""

    position: Array  #: (H, 2) [m]
    velocity: Array  #: (H, 2) [m/s]
    target: Array  #: (H, 2) [m]
    desired_speed: Array  #: (H,) [m/s]
    radius: Array  #: (H,) [m]
    reacts_to_robots: BoolArray  #: (H,)
    present: BoolArray  #: (H,)


class Machines(NamedTuple):
    """Robots among the people."""

    position: Array  #: (N, 2) [m]
    velocity: Array  #: (N, 2) [m/s], map frame
    radius: Array  #: (N,) [m]


def grid_of(view: CrowdView, known: WallGrid | None) -> WallGrid:
    """Sort the walls of a view, unless ``known`` has them already."""
    return known if known is not None and known.source is view.walls else WallGrid(view.walls)


def bodies_in(view: CrowdView) -> tuple[Walkers, Machines]:
    """Give the people and robots of a view to compiled code."""
    people = Walkers(
        view.position,
        view.velocity,
        view.target,
        view.desired_speed,
        view.radius,
        view.reacts_to_robots,
        view.present,
    )
    return people, Machines(view.robot_position, view.robot_velocity, view.robot_radius)


@njit(cache=True)
def wall_force(
    x: float, y: float, walls: Walls, strength: float, reach: float
) -> tuple[float, float]:
    """Add up the accelerations by the nearest wall point of each of four quadrants."""
    cell = cell_of(x, y, walls)
    if cell < 0:
        return 0.0, 0.0
    best = np.full(4, SIGHT * SIGHT)
    push_x, push_y = np.zeros(4), np.zeros(4)
    for k in range(walls.first[cell], walls.first[cell + 1]):
        x1, y1, x2, y2 = edge_at(k, walls)
        nx, ny = nearest_on_edge(x, y, x1, y1, x2, y2)
        dx, dy = x - nx, y - ny
        square = dx * dx + dy * dy
        # quadrants east, north, west, south: a wall straight ahead is one wall, not two
        east_or_west = abs(dx) >= abs(dy)
        quadrant = (0 if dx < 0.0 else 2) if east_or_west else (1 if dy < 0.0 else 3)
        if square >= best[quadrant]:
            continue
        best[quadrant] = square
        distance = max(np.sqrt(square), NEAREST)
        force = strength / reach * np.exp(-distance / reach)
        push_x[quadrant] = force * dx / distance
        push_y[quadrant] = force * dy / distance
    return push_x.sum(), push_y.sum()


@njit(cache=True)
def velocity_beside_walls(
    x: float, y: float, vx: float, vy: float, top: float, radius: float, dt: float, walls: Walls
) -> tuple[float, float]:
    """Keep a person's velocity (vx, vy) to a top speed, and its next step beside walls [m/s].

    Args:
        x: where the person is [m], map frame.
        y: the same.
        vx: wanted [m/s], map frame.
        vy: the same.
        top: speed [m/s].
        radius: of the person [m].
        dt: of the step [s].
        walls: see :func:`~mrta_falsify.stack.wall_grid.step_beside_walls`.
    """
    speed = np.sqrt(vx * vx + vy * vy)
    if speed > top:
        vx, vy = vx * top / speed, vy * top / speed
    sx, sy = step_beside_walls(Stride(x, y, vx * dt, vy * dt), radius, walls)
    return sx / dt, sy / dt
