"""A run as an MCAP file with ROS 2 messages: opens in Foxglove, reads with ``rosbags``.

Topics: ``/tf`` (map to every robot and person), ``/ROBOT/odom``, ``/ROBOT/plan``, ``/map`` (once),
``/markers`` (walls, furniture, people, arrows to whom a robot waits for), ``/events`` (the event
table as text).
Times count from 0, the start of the episode.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.durable import replacing
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World
from simulator_interface.formats.nav2 import occupancy_of

if TYPE_CHECKING:
    from mcap.records import Schema

RATE = 10.0  # Hz of poses and markers
TYPES = {
    "tf": "tf2_msgs/msg/TFMessage",
    "odom": "nav_msgs/msg/Odometry",
    "plan": "nav_msgs/msg/Path",
    "map": "nav_msgs/msg/OccupancyGrid",
    "markers": "visualization_msgs/msg/MarkerArray",
    "events": "std_msgs/msg/String",
}
ARROW, CYLINDER, LINE_STRIP, TEXT = 0, 3, 4, 9  # visualization_msgs/Marker types
ADD, DELETE = 0, 2  # and actions
WAIT_COLOUR = (0.8, 0.1, 0.1, 1.0)
Message = dict[str, Any]


def write_mcap(world: World, trace: Trace, costmap: Costmap, path: Path) -> None:
    """Write a run.

    Args:
        world: of the run.
        trace: of the run, with its columns.
        costmap: at time 0.
        path: the ``.mcap`` file.

    Raises:
        ConfigError: the extra ``mcap`` is not installed.
        PlaceError: the file cannot be written.
    """
    try:
        from mcap_ros2.writer import Writer  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            "--format mcap needs the extra `mcap`; in the checkout: pip install '.[mcap]'"
        ) from None
    known = get_typestore(Stores.ROS2_HUMBLE)
    with replacing(path) as file:
        writer = Writer(file)
        schemas: dict[str, Schema] = {}
        for name, kind in TYPES.items():
            text, _ = known.generate_msgdef(kind, ros_version=2)
            schemas[name] = writer.register_msgdef(kind, text)
        for time, topic, kind, message in sorted(
            _messages(world, trace, costmap), key=lambda row: (row[0], row[1])
        ):
            stamp = round(time * 1e9)
            writer.write_message(topic, schemas[kind], message, stamp, stamp)
        writer.finish()  # type: ignore[no-untyped-call]


def _messages(
    world: World, trace: Trace, costmap: Costmap
) -> Iterator[tuple[float, str, str, Message]]:
    stride = max(1, round(1.0 / (RATE * trace.dt)))
    yield 0.0, "/map", "map", _map(costmap)
    for tick in range(0, len(trace), stride):
        time = float(trace.columns["time"][tick])
        yield time, "/tf", "tf", _transforms(world, trace, tick, time)
        yield time, "/markers", "markers", _markers(world, trace, tick, time, with_solids=tick == 0)
        for i, name in enumerate(trace.robots):
            yield time, f"/{name}/odom", "odom", _odometry(trace, tick, i, time)
    for change in trace.paths:
        name = trace.robots[change.robot]
        time = change.tick * trace.dt
        yield time, f"/{name}/plan", "plan", _plan(change.points, time)
    for event in trace.events:
        text = json.dumps(codec.encode(event), sort_keys=True)
        yield event.time, "/events", "events", {"data": text}


def _header(time: float, frame: str = "map") -> Message:
    seconds = int(time)
    return {
        "stamp": {"sec": seconds, "nanosec": round((time - seconds) * 1e9)},
        "frame_id": frame,
    }


def _point(x: float, y: float, z: float = 0.0) -> Message:
    return {"x": float(x), "y": float(y), "z": float(z)}


def _turn(yaw: float) -> Message:
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(yaw / 2.0)), "w": float(np.cos(yaw / 2.0))}


def _pose(x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> Message:
    return {"position": _point(x, y, z), "orientation": _turn(yaw)}


def _transforms(world: World, trace: Trace, tick: int, time: float) -> Message:
    rows = []
    for name, (x, y, yaw) in zip(trace.robots, trace.columns["pose"][tick], strict=True):
        rows.append((f"{name}/base_link", x, y, yaw))
    for human, (x, y) in zip(world.humans, trace.columns["human_position"][tick], strict=True):
        if np.isfinite(x):
            rows.append((human.name, x, y, 0.0))
    return {
        "transforms": [
            {
                "header": _header(time),
                "child_frame_id": frame,
                "transform": {"translation": _point(x, y), "rotation": _turn(yaw)},
            }
            for frame, x, y, yaw in rows
        ]
    }


def _odometry(trace: Trace, tick: int, robot: int, time: float) -> Message:
    x, y, yaw = trace.columns["pose"][tick, robot]
    forward, left, turn = trace.columns["velocity"][tick, robot]
    return {
        "header": _header(time),
        "child_frame_id": f"{trace.robots[robot]}/base_link",
        "pose": {"pose": _pose(x, y, yaw), "covariance": [0.0] * 36},
        "twist": {
            "twist": {"linear": _point(forward, left), "angular": _point(0.0, 0.0, turn)},
            "covariance": [0.0] * 36,
        },
    }


def _plan(points: Array, time: float) -> Message:
    return {
        "header": _header(time),
        "poses": [{"header": _header(time), "pose": _pose(x, y)} for x, y in points],
    }


def _map(costmap: Costmap) -> Message:
    grid = occupancy_of(costmap)
    rows, cols = grid.data.shape
    x, y = costmap.origin
    return {
        "header": _header(0.0),
        "info": {
            "map_load_time": {"sec": 0, "nanosec": 0},
            "resolution": float(costmap.resolution),
            "width": cols,
            "height": rows,
            "origin": _pose(x, y),
        },
        "data": grid.data.astype(np.int8).ravel().tolist(),
    }


def _markers(world: World, trace: Trace, tick: int, time: float, *, with_solids: bool) -> Message:
    markers = []
    people = trace.columns["human_position"][tick]
    for i, (human, (x, y)) in enumerate(zip(world.humans, people, strict=True)):
        marker = _marker(time, "people", i, CYLINDER, (0.4, 0.4, 0.5, 1.0))
        marker["pose"] = _pose(x, y, z=0.85) if np.isfinite(x) else _pose(0.0, 0.0)
        marker["action"] = 0 if np.isfinite(x) else 2
        marker["scale"] = _point(2.0 * human.radius, 2.0 * human.radius, 1.7)
        markers.append(marker)
    markers += _waits(trace, tick, time)
    if with_solids:
        for i, outline in enumerate(world.solid_polygons()):
            marker = _marker(time, "solids", i, LINE_STRIP, (0.2, 0.2, 0.25, 1.0))
            marker["scale"] = _point(0.03, 0.0)
            marker["points"] = [_point(x, y) for x, y in (*outline, outline[0])]
            markers.append(marker)
    return {"markers": markers}


def _waits(trace: Trace, tick: int, time: float) -> Iterator[Message]:
    """Mark who waits for whom: an arrow to the one waited for, and the cause in words.

    Each robot has the first of its edges; its markers are deleted while it waits for nobody.
    """
    edges: dict[int, BlockedBy] = {}
    for edge in trace.edges_at(tick):
        if edge.cause != "task":
            edges.setdefault(edge.robot, edge)
    poses, people = trace.columns["pose"][tick], trace.columns["human_position"][tick]
    for robot in range(len(trace.robots)):
        arrow = _marker(time, "waits_for", robot, ARROW, WAIT_COLOUR)
        text = _marker(time, "waits_why", robot, TEXT, WAIT_COLOUR)
        waited = edges.get(robot)
        x, y = poses[robot, :2]
        if waited is not None and waited.other >= 0:
            end = people[waited.other] if waited.cause == "human" else poses[waited.other, :2]
            arrow["scale"] = _point(0.06, 0.16, 0.2)  # shaft, head, length of the head [m]
            arrow["points"] = [_point(x, y, 0.3), _point(end[0], end[1], 0.3)]
        if waited is not None:
            text["pose"] = _pose(x, y, z=0.8)
            text["scale"] = _point(0.0, 0.0, 0.25)  # height of the letters [m]
            text["text"] = " ".join(part for part in (waited.cause, waited.resource) if part)
        arrow["action"] = ADD if arrow["points"] else DELETE
        text["action"] = ADD if text["text"] else DELETE
        yield arrow
        yield text


def _marker(
    time: float, group: str, number: int, kind: int, colour: tuple[float, float, float, float]
) -> Message:
    red, green, blue, alpha = colour
    return {
        "header": _header(time),
        "ns": group,
        "id": number,
        "type": kind,
        "action": 0,
        "pose": _pose(0.0, 0.0),
        "scale": _point(1.0, 1.0, 1.0),
        "color": {"r": red, "g": green, "b": blue, "a": alpha},
        "lifetime": {"sec": 0, "nanosec": 0},
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": {"header": _header(time, ""), "format": "", "data": b""},
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": b""},
        "mesh_use_embedded_materials": False,
    }
