"""A small world of exact unicycles for the controllers' tests: walls, rays, people, no physics."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.polyline import look_along, point_ahead, project_on_path
from mrta_falsify.core.protocols import ControlView

BODY = np.array([[-0.1965, -0.1525], [0.0685, -0.1525], [0.0685, 0.1525], [-0.1965, 0.1525]])
NO_PATH = np.zeros((0, 2))


def lookahead_point(path: np.ndarray, position: np.ndarray, distance: float = 0.5) -> np.ndarray:
    """Point ``(2,)`` of ``path`` ``(L, 2)`` to steer for; nan if the path is empty [m].

    It is the first one at least ``distance`` away, after the closest one; the end if everything
    ahead is nearer.
    """
    if len(path) == 0:
        return np.full(2, np.nan)
    if len(path) == 1:
        return path[0].copy()
    segment, share = project_on_path(path, position[0], position[1], 0)
    return np.array(point_ahead(path, segment, share, position[0], position[1], distance))


def remaining_path(path: np.ndarray, position: np.ndarray) -> np.ndarray:
    """What of ``path`` ``(L, 2)`` is still ahead: the closest point, then the later corners.

    An empty path stays empty; at the end of the path only its last point is left.
    """
    if len(path) < 2:
        return path.copy()
    segment, share = project_on_path(path, position[0], position[1], 0)
    if share >= 1.0:
        return path[segment + 1 :].copy()
    beside = path[segment] + share * (path[segment + 1] - path[segment])
    return np.concatenate((beside[None], path[segment + 1 :]))


def line(*points: tuple[float, float], spacing: float = 0.1) -> np.ndarray:
    """Polyline with points every ``spacing`` [m]."""
    parts = []
    for a, b in itertools.pairwise(np.array(points, dtype=float)):
        n = max(1, int(np.ceil(np.linalg.norm(b - a) / spacing)))
        parts.append(a + (b - a) * np.linspace(0, 1, n, endpoint=False)[:, None])
    parts.append(np.asarray(points[-1], dtype=float)[None])
    return np.concatenate(parts)


def box(x1: float, y1: float, x2: float, y2: float) -> list[tuple[float, float, float, float]]:
    return [(x1, y1, x2, y1), (x2, y1, x2, y2), (x2, y2, x1, y2), (x1, y2, x1, y1)]


def cast(position, yaw, walls, rays=12, reach=10.0):
    """Nearest wall point per ray ``(rays, 2)``, inf: none."""
    hits = np.full((rays, 2), np.inf)
    if len(walls) == 0:
        return hits
    angles = yaw + np.arange(rays) * 2 * np.pi / rays
    d = np.column_stack((np.cos(angles), np.sin(angles)))
    a, e = walls[:, :2] - position, walls[:, 2:] - walls[:, :2]
    cross = np.outer(d[:, 0], e[:, 1]) - np.outer(d[:, 1], e[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        s = (np.outer(d[:, 1], a[:, 0]) - np.outer(d[:, 0], a[:, 1])) / cross
    good = (np.abs(cross) > 1e-12) & (t >= 0) & (t <= reach) & (s >= 0) & (s <= 1)
    nearest = np.where(good, t, np.inf).min(axis=1)
    seen = np.isfinite(nearest)
    hits[seen] = position + d[seen] * nearest[seen, None]
    return hits


def edge_distance(points, walls):
    """Distance of each point to the nearest wall."""
    if len(walls) == 0:
        return np.full(len(points), np.inf)
    a, e = walls[:, :2], walls[:, 2:] - walls[:, :2]
    d = points[:, None] - a[None]
    t = np.clip(np.einsum("pwi,wi->pw", d, e) / np.einsum("wi,wi->w", e, e), 0, 1)
    return np.linalg.norm(d - t[..., None] * e[None], axis=2).min(axis=1)


@dataclass
class Course:
    """Robots on given paths among walls and people that walk straight."""

    pose: np.ndarray
    paths: list
    walls: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    active: list | None = None
    rank: list | None = None
    humans: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    human_velocity: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    dt: float = 0.05
    engine_acceleration: float = 2.5
    max_speed: float = 1.5
    holonomic: bool = False

    def __post_init__(self):
        self.pose = np.array(self.pose, dtype=float)
        n = len(self.pose)
        self.walls = np.array(self.walls, dtype=float).reshape(-1, 4)
        self.humans = np.array(self.humans, dtype=float).reshape(-1, 2)
        self.human_velocity = np.array(self.human_velocity, dtype=float).reshape(-1, 2)
        self.velocity = np.zeros((n, 3))
        self.time = 0.0
        self.states = np.ones(n, dtype=bool)
        self.leader_link = np.ones(n, dtype=bool)
        self.narrowest_robot = np.inf
        self.narrowest_wall = np.inf
        self.struck = []  # (time, robot, human, speed) at contact
        self.log = []
        self.active = np.array(
            [len(p) > 0 for p in self.paths] if self.active is None else self.active
        )
        self.rank = np.arange(n) if self.rank is None else np.array(self.rank)

    def view(self) -> ControlView:
        n, h = len(self.pose), len(self.humans)
        target = np.full((n, 2), np.nan)
        goal = np.full((n, 2), np.nan)
        ahead = []
        for i, path in enumerate(self.paths):
            if len(path) == 0:
                ahead.append(NO_PATH)
                continue
            x, y, _ = self.pose[i]
            self.paths[i] = rest = look_along(path, x, y, 0.5)[0]
            ahead.append(rest)
            goal[i] = rest[-1]
            if np.linalg.norm(rest[-1] - self.pose[i, :2]) > 0.1:
                target[i] = look_along(rest, x, y, 0.5)[1:3]
        hits = np.stack([cast(p[:2], p[2], self.walls) for p in self.pose])
        return ControlView(
            time=self.time,
            dt=self.dt,
            pose=self.pose.copy(),
            velocity=self.velocity.copy(),
            target=target,
            goal=goal,
            path=tuple(ahead),
            active=self.active.copy(),
            present=np.ones(n, dtype=bool),
            rank=self.rank,
            obstacle_points=hits,
            human_position=self.humans.copy(),
            human_velocity=self.human_velocity.copy(),
            human_radius=np.full(h, 0.25),
            states_link=self.states.copy(),
            leader_link=self.leader_link.copy(),
            max_speed=np.full(n, self.max_speed),
            max_acceleration=np.full(n, 1.0),
            max_turn_rate=np.full(n, 2.0),
        )

    def step(self, controller):
        view = self.view()
        result = controller.control(view)
        twist = result.command.twist
        change = np.clip(twist - self.velocity, -1e9, 1e9)
        limit = self.engine_acceleration * self.dt
        change[:, :2] = np.clip(change[:, :2], -limit, limit)
        self.velocity = self.velocity + change
        yaw = self.pose[:, 2] + 0.5 * self.dt * self.velocity[:, 2]
        cos, sin = np.cos(yaw), np.sin(yaw)
        v = self.velocity
        self.pose[:, 0] += self.dt * (cos * v[:, 0] - sin * v[:, 1])
        self.pose[:, 1] += self.dt * (sin * v[:, 0] + cos * v[:, 1])
        self.pose[:, 2] += self.dt * v[:, 2]
        self.humans = self.humans + self.dt * self.human_velocity
        self.time += self.dt
        self._measure()
        self.log.append((self.pose.copy(), self.velocity.copy(), result))
        return result

    def _measure(self):
        n = len(self.pose)
        for i in range(n):
            for j in range(i):
                gap = np.linalg.norm(self.pose[i, :2] - self.pose[j, :2])
                self.narrowest_robot = min(self.narrowest_robot, gap)
            c, s = np.cos(self.pose[i, 2]), np.sin(self.pose[i, 2])
            outline = np.concatenate([BODY, (BODY + np.roll(BODY, 1, axis=0)) / 2])
            body = outline @ np.array([[c, s], [-s, c]]) + self.pose[i, :2]
            self.narrowest_wall = min(self.narrowest_wall, edge_distance(body, self.walls).min())
            for k in range(len(self.humans)):
                local = (self.humans[k] - self.pose[i, :2]) @ np.array([[c, -s], [s, c]])
                near = np.clip(local, BODY[0], BODY[2])
                if np.linalg.norm(local - near) < 0.25:
                    speed = np.hypot(*self.velocity[i, :2])
                    self.struck.append((self.time, i, k, speed))

    def run(self, controller, seconds):
        for _ in range(round(seconds / self.dt)):
            self.step(controller)
            if self.arrived().all():
                break
        return self

    def arrived(self):
        return np.array(
            [
                len(p) == 0 or np.linalg.norm(p[-1] - self.pose[i, :2]) < 0.15
                for i, p in enumerate(self.paths)
            ]
        )
