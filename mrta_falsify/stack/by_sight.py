"""How people walk by sight: the way past others that leads nearest to the next point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.protocols import CrowdView
from mrta_falsify.stack.humans import (
    NEAREST,
    Machines,
    Walkers,
    bodies_in,
    grid_of,
    velocity_beside_walls,
    wall_force,
)
from mrta_falsify.stack.wall_grid import WallGrid, Walls, cell_of, edge_at

AHEAD = 0.3  # m to either side: who walks there walks ahead
GOING_ALONG = 0.1  # m/s, who comes towards a person is met, not followed
JAM_DENSITY = 5.4  # 1/m^2, at which nobody moves any more (Weidmann)
GAMMA = 1.913  # 1/m^2, of Weidmann's curve
TOP_RATIO = 1.3  # of the desired speed, which pushes may add
CONTACT_MARGIN = 0.1  # m, nearer to touching than that a stiff push is added
CONTACT_STIFFNESS = 20.0  # 1/s^2
TOP_SPEED_STANDING = 0.5  # m/s, of people who want to stand and are pushed
ROUNDING = 1e-9  # m^2, of what directions cost
GRAZING = 1e-3  # m; bodies as near as touching do not hold up who walks past


class Sight(NamedTuple):
    """Parameters; see :class:`BySight.Options`."""

    tau: float
    horizon: float
    field: float
    directions: int
    room: float
    robot_room: float
    right_hand: float
    wall_strength: float
    wall_reach: float


class Others(NamedTuple):
    """Bodies that one person sees, nearest or not."""

    place: Array  #: (B, 2) [m], from the person
    velocity: Array  #: (B, 2) [m/s], map frame
    touch: Array  #: (B,) sum of the radii [m]
    room: Array  #: (B,) wanted between the bodies besides [m]


class Course(NamedTuple):
    """Where a person goes next."""

    x: float  #: unit vector, map frame
    y: float
    free: float  #: distance to walk before something is met [m]


class BySight:
    """People go where they see the shortest way past what they would meet, and keep in line.

    Out of a fan of directions a person takes the one that leads nearest to its next point before
    it meets a body or a wall, if all others went on as they do. It leaves room to others, more to
    robots than to people, and passes on the right if either side will do. Its speed follows the
    distance to whoever walks ahead: Weidmann's curve, where a person has the square of that
    distance as its area. It also never walks so fast that it would meet something within ``tau``.
    Bodies that touch push. So do walls, by the potential u0 exp(-d / r); a u0 of 2.5 lets people
    through doors of 0.9 m. No person passes through a wall: the step of a tick is cut where it
    would come nearer to an edge than the body allows.

    Reference: Moussaid, Helbing & Theraulaz, "How simple rules determine pedestrian behavior and
    crowd disasters", PNAS 2011, for the choice of direction; Weidmann, "Transporttechnik der
    Fussgaenger", ETH Zurich 1993, for speed and density.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How far people see, and how they keep their distance."""

        tau: float = quantity(above=0.0, unit="s", default=0.3)  #: to reach the desired velocity
        horizon: float = quantity(
            above=0.0, unit="m", default=6.0
        )  #: distance that a person looks ahead
        field: float = quantity(
            above=0.0, high=1.5, unit="rad", default=1.3
        )  #: of view, to either side
        directions: int = quantity(low=3, high=101, default=25)  #: directions compared
        room: float = quantity(low=0.0, unit="m", default=0.2)  #: gap kept between people
        robot_room: float = quantity(low=0.0, unit="m", default=0.4)  #: gap kept to a robot's body
        right_hand: float = quantity(low=0.0, unit="m^2/rad", default=1.0)  #: cost of a left turn
        wall_strength: float = quantity(low=0.0, unit="m^2/s^2", default=2.5)  #: push of walls
        wall_reach: float = quantity(above=0.0, unit="m", default=0.2)  #: reach of that push

    sight = 3.0  # m, see HumanModel

    def __init__(self, options: Options) -> None:
        self._parameters = Sight(*(getattr(options, name) for name in Sight._fields))
        self._grid: WallGrid | None = None

    def velocities(self, view: CrowdView) -> Array:
        """See :class:`~mrta_falsify.core.protocols.HumanModel`."""
        self._grid = grid_of(view, self._grid)
        result, walls = np.zeros(view.position.shape), self._grid.walls
        _fill_velocities(view.dt, *bodies_in(view), walls, self._parameters, result)
        return result


