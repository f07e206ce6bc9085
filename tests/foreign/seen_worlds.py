"""Messages of the door, made by hand: what a stack of a few robots is told."""

from __future__ import annotations

import math

import numpy as np

RAYS = 12
WALL = 2.0  # m from each robot to what its rays hit, at tick 0
FURTHER = 0.001  # m per tick
AHEAD = 0.01  # m that each robot drives per tick
DT = 0.05  # s


def world_seen(robots: int) -> dict:
    """Tell of robots 10 m apart, and a map of 3 x 4 cells: solid, unknown, free."""
    return {
        "dt": DT,
        "rooms": [{"name": "west", "point": [0.0, 1.0]}, {"name": "east", "point": [9.0, 1.0]}],
        "robots": [{"name": f"robot{i + 1}", "radius": 0.2} for i in range(robots)],
        "map": {
            "resolution": 0.1,
            "origin": [-1.0, -2.0],
            "rows": 3,
            "cols": 4,
            "cost": bytes([254] * 5 + [255] * 2 + [0, 100, 252, 253, 0]),
        },
    }


def tick_seen(number: int, robots: int, **changes) -> dict:
    """Tell of robots that drive along x, each within a round wall of its own."""
    x = 10.0 * np.arange(robots) + AHEAD * number
    pose = np.stack([x, np.zeros(robots), np.zeros(robots)], axis=1)
    angles = np.arange(RAYS) * 2.0 * math.pi / RAYS
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    tick = {
        "tick": number,
        "time": number * DT,
        "pose": pose,
        "velocity": np.tile((AHEAD / DT, 0.0, 0.0), (robots, 1)),
        "human_position": np.zeros((0, 2)),
        "human_velocity": np.zeros((0, 2)),
        "human_radius": np.zeros(0),
        "obstacle_points": pose[:, None, :2] + (WALL + FURTHER * number) * rays,
        "tasks": [],
    }
    return {**tick, **changes}
