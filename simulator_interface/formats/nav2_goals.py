"""The starts and goals of a world's robots, as Nav2 takes them: poses in the frame ``map``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import World


def write_goals(world: World, path: Path) -> None:
    """Write ``initial_poses`` by robot and ``tasks`` with the poses of both rooms.

    ``initial_poses`` are what goes to ``initialpose`` (x, y [m], yaw [rad]); ``pickup`` and
    ``dropoff`` what goes to ``navigate_to_pose``, whatever the heading.

    Args:
        world: whose robots and tasks.
        path: of the YAML file.

    Raises:
        PlaceError: the file cannot be written.
    """
    write_atomically(path, yaml.safe_dump(goals_of(world), sort_keys=False).encode())


def goals_of(world: World) -> dict[str, Any]:
    """Make the data of the file."""
    poses = [{"x": float(room.point[0]), "y": float(room.point[1])} for room in world.rooms]
    return {
        "frame_id": "map",
        "initial_poses": {
            robot.name: dict(zip(("x", "y", "yaw"), map(float, robot.pose), strict=True))
            for robot in world.robots
        },
        "tasks": [
            {
                "arrival_s": task.arrival,
                "deadline_s": task.deadline,
                "pickup": {"room": world.rooms[task.start].name, **poses[task.start]},
                "dropoff": {"room": world.rooms[task.end].name, **poses[task.end]},
                **({"robot": task.robot} if task.robot else {}),
            }
            for task in world.tasks
        ],
    }