@njit(cache=True)
def _seen_by(i: int, people: Walkers, robots: Machines, sight: Sight) -> Others:
    """List the bodies within sight of person ``i``."""
    most = len(people.position) + len(robots.position)
    place, velocity = np.empty((most, 2)), np.empty((most, 2))
    touch, room = np.empty(most), np.empty(most)
    x, y = people.position[i, 0], people.position[i, 1]
    count = 0
    for j in range(len(people.position)):
        dx, dy = people.position[j, 0] - x, people.position[j, 1] - y
        if j == i or not people.present[j] or dx * dx + dy * dy > sight.horizon**2:
            continue
        place[count, 0], place[count, 1] = dx, dy
        velocity[count] = people.velocity[j]
        touch[count], room[count] = people.radius[i] + people.radius[j], sight.room
        count += 1
    if people.reacts_to_robots[i]:
        for j in range(len(robots.position)):
            dx, dy = robots.position[j, 0] - x, robots.position[j, 1] - y
            if not dx * dx + dy * dy <= sight.horizon**2:  # also where a robot is not
                continue
            place[count, 0], place[count, 1] = dx, dy
            velocity[count] = robots.velocity[j]
            touch[count], room[count] = people.radius[i] + robots.radius[j], sight.robot_room
            count += 1
    return Others(place[:count], velocity[:count], touch[:count], room[:count])


@njit(cache=True)
def _until_met(dx: float, dy: float, wx: float, wy: float, apart: float) -> float:
    """Time until a point at offset (dx, dy) comes as near as ``apart``, inf: never.

    ``(wx, wy)`` is the own velocity less the other's. What is nearer already is met as soon as it
    comes any nearer.
    """
    along = dx * wx + dy * wy
    if along <= 0.0:
        return np.inf
    square = dx * dx + dy * dy
    apart = min(apart, math.sqrt(square) - GRAZING)
    speed = wx * wx + wy * wy
    root = along * along - speed * (square - apart * apart)
    if root <= 0.0 or apart <= 0.0:
        return np.inf
    return max((along - math.sqrt(root)) / speed, 0.0)


@njit(cache=True)
def _free_way(
    x: float, y: float, ux: float, uy: float, radius: float, walls: Walls, limit: float
) -> float:
    """Distance a disc at (x, y) can go along (ux, uy) beside walls, up to a limit."""
    cell = cell_of(x, y, walls)
    if cell < 0:
        return limit
    for k in range(walls.first[cell], walls.first[cell + 1]):
        x1, y1, x2, y2 = edge_at(k, walls)
        limit = min(limit, _until_met(x1 - x, y1 - y, ux, uy, radius))
        limit = min(limit, _until_met(x2 - x, y2 - y, ux, uy, radius))
        ex, ey = x2 - x1, y2 - y1
        length = math.sqrt(ex * ex + ey * ey)
        if length < NEAREST:
            continue
        away = ((x - x1) * ey - (y - y1) * ex) / length
        nearing = -(ux * ey - uy * ex) / length
        if away < 0.0:
            away, nearing = -away, -nearing
        if nearing <= NEAREST:
            continue
        until = max(away - min(radius, away - GRAZING), 0.0) / nearing
        share = ((x + until * ux - x1) * ex + (y + until * uy - y1) * ey) / (length * length)
        if 0.0 <= share <= 1.0:
            limit = min(limit, until)
    return limit


@njit(cache=True)
def _free_course(
    ux: float, uy: float, speed: float, others: Others, wanted: float, limit: float
) -> float:
    """Distance a person goes along (ux, uy) at ``speed`` before it meets a body, up to a limit.

    ``wanted`` is the share of the room to others that counts.
    """
    for j in range(len(others.touch)):
        wx, wy = speed * ux - others.velocity[j, 0], speed * uy - others.velocity[j, 1]
        dx, dy = others.place[j, 0], others.place[j, 1]
        apart = others.touch[j] + wanted * others.room[j]
        limit = min(limit, speed * _until_met(dx, dy, wx, wy, apart))
    return limit


@njit(cache=True)
def _cost(free: float, turn: float, sight: Sight) -> float:
    """Compare ways: squared distance of their ends from the point ahead at the horizon [m^2].

    Args:
        free: length of the way [m].
        turn: of the way from straight on [rad].
        sight: to the left, some is added.
    """
    far = sight.horizon
    square = far * far + free * free - 2.0 * far * free * math.cos(turn)
    return square + sight.right_hand * turn


