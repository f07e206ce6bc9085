"""How people step past robots: no one walks into a robot, so no one pushes it.

A step that would end inside a robot leads along its surface instead.
"""

from __future__ import annotations

import math

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from simulator_interface.engines.gaps import (
    Footprints,
    Pedestrians,
    Solids,
    disc_clear,
    polygon_point_gap,
)

STRAIGHT_ON = 0.02  # m; who walks past a robot's centre this near walks straight at it
SIDE = 1e-9  # m; nearer to the outline than this, a point's direction is that of the side
FAR_FROM_DISC = 0.1  # m beyond reach: robots farther from a disc cannot matter to its step
TOUCHING = 1e-6  # m; overlap that rounding makes


@njit(cache=True)
def _outward(polygon: Array, corners: int, px: float, py: float) -> tuple[float, float]:
    """Find the unit vector from a convex polygon's nearest point (or side) to a point."""
    best, nx, ny = np.inf, 1.0, 0.0
    deepest, mx, my = -np.inf, 1.0, 0.0
    for k in range(corners):
        j = k + 1 if k + 1 < corners else 0
        ax, ay = polygon[k, 0], polygon[k, 1]
        ex, ey = polygon[j, 0] - ax, polygon[j, 1] - ay
        length = math.sqrt(ex * ex + ey * ey)
        side = ((px - ax) * ey - (py - ay) * ex) / length
        if side > deepest:
            deepest, mx, my = side, ey / length, -ex / length
        t = min(1.0, max(0.0, ((px - ax) * ex + (py - ay) * ey) / (length * length)))
        dx, dy = px - ax - t * ex, py - ay - t * ey
        distance = math.sqrt(dx * dx + dy * dy)
        if distance < best:
            best = distance
            if distance > SIDE:
                nx, ny = dx / distance, dy / distance
    if deepest <= SIDE:
        return mx, my
    return nx, ny


@njit(cache=True)
def _least_gap(
    x: float, y: float, radius: float, pose: Array, prints: Footprints
) -> tuple[float, int]:
    """Measure the gap of a disc to the nearest robot (inf: all are far); says which it is."""
    best, robot = np.inf, -1
    for i in range(len(pose)):
        apart = math.hypot(pose[i, 0] - x, pose[i, 1] - y) - prints.reach[i] - radius
        if apart > FAR_FROM_DISC:
            continue
        found = polygon_point_gap(prints.placed[i], prints.corners[i], x, y) - radius
        if found < best:
            best, robot = found, i
    return best, robot


@njit(cache=True)
def move_people(
    people: Pedestrians,
    velocity: Array,
    step: float,
    pose: Array,
    prints: Footprints,
    solids: Solids,
    touched: BoolArray,
) -> None:
    """Walk all people for one sub-step.

    A person whose step would end inside a robot goes round the nearer side; if the other bodies
    leave no room there, the other way; else the person stands.

    Args:
        people: who is about; positions are updated.
        velocity: ``(H, 2)`` wanted [m/s].
        step: [s].
        pose: ``(N, 3)`` of the robots.
        prints: their footprints, placed.
        solids: what stands.
        touched: ``(N,)`` set where a person was held up by the robot.
    """
    position = people.position
    for h in range(len(position)):
        if not people.present[h]:
            continue
        x, y, r = position[h, 0], position[h, 1], people.radius[h]
        dx, dy = velocity[h, 0] * step, velocity[h, 1] * step
        after, robot = _least_gap(x + dx, y + dy, r, pose, prints)
        if after >= 0.0:
            position[h, 0], position[h, 1] = x + dx, y + dy
            continue
        body, corners = prints.placed[robot], prints.corners[robot]
        before = polygon_point_gap(body, corners, x, y) - r
        if after >= before:  # already overlapping, and leaving
            position[h, 0], position[h, 1] = x + dx, y + dy
            continue
        touched[robot] = True
        length = math.sqrt(dx * dx + dy * dy)
        nx, ny = _outward(body, corners, x, y)
        turn = (x - pose[robot, 0]) * dy - (y - pose[robot, 1]) * dx
        way = -1.0 if turn < -STRAIGHT_ON * length else 1.0  # straight on: pass on the right
        free_before = disc_clear(solids.grid, solids.extra, x, y, r)
        for _ in range(2):
            sx, sy = x - way * ny * length, y + way * nx * length
            gap, other = _least_gap(sx, sy, r, pose, prints)
            if gap < 0.0 and other == robot:  # round a corner: step back out to the surface
                ox, oy = _outward(body, corners, sx, sy)
                sx, sy = sx - gap * ox, sy - gap * oy
                gap, other = _least_gap(sx, sy, r, pose, prints)
            free = disc_clear(solids.grid, solids.extra, sx, sy, r)
            if gap >= min(before, 0.0) - TOUCHING and (free >= r or free >= free_before):
                position[h, 0], position[h, 1] = sx, sy
                break
            way = -way
