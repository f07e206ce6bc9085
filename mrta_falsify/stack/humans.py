"""How people walk: a social-force model, and people who see nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.protocols import CrowdView
from mrta_falsify.stack.wall_grid import (
    SIGHT,
    Stride,
    WallGrid,
    Walls,
    cell_of,
    nearest_on_edge,
    step_beside_walls,
)

PUSH_RANGE = 6.0  # m, bodies farther away do not push
NEAREST = 1e-6  # m, distances below count as this: a direction is needed
BODY_WIDTH = 0.5  # m, of the people on whom the pair force was calibrated
PASSING_SIDE = 1e-3  # rad, straight ahead counts as left, so both step to their right
CONTACT_MARGIN = 0.1  # m, nearer to touching than that a stiff push is added
CONTACT_STIFFNESS = 20.0  # 1/s^2
TOP_SPEED_STANDING = 0.5  # m/s, of people who want to stand and are pushed


class Forces(NamedTuple):
    """Parameters of the forces; see :class:`SocialForce.Options`."""

    tau: float
    strength: float
    anticipation: float
    reach: float
    angular_slowing: float
    angular_turning: float
    wall_strength: float
    wall_reach: float
    top_speed: float
    top_ratio: float


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


class ConstantVelocity:
    """Everyone walks straight to the next point at the desired speed, whatever is there."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """No options."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def velocities(self, view: CrowdView) -> Array:
        """See :class:`~mrta_falsify.core.protocols.HumanModel`."""
        offset = view.target - view.position
        distance = np.hypot(offset[:, 0], offset[:, 1])
        going = view.present & np.isfinite(distance) & (distance > 1e-9)
        speed = np.where(going, np.minimum(view.desired_speed, distance / view.dt), 0.0)
        unit = np.where(going[:, None], offset, 0.0) / np.where(going, distance, 1.0)[:, None]
        return np.asarray(unit * speed[:, None])


