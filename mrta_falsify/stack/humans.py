"""How people walk: a social-force model, and people who see nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.protocols import CrowdView

CELL = 1.0  # m, side of a cell of the wall grid
SIGHT = 1.5  # m, walls farther away do not push


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
    lets them through 0.9 m. Nobody passes through a wall: the step of a tick is cut where it
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
        self._options = options
        self._grid: _WallGrid | None = None

    def velocities(self, view: CrowdView) -> Array:
        """See :class:`~mrta_falsify.core.protocols.HumanModel`."""
        grid = self._grid
        if grid is None or grid.walls is not view.walls:
            grid = self._grid = _WallGrid(view.walls)
        o = self._options
        return _social_velocities(
            view.dt,
            view.position,
            view.velocity,
            view.target,
            view.desired_speed,
            view.radius,
            view.reacts_to_robots,
            view.present,
            view.robot_position,
            view.robot_velocity,
            view.robot_radius,
            grid.edges,
            grid.origin,
            grid.shape,
            grid.first,
            grid.members,
            np.array(
                [
                    o.tau,
                    o.strength,
                    o.anticipation,
                    o.reach,
                    o.angular_slowing,
                    o.angular_turning,
                    o.wall_strength,
                    o.wall_reach,
                    o.top_speed,
                    o.top_ratio,
                ]
            ),
        )


class _WallGrid:
    """Edges near each cell of a uniform grid; a pure function of the walls, so never copied."""

    def __init__(self, walls: Array) -> None:
        self.walls = walls
        self.edges = np.ascontiguousarray(walls, dtype=np.float64).reshape(-1, 4)
        if len(self.edges):
            low = np.minimum(self.edges[:, :2], self.edges[:, 2:]).min(axis=0) - SIGHT
            high = np.maximum(self.edges[:, :2], self.edges[:, 2:]).max(axis=0) + SIGHT
        else:
            low, high = np.zeros(2), np.ones(2)
        self.origin = low
        self.shape = np.maximum(np.ceil((high - low) / CELL), 1.0).astype(np.int64)
        self.first, self.members = _bin_edges(self.edges, self.origin, self.shape)

    def __deepcopy__(self, memo: dict[int, Any]) -> _WallGrid:
        return self


@njit(cache=True)
def _bin_edges(edges: Array, origin: Array, shape: IntArray) -> tuple[IntArray, IntArray]:
    """Edges that come within SIGHT of each cell, as row starts and edge numbers."""
    count = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    members = np.empty(0, dtype=np.int64)
    radius = SIGHT + CELL * np.sqrt(0.5)
    for sweep in range(2):
        if sweep == 1:
            for c in range(len(count) - 1):
                count[c + 1] += count[c]
            members = np.empty(count[-1], dtype=np.int64)
            for c in range(len(count) - 1, 0, -1):
                count[c] = count[c - 1]
            count[0] = 0
        for e in range(edges.shape[0]):
            x1, y1, x2, y2 = edges[e]
            c1 = max(0, int((min(x1, x2) - radius - origin[0]) / CELL))
            c2 = min(shape[0] - 1, int((max(x1, x2) + radius - origin[0]) / CELL))
            r1 = max(0, int((min(y1, y2) - radius - origin[1]) / CELL))
            r2 = min(shape[1] - 1, int((max(y1, y2) + radius - origin[1]) / CELL))
            for r in range(r1, r2 + 1):
                for c in range(c1, c2 + 1):
                    x = origin[0] + (c + 0.5) * CELL
                    y = origin[1] + (r + 0.5) * CELL
                    nx, ny = _nearest_on_edge(x, y, x1, y1, x2, y2)
                    if (nx - x) ** 2 + (ny - y) ** 2 > radius * radius:
                        continue
                    cell = r * shape[0] + c
                    if sweep == 1:
                        members[count[cell + 1]] = e
                    count[cell + 1] += 1
    return count, members


@njit(cache=True)
def _cell_of(x: float, y: float, origin: Array, shape: IntArray) -> int:
    """Cell number of a point, -1 outside."""
    c, r = int(np.floor((x - origin[0]) / CELL)), int(np.floor((y - origin[1]) / CELL))
    if 0 <= c < shape[0] and 0 <= r < shape[1]:
        return int(r * shape[0] + c)
    return -1


@njit(cache=True)
def _nearest_on_edge(
    x: float, y: float, x1: float, y1: float, x2: float, y2: float
) -> tuple[float, float]:
    """Point of an edge nearest to (x, y)."""
    dx, dy = x2 - x1, y2 - y1
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((x - x1) * dx + (y - y1) * dy) / square))
    return x1 + t * dx, y1 + t * dy


@njit(cache=True)
def _crosses(
    ax: float, ay: float, bx: float, by: float, x1: float, y1: float, x2: float, y2: float
) -> bool:
    """Whether segments a-b and 1-2 meet."""
    d1 = (x2 - x1) * (ay - y1) - (y2 - y1) * (ax - x1)
    d2 = (x2 - x1) * (by - y1) - (y2 - y1) * (bx - x1)
    d3 = (bx - ax) * (y1 - ay) - (by - ay) * (x1 - ax)
    d4 = (bx - ax) * (y2 - ay) - (by - ay) * (x2 - ax)
    return bool(d1 * d2 <= 0.0 and d3 * d4 <= 0.0 and (d1 != d2 or d3 != d4))


@njit(cache=True)
def _pair_force(
    dx: float, dy: float, wx: float, wy: float, touch: float, p: Array
) -> tuple[float, float]:
    """Acceleration by another body at offset (dx, dy) with relative velocity own - other.

    ``touch`` is the sum of the radii [m]; nearer than that, a stiff push is added.
    """
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-6)
    ex, ey = dx / distance, dy / distance
    ix, iy = p[2] * wx + ex, p[2] * wy + ey
    length = max(np.sqrt(ix * ix + iy * iy), 1e-6)
    tx, ty = ix / length, iy / length
    # Angle from the interaction direction to the other; straight ahead counts as left, so
    # both step to their right.
    theta = np.arctan2(tx * ey - ty * ex, tx * ex + ty * ey) + 1e-3
    b = p[3] * length
    gap = max(distance - touch + 0.5, 0.0)  # the calibration had bodies 0.5 m wide
    slow = -p[1] * np.exp(-gap / b - (p[4] * b * theta) ** 2)
    turn = -np.sign(theta) * p[1] * np.exp(-gap / b - (p[5] * b * theta) ** 2)
    ax = slow * tx - turn * ty
    ay = slow * ty + turn * tx
    if distance < touch + 0.1:
        push = 20.0 * (touch + 0.1 - distance)
        ax -= push * ex
        ay -= push * ey
    return ax, ay


@njit(cache=True)
def _wall_force(
    x: float,
    y: float,
    edges: Array,
    origin: Array,
    shape: IntArray,
    first: IntArray,
    members: IntArray,
    p: Array,
) -> tuple[float, float]:
    """Acceleration by the nearest wall point in each of four quadrants around (x, y)."""
    cell = _cell_of(x, y, origin, shape)
    if cell < 0:
        return 0.0, 0.0
    best = np.full(4, SIGHT * SIGHT)
    push_x, push_y = np.zeros(4), np.zeros(4)
    for k in range(first[cell], first[cell + 1]):
        e = members[k]
        nx, ny = _nearest_on_edge(x, y, edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3])
        dx, dy = x - nx, y - ny
        square = dx * dx + dy * dy
        # quadrants east, north, west, south: a wall straight ahead is one wall, not two
        east_or_west = abs(dx) >= abs(dy)
        quadrant = (0 if dx < 0.0 else 2) if east_or_west else (1 if dy < 0.0 else 3)
        if square >= best[quadrant]:
            continue
        best[quadrant] = square
        distance = max(np.sqrt(square), 1e-6)
        force = p[6] / p[7] * np.exp(-distance / p[7])
        push_x[quadrant] = force * dx / distance
        push_y[quadrant] = force * dy / distance
    return push_x.sum(), push_y.sum()


@njit(cache=True)
def _step_beside_walls(
    x: float,
    y: float,
    sx: float,
    sy: float,
    radius: float,
    edges: Array,
    origin: Array,
    shape: IntArray,
    first: IntArray,
    members: IntArray,
) -> tuple[float, float]:
    """The step (sx, sy) as far as walls allow.

    It is walked in pieces of at most half a radius; a piece that would come nearer to an
    edge than ``radius`` (or nearer than it is, if it is that near already) slides along it.
    """
    length = np.sqrt(sx * sx + sy * sy)
    pieces = max(1, int(np.ceil(length / (0.5 * radius))))
    px, py = x, y
    for _ in range(pieces):
        mx, my = sx / pieces, sy / pieces
        cell = _cell_of(px, py, origin, shape)
        if cell < 0:
            px, py = px + mx, py + my
            continue
        for _sweep in range(3):
            for k in range(first[cell], first[cell + 1]):
                e = members[k]
                x1, y1, x2, y2 = edges[e]
                ox, oy = _nearest_on_edge(px, py, x1, y1, x2, y2)
                before = np.sqrt((ox - px) ** 2 + (oy - py) ** 2)
                nx, ny = _nearest_on_edge(px + mx, py + my, x1, y1, x2, y2)
                dx, dy = px + mx - nx, py + my - ny
                after = np.sqrt(dx * dx + dy * dy)
                allowed = min(radius, before)
                if after >= allowed - 1e-9 or before < 1e-9:
                    continue
                # Push the end of the piece back out, along the normal at its start.
                nx, ny = (px - ox) / before, (py - oy) / before
                inward = -(mx * nx + my * ny)
                if inward > 0.0:
                    back = min(inward, allowed - after + 1e-9)
                    mx, my = mx + back * nx, my + back * ny
        blocked = False
        for k in range(first[cell], first[cell + 1]):
            e = members[k]
            x1, y1, x2, y2 = edges[e]
            ox, oy = _nearest_on_edge(px, py, x1, y1, x2, y2)
            nx, ny = _nearest_on_edge(px + mx, py + my, x1, y1, x2, y2)
            before = (ox - px) ** 2 + (oy - py) ** 2
            after = (px + mx - nx) ** 2 + (py + my - ny) ** 2
            nearer = after < radius * radius - 1e-6 and after < before - 1e-9
            beyond = before > 1e-12 and _crosses(px, py, px + mx, py + my, x1, y1, x2, y2)
            blocked = blocked or nearer or beyond
        if blocked:
            break
        px, py = px + mx, py + my
    return px - x, py - y


@njit(cache=True)
def _social_velocities(
    dt: float,
    position: Array,
    velocity: Array,
    target: Array,
    desired: Array,
    radius: Array,
    reacts: BoolArray,
    present: BoolArray,
    robot_position: Array,
    robot_velocity: Array,
    robot_radius: Array,
    edges: Array,
    origin: Array,
    shape: IntArray,
    first: IntArray,
    members: IntArray,
    p: Array,
) -> Array:
    """Velocities ``(H, 2)`` [m/s]; ``p`` are the options in their order."""
    h, n = position.shape[0], robot_position.shape[0]
    result = np.zeros((h, 2))
    for i in range(h):
        if not present[i]:
            continue
        x, y = position[i]
        vx, vy = velocity[i]
        wx = wy = 0.0
        tx, ty = target[i, 0] - x, target[i, 1] - y
        distance = np.sqrt(tx * tx + ty * ty)
        if distance > 1e-6:
            speed = min(desired[i], distance / dt)
            wx, wy = speed * tx / distance, speed * ty / distance
        ax, ay = (wx - vx) / p[0], (wy - vy) / p[0]
        for j in range(h):
            if j == i or not present[j]:
                continue
            dx, dy = position[j, 0] - x, position[j, 1] - y
            if dx * dx + dy * dy > 36.0:
                continue
            fx, fy = _pair_force(
                dx, dy, vx - velocity[j, 0], vy - velocity[j, 1], radius[i] + radius[j], p
            )
            ax, ay = ax + fx, ay + fy
        if reacts[i]:
            for j in range(n):
                dx, dy = robot_position[j, 0] - x, robot_position[j, 1] - y
                if not dx * dx + dy * dy <= 36.0:
                    continue
                fx, fy = _pair_force(
                    dx,
                    dy,
                    vx - robot_velocity[j, 0],
                    vy - robot_velocity[j, 1],
                    radius[i] + robot_radius[j],
                    p,
                )
                ax, ay = ax + fx, ay + fy
        fx, fy = _wall_force(x, y, edges, origin, shape, first, members, p)
        ax, ay = ax + fx, ay + fy
        nvx, nvy = vx + dt * ax, vy + dt * ay
        top = min(p[8], p[9] * desired[i]) if desired[i] > 0.0 else 0.5
        speed = np.sqrt(nvx * nvx + nvy * nvy)
        if speed > top:
            nvx, nvy = nvx * top / speed, nvy * top / speed
        sx, sy = _step_beside_walls(
            x, y, nvx * dt, nvy * dt, radius[i], edges, origin, shape, first, members
        )
        result[i, 0], result[i, 1] = sx / dt, sy / dt
    return result
