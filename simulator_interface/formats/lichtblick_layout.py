"""A layout for Lichtblick (and Foxglove): the floor with who waits for whom, speeds, events.

It belongs to a run written by :mod:`~simulator_interface.formats.mcap`; import it there under
Layouts, once for a fleet.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import World

FIELD_OF_VIEW = 45  # deg
MARGIN = 1.3  # times the size of the floor that the camera sees


def write_layout(world: World, path: Path) -> None:
    """Write the layout of a run as JSON.

    Args:
        world: of the run.
        path: the ``.json`` file.

    Raises:
        PlaceError: the file cannot be written.
    """
    write_atomically(path, (json.dumps(layout_of(world), indent=1) + "\n").encode())


def layout_of(world: World) -> dict[str, Any]:
    """Describe the panels of a run: the floor from above, speeds of the robots, events."""
    robots = [robot.name for robot in world.robots]
    return {
        "configById": {
            "3D!floor": _floor(world, robots),
            "Plot!speed": {
                "title": "speed [m/s]",
                "paths": [
                    {
                        "value": f"/{name}/odom.twist.twist.linear.x",
                        "label": name,
                        "enabled": True,
                        "timestampMethod": "receiveTime",
                    }
                    for name in robots
                ],
                "xAxisVal": "timestamp",
                "isSynced": True,
                "showLegend": True,
            },
            "RawMessages!events": {"topicPath": "/events"},
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 2},
        "layout": {
            "direction": "row",
            "first": "3D!floor",
            "second": {
                "direction": "column",
                "first": "Plot!speed",
                "second": "RawMessages!events",
                "splitPercentage": 60,
            },
            "splitPercentage": 65,
        },
    }


def _floor(world: World, robots: list[str]) -> dict[str, Any]:
    """Look straight down at the middle of the floor; a free camera is moved by its offset."""
    x_min, y_min, x_max, y_max = map(float, world.bounds)
    shown = {"/map", "/markers", "/tf", *(f"/{name}/plan" for name in robots)}
    hidden = {f"/{name}/odom" for name in robots}
    topics = {name: {"visible": name in shown} for name in sorted(shown | hidden)}
    return {
        "followMode": "follow-none",
        "followTf": "map",
        "cameraState": {
            "distance": MARGIN * max(x_max - x_min, y_max - y_min),
            "perspective": False,
            "phi": 0,
            "thetaOffset": 0,
            "target": [0, 0, 0],
            "targetOffset": [(x_min + x_max) / 2.0, (y_min + y_max) / 2.0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": FIELD_OF_VIEW,
            "near": 0.5,
            "far": 5000,
        },
        "scene": {"transforms": {"showLabel": True, "axisScale": 0.5, "lineWidth": 0}},
        "transforms": {},
        "topics": topics,
        "layers": {},
    }