class SocialForce:
    """People are drawn to their next point and pushed by each other, robots and walls.

    The pair force is Moussaid's (calibrated on experiments; it has a side on which people
    pass). Walls push with the potential u0 exp(-d / r) of MRTA-Sim's socialforce, r = 0.2 m;
    its u0 of 10 keeps people from entering doors narrower than 1.2 m, so u0 is 2.5 here, which
    lets them through 0.9 m. No person passes through a wall: the step of a tick is cut where it
    would come nearer to an edge than the body allows.

    Reference: Moussaid et al., "Experimental study of the behavioural mechanisms underlying
    self-organization in human crowds", Proc. R. Soc. B 2009; Helbing & Molnar, "Social force
    model for pedestrian dynamics", Phys. Rev. E 1995.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Parameters of the forces."""

        tau: float = quantity(above=0.0, unit="s", default=0.5)  #: to reach the wanted velocity
        strength: float = quantity(low=0.0, unit="m/s^2", default=4.5)  #: of the pair force
        anticipation: float = quantity(low=0.0, default=2.0)  #: weight of relative velocity
        reach: float = quantity(above=0.0, default=0.35)  #: pair force's range per interaction
        angular_slowing: float = quantity(low=0.0, default=2.0)  #: n'
        angular_turning: float = quantity(low=0.0, default=3.0)  #: n
        wall_strength: float = quantity(low=0.0, unit="m^2/s^2", default=2.5)  #: u0
        wall_reach: float = quantity(above=0.0, unit="m", default=0.2)  #: r
        top_speed: float = quantity(above=0.0, unit="m/s", default=1.5)
        top_ratio: float = quantity(low=1.0, default=1.3)  #: of the desired speed

    def __init__(self, options: Options) -> None:
        self._forces = Forces(*(getattr(options, name) for name in Forces._fields))
        self._grid: WallGrid | None = None

    def velocities(self, view: CrowdView) -> Array:
        """See :class:`~mrta_falsify.core.protocols.HumanModel`."""
        self._grid = grid_of(view, self._grid)
        return _social_velocities(view.dt, *bodies_in(view), self._grid.walls, self._forces)


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
def _pair_force(
    dx: float, dy: float, wx: float, wy: float, touch: float, forces: Forces
) -> tuple[float, float]:
    """Compute the acceleration by another body at offset (dx, dy).

    ``(wx, wy)`` is the own velocity less the other's, ``touch`` the sum of the radii [m].
    """
    distance = max(np.sqrt(dx * dx + dy * dy), NEAREST)
    ex, ey = dx / distance, dy / distance
    ix, iy = forces.anticipation * wx + ex, forces.anticipation * wy + ey
    length = max(np.sqrt(ix * ix + iy * iy), NEAREST)
    tx, ty = ix / length, iy / length
    # Angle from the interaction direction to the other.
    theta = np.arctan2(tx * ey - ty * ex, tx * ex + ty * ey) + PASSING_SIDE
    b = forces.reach * length
    gap = max(distance - touch + BODY_WIDTH, 0.0)
    slow = -forces.strength * np.exp(-gap / b - (forces.angular_slowing * b * theta) ** 2)
    turn = -np.sign(theta) * forces.strength
    turn = turn * np.exp(-gap / b - (forces.angular_turning * b * theta) ** 2)
    ax = slow * tx - turn * ty
    ay = slow * ty + turn * tx
    if distance < touch + CONTACT_MARGIN:
        push = CONTACT_STIFFNESS * (touch + CONTACT_MARGIN - distance)
        ax -= push * ex
        ay -= push * ey
    return ax, ay


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
        x1, y1, x2, y2 = walls.edges[walls.members[k]]
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
def _pushes(
    i: int, people: Walkers, robots: Machines, ax: float, ay: float, forces: Forces
) -> tuple[float, float]:
    """Add to the acceleration (ax, ay) of person ``i`` that by all other bodies [m/s^2]."""
    x, y = people.position[i]
    vx, vy = people.velocity[i]
    for j in range(people.position.shape[0]):
        if j == i or not people.present[j]:
            continue
        dx, dy = people.position[j, 0] - x, people.position[j, 1] - y
        if dx * dx + dy * dy > PUSH_RANGE * PUSH_RANGE:
            continue
        wx, wy = vx - people.velocity[j, 0], vy - people.velocity[j, 1]
        fx, fy = _pair_force(dx, dy, wx, wy, people.radius[i] + people.radius[j], forces)
        ax, ay = ax + fx, ay + fy
    if people.reacts_to_robots[i]:
        for j in range(robots.position.shape[0]):
            dx, dy = robots.position[j, 0] - x, robots.position[j, 1] - y
            if not dx * dx + dy * dy <= PUSH_RANGE * PUSH_RANGE:  # also where a robot is not
                continue
            wx, wy = vx - robots.velocity[j, 0], vy - robots.velocity[j, 1]
            fx, fy = _pair_force(dx, dy, wx, wy, people.radius[i] + robots.radius[j], forces)
            ax, ay = ax + fx, ay + fy
    return ax, ay


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


@njit(cache=True)
def _social_velocities(
    dt: float, people: Walkers, robots: Machines, walls: Walls, forces: Forces
) -> Array:
    """Compute the velocities ``(H, 2)`` of the next tick [m/s]."""
    h = people.position.shape[0]
    result = np.zeros((h, 2))
    for i in range(h):
        if not people.present[i]:
            continue
        x, y = people.position[i]
        vx, vy = people.velocity[i]
        desired = people.desired_speed[i]
        wx = wy = 0.0
        tx, ty = people.target[i, 0] - x, people.target[i, 1] - y
        distance = np.sqrt(tx * tx + ty * ty)
        if distance > NEAREST:
            speed = min(desired, distance / dt)
            wx, wy = speed * tx / distance, speed * ty / distance
        ax, ay = (wx - vx) / forces.tau, (wy - vy) / forces.tau
        ax, ay = _pushes(i, people, robots, ax, ay, forces)
        fx, fy = wall_force(x, y, walls, forces.wall_strength, forces.wall_reach)
        ax, ay = ax + fx, ay + fy
        nvx, nvy = vx + dt * ax, vy + dt * ay
        top = min(forces.top_speed, forces.top_ratio * desired)
        top = top if desired > 0.0 else TOP_SPEED_STANDING
        result[i] = velocity_beside_walls(x, y, nvx, nvy, top, people.radius[i], dt, walls)
    return result
