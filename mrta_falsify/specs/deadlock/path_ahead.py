"""What lies ahead of a robot on its path."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.compiled import njit

NEARER_BY = 0.03  # m; a body in the way comes nearer by more than this if the robot moves on


@njit(cache=True)
def points_ahead(path: Array, x: float, y: float, reach: float, step: float) -> Array:
    """Sample ``path`` ``(L, 2)`` every ``step`` [m] from its point nearest to (x, y) on.

    Args:
        path: ``(L, 2)`` [m].
        x: where the robot is [m].
        y: where the robot is [m].
        reach: length of the path looked at [m].
        step: distance of the points [m].

    Returns:
        ``(P, 2)`` [m]; the first is the projection of (x, y); P >= 1 if L >= 1.
    """
    best, segment, px, py = np.inf, 0, path[0, 0], path[0, 1]
    for k in range(len(path) - 1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        length2 = dx * dx + dy * dy
        share = 0.0
        if length2 > 0.0:
            share = ((x - path[k, 0]) * dx + (y - path[k, 1]) * dy) / length2
            share = min(1.0, max(0.0, share))
        qx, qy = path[k, 0] + share * dx, path[k, 1] + share * dy
        distance = (qx - x) ** 2 + (qy - y) ** 2
        if distance < best - 1e-9:
            best, segment, px, py = distance, k, qx, qy
    count = int(reach / step) + 1
    points = np.empty((count, 2))
    points[0, 0], points[0, 1] = px, py
    made = 1
    while made < count:
        need = step
        while segment < len(path) - 1:
            ex, ey = path[segment + 1, 0] - px, path[segment + 1, 1] - py
            left = np.sqrt(ex * ex + ey * ey)
            if left >= need:
                px, py = px + ex / left * need, py + ey / left * need
                need = 0.0
                break
            need -= left
            segment += 1
            px, py = path[segment, 0], path[segment, 1]
        if need > 0.0:
            break
        points[made, 0], points[made, 1] = px, py
        made += 1
    return points[:made]


@njit(cache=True)
def remaining_length(path: Array, x: float, y: float) -> float:
    """Measure ``path`` ``(L, 2)``, L >= 1, from the point nearest to (x, y) to its end [m].

    The distance to the path is added, so that leaving it sideways is no progress.
    """
    best, rest, tail = np.inf, 0.0, 0.0
    for k in range(len(path) - 2, -1, -1):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        length = np.sqrt(dx * dx + dy * dy)
        share = 0.0
        if length > 0.0:
            share = ((x - path[k, 0]) * dx + (y - path[k, 1]) * dy) / (length * length)
            share = min(1.0, max(0.0, share))
        ex, ey = path[k, 0] + share * dx - x, path[k, 1] + share * dy - y
        off = np.sqrt(ex * ex + ey * ey)
        if off < best:
            best, rest = off, tail + (1.0 - share) * length
        tail += length
    if len(path) == 1:
        return float(np.sqrt((path[0, 0] - x) ** 2 + (path[0, 1] - y) ** 2))
    return float(rest + best)


@njit(cache=True)
def first_conflicts(
    ahead: Array, x: float, y: float, bodies: Array, clearance: Array, step: float
) -> Array:
    """Find the arc length [m] at which each body comes too near on the way ``ahead``; inf: never.

    A body counts only if moving on brings the robot nearer to it. One that stands beside or
    behind the robot is not in the way.

    Args:
        ahead: ``(P, 2)`` points of the way [m], ``step`` apart.
        x: where the robot is [m].
        y: where the robot is [m].
        bodies: ``(M, 2)`` [m].
        clearance: ``(M,)`` centre distances not to undercut [m].
        step: distance of the points [m].
    """
    arcs = np.full(len(bodies), np.inf)
    for j in range(len(bodies)):
        now = np.sqrt((bodies[j, 0] - x) ** 2 + (bodies[j, 1] - y) ** 2)
        for k in range(len(ahead)):
            distance = np.sqrt(
                (bodies[j, 0] - ahead[k, 0]) ** 2 + (bodies[j, 1] - ahead[k, 1]) ** 2
            )
            if distance < clearance[j] and distance < now - NEARER_BY:
                arcs[j] = k * step
                break
    return arcs
