"""A world as the files MRTA-Sim reads, so that a failure found here can be confirmed there."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import yaml

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import World
from simulator_interface.formats.nav2 import write_nav2_map
from simulator_interface.formats.sdf_world import write_sdf

NAMES = {
    "world": "hospital.world",
    "robots": "robot_setup.json",
    "tasks": "testcase.json",
    "people": "humans_waypoint_config.yaml",
    "map": "my_map.yaml",
}


def write_mrta_sim(world: World, costmap: Costmap, directory: Path) -> tuple[Path, ...]:
    """Write Gazebo world, robot setup, test case, people's waypoints and map.

    MRTA-Sim counts in whole seconds: arrivals are rounded up, deadlines down. It has no service
    times, noise, outages or blockages that come and go: those of the world are lost. People
    begin at the first point of their route.

    Args:
        world: what to write.
        costmap: at time 0; MRTA-Sim's map gets the objects of this world, too.
        directory: gets the files; must exist.

    Returns:
        The files.

    Raises:
        PlaceError: a file cannot be written.
    """
    paths = {kind: directory / name for kind, name in NAMES.items()}
    write_sdf(world, paths["world"])
    texts = {
        "robots": json.dumps(robot_setup(world), indent=2) + "\n",
        "tasks": json.dumps(task_stream(world), indent=2) + "\n",
        "people": yaml.safe_dump(
            {human.name: human.route.tolist() for human in world.humans},
            default_flow_style=None,
            sort_keys=False,
        ),
    }
    for kind, text in texts.items():
        write_atomically(paths[kind], text.encode())
    write_nav2_map(costmap, paths["map"])
    return (*paths.values(), paths["map"].with_suffix(".pgm"))


def robot_setup(world: World) -> dict[str, Any]:
    """Make ``agents: {NAME: {start: [x, y, yaw]}}``."""
    return {"agents": {robot.name: {"start": robot.pose.tolist()} for robot in world.robots}}


def task_stream(world: World) -> dict[str, Any]:
    """Make ``tasks_stream`` in order of arrival, and the room nearest to each robot."""
    batches: dict[int, list[dict[str, int]]] = {}
    for task in sorted(world.tasks, key=lambda task: task.arrival):
        entry = {"start": task.start, "end": task.end, "deadline": math.floor(task.deadline)}
        batches.setdefault(math.ceil(task.arrival), []).append(entry)
    agents = [
        min(
            range(len(world.rooms)),
            key=lambda i: math.dist(world.rooms[i].point, robot.pose[:2]),
        )
        for robot in world.robots
        if world.rooms
    ]
    stream = [{"arrival": arrival, "tasks": tasks} for arrival, tasks in batches.items()]
    return {"tasks_stream": stream, "agents": agents}
