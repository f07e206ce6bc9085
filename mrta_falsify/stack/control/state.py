"""What a controller remembers between ticks: seen points, lost robots, progress, remote commands.

Plain arrays, so that a stack can be copied, hashed and forked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray

SECTORS = 36  #: directions in which a seen point is kept, 10 degrees each
RANGE = 3.0  # m, farther points never matter: a robot stops within 1.5 m
SAME_POINT = 0.15  # m, a new hit this near an old point of its sector replaces it
BODY = 0.28  # m, points this near another robot's centre are that robot


@dataclass(slots=True, kw_only=True, eq=False)
class Memory:
    """State of a controller for N robots."""

    point: Array  #: (N, SECTORS, 2) nearest seen obstacle point per direction [m], inf: none
    seen_at: Array  #: (N, SECTORS) when [s]
    pose: Array  #: (N, 3) last pose heard of, then extrapolated while the states link is down
    speed: Array  #: (N,) the same for the forward speed [m/s]
    anchor: Array  #: (N, 2) where the robot last counted as making progress [m]
    anchor_at: Array  #: (N,) when [s]
    demoted_until: Array  #: (N,) its lead is suspended until then [s]
    remote_at: Array  #: (N,) when its last remote command came [s], -inf: it leads itself
    last_twist: Array  #: (N, 3) last command
    on_its_own: BoolArray  #: (N,) link to the leader lost, controls itself alone
    tick: int

    @classmethod
    def fresh(cls, pose: Array, time: float) -> Memory:
        """Nothing seen yet."""
        n = len(pose)
        return cls(
            point=np.full((n, SECTORS, 2), np.inf),
            seen_at=np.full((n, SECTORS), -np.inf),
            pose=pose.copy(),
            speed=np.zeros(n),
            anchor=pose[:, :2].copy(),
            anchor_at=np.full(n, time),
            demoted_until=np.full(n, -np.inf),
            remote_at=np.full(n, -np.inf),
            last_twist=np.zeros((n, 3)),
            on_its_own=np.zeros(n, dtype=np.bool_),
            tick=0,
        )


@njit(cache=True)
def remember_points(
    point: Array,
    seen_at: Array,
    hits: Array,
    position: Array,
    known: BoolArray,
    now: float,
    horizon: float,
) -> tuple[Array, Array]:
    """Seen points after this tick: twelve rays miss corners that a moving robot's rays swept.

    Args:
        point: ``(N, SECTORS, 2)`` remembered points [m], map frame.
        seen_at: ``(N, SECTORS)`` [s].
        hits: ``(N, A, 2)`` this tick's ray hits [m], inf: none.
        position: ``(N, 2)`` robots [m].
        known: ``(N,)`` robots whose position the others know; hits on them are left out.
        now: [s].
        horizon: older points are forgotten [s].
    """
    n, sectors = seen_at.shape
    new_point = np.full((n, sectors, 2), np.inf)
    new_seen = np.full((n, sectors), -np.inf)
    for i in range(n):
        x, y = position[i]
        nearest = np.full(sectors, RANGE)
        for k in range(sectors):
            px, py = point[i, k]
            if now - seen_at[i, k] > horizon or not np.isfinite(px):
                continue
            dx, dy = px - x, py - y
            distance = np.sqrt(dx * dx + dy * dy)
            sector = int((np.arctan2(dy, dx) + np.pi) / (2.0 * np.pi) * sectors) % sectors
            if distance < nearest[sector]:
                nearest[sector] = distance
                new_point[i, sector] = point[i, k]
                new_seen[i, sector] = seen_at[i, k]
        for k in range(hits.shape[1]):
            px, py = hits[i, k]
            if not (np.isfinite(px) and np.isfinite(py)):
                continue
            dx, dy = px - x, py - y
            distance = np.sqrt(dx * dx + dy * dy)
            if distance >= RANGE:
                continue
            hidden = False
            for j in range(n):
                if j != i and known[j]:
                    ex, ey = px - position[j, 0], py - position[j, 1]
                    hidden = hidden or ex * ex + ey * ey < BODY * BODY
            if hidden:
                continue
            sector = int((np.arctan2(dy, dx) + np.pi) / (2.0 * np.pi) * sectors) % sectors
            old_x, old_y = new_point[i, sector]
            same = (old_x - px) ** 2 + (old_y - py) ** 2 < SAME_POINT * SAME_POINT
            if same or distance < nearest[sector]:
                nearest[sector] = distance
                new_point[i, sector, 0], new_point[i, sector, 1] = px, py
                new_seen[i, sector] = now
    return new_point, new_seen


@njit(cache=True)
def track_robots(
    pose: Array,
    speed: Array,
    last_pose: Array,
    last_speed: Array,
    heard: BoolArray,
    max_acceleration: Array,
    dt: float,
) -> tuple[Array, Array]:
    """Poses ``(N, 3)`` and speeds ``(N,)`` as the fleet knows them.

    A robot that is no longer heard is taken to brake along its heading, as it does.
    """
    known_pose, known_speed = last_pose.copy(), last_speed.copy()
    for i in range(pose.shape[0]):
        if heard[i]:
            known_pose[i] = pose[i]
            known_speed[i] = speed[i]
            continue
        v = last_speed[i]
        known_pose[i, 0] += v * dt * np.cos(last_pose[i, 2])
        known_pose[i, 1] += v * dt * np.sin(last_pose[i, 2])
        step = max_acceleration[i] * dt
        known_speed[i] = max(v - step, 0.0) if v >= 0.0 else min(v + step, 0.0)
    return known_pose, known_speed