@njit(cache=True)
def _course(
    x: float,
    y: float,
    towards: float,
    speed: float,
    radius: float,
    others: Others,
    walls: Walls,
    sight: Sight,
) -> Course:
    """Choose among the directions around ``towards`` [rad] for a person that walks at ``speed``."""
    half, far = sight.directions // 2, sight.horizon
    ahead = Course(math.cos(towards), math.sin(towards), 0.0)
    least, best = np.inf, ahead
    for n in range(sight.directions):
        # Straight on comes first: where nothing is met there, no other direction is better.
        step = (n + 1) // 2 if n % 2 else -(n // 2)
        turn = step * sight.field / half
        ideal = far * math.cos(turn)  # no end of a way in this direction costs less
        if _cost(ideal, turn, sight) > least + ROUNDING:
            continue
        ux, uy = math.cos(towards + turn), math.sin(towards + turn)
        free = _free_way(x, y, ux, uy, radius, walls, far)
        if _cost(min(free, ideal), turn, sight) > least + ROUNDING:
            continue
        free = _free_course(ux, uy, speed, others, 1.0, free)
        cost = _cost(free, turn, sight)
        if cost < least:
            least, best = cost, Course(ux, uy, free)
        if n == 0 and free >= far:
            break
    return best


@njit(cache=True)
def _speed_in_line(desired: float, course: Course, others: Others) -> float:
    """Read Weidmann's speed at the distance to whoever walks ahead of a person [m/s]."""
    headway = np.inf
    for j in range(len(others.touch)):
        dx, dy = others.place[j, 0], others.place[j, 1]
        along, beside = dx * course.x + dy * course.y, dy * course.x - dx * course.y
        pace = others.velocity[j, 0] * course.x + others.velocity[j, 1] * course.y
        if 0.0 < along < headway and abs(beside) < AHEAD and pace > GOING_ALONG:
            headway = along
    area = headway * headway - 1.0 / JAM_DENSITY
    return desired * (1.0 - math.exp(-GAMMA * area)) if area > 0.0 else 0.0


@njit(cache=True)
def _pushes(others: Others) -> tuple[float, float]:
    """Add up the accelerations by bodies that touch, or nearly [m/s^2]."""
    ax = ay = 0.0
    for j in range(len(others.touch)):
        dx, dy = others.place[j, 0], others.place[j, 1]
        distance = max(math.sqrt(dx * dx + dy * dy), NEAREST)
        push = CONTACT_STIFFNESS * (others.touch[j] + CONTACT_MARGIN - distance)
        if push > 0.0:
            ax, ay = ax - push * dx / distance, ay - push * dy / distance
    return ax, ay


@njit(cache=True)
def _fill_velocities(
    dt: float, people: Walkers, robots: Machines, walls: Walls, sight: Sight, result: Array
) -> None:
    """Write the velocities ``(H, 2)`` of the next tick [m/s]; those of the absent stay."""
    for i in range(len(result)):
        if not people.present[i]:
            continue
        x, y = people.position[i, 0], people.position[i, 1]
        vx, vy = people.velocity[i, 0], people.velocity[i, 1]
        others = _seen_by(i, people, robots, sight)
        desired, wx, wy = people.desired_speed[i], 0.0, 0.0
        tx, ty = people.target[i, 0] - x, people.target[i, 1] - y
        distance = math.sqrt(tx * tx + ty * ty)
        if distance > NEAREST and desired > 0.0:
            towards, radius = math.atan2(ty, tx), people.radius[i]
            course = _course(x, y, towards, desired, radius, others, walls, sight)
            speed = min(_speed_in_line(desired, course, others), distance / dt)
            free = _free_course(course.x, course.y, desired, others, 0.0, sight.horizon)
            speed = min(speed, free / sight.tau)
            wx, wy = speed * course.x, speed * course.y
        ax, ay = _pushes(others)
        fx, fy = wall_force(x, y, walls, sight.wall_strength, sight.wall_reach)
        nvx = vx + dt * ((wx - vx) / sight.tau + ax + fx)
        nvy = vy + dt * ((wy - vy) / sight.tau + ay + fy)
        top = TOP_RATIO * desired if desired > 0.0 else TOP_SPEED_STANDING
        result[i] = velocity_beside_walls(x, y, nvx, nvy, top, people.radius[i], dt, walls)
