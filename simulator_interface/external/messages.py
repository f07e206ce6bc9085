"""What the harness tells a stack in another process: the world once, then one message a tick.

Arrays are float64, little-endian, in C order; their shapes are fixed by the protocol. N robots,
H people, A obstacle points per robot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.world import RobotSpec, Task, World

PROTOCOL = (1, 1)  # major, minor
ENCODINGS = ("msgpack", "json")

#: fields of a robot that its stack may know; noise, slip and latency are not among them
ROBOT_FIELDS = (
    "name",
    "model",
    "pose",
    "radius",
    "max_speed",
    "max_acceleration",
    "max_turn_rate",
    "capacity",
    "joins_at",
    "cruise_speed",
)

Message = dict[str, Any]

_TOLD = tuple(field.name for field in dataclasses.fields(FleetState))


def hello(version: str) -> Message:
    """Begin the handshake; it is JSON whatever encoding follows.

    Args:
        version: of the harness.
    """
    return {
        "type": "hello",
        "protocol": list(PROTOCOL),
        "encodings": list(ENCODINGS),
        "harness": f"mrta-falsify {version}",
    }


def world_message(
    world: World,
    dt: float,
    costmap: Costmap,
    params: Mapping[str, Any],
    *,
    tasks_ahead: bool = False,
) -> Message:
    """Tell all that a stack may know before the start: no event, no person's route.

    Args:
        world: of the episode.
        dt: control period [s].
        costmap: of the building at time 0.
        params: that the user gave for the stack.
        tasks_ahead: whether all tasks are told, with their arrival.
    """
    told = [
        {**task_message(number, task), "arrival": task.arrival}
        for number, task in enumerate(world.tasks)
    ]
    return {
        **({"tasks": told} if tasks_ahead else {}),
        "type": "world",
        "name": world.name,
        "seed": world.seed,
        "dt": dt,
        "horizon": world.horizon,
        "bounds": world.bounds.tolist(),
        "robots": [_robot(robot) for robot in world.robots],
        "humans": [{"name": human.name, "radius": human.radius} for human in world.humans],
        "rooms": codec.encode(world.rooms),
        "lanes": codec.encode(world.lanes),
        "resources": codec.encode(world.resources),
        "walls": [{"name": w.name, "polygon": w.polygon.tolist()} for w in world.walls],
        "furniture": [
            {"name": f.name, "kind": f.kind, "polygon": f.polygon.tolist(), "movable": f.movable}
            for f in world.furniture
        ],
        "parking": world.parking.tolist(),
        "travel_times": world.travel_times.tolist(),
        "map": map_message(costmap),
        "params": dict(params),
    }


def map_message(costmap: Costmap) -> Message:
    """Tell a costmap; row 0 of its bytes is the southernmost."""
    rows, cols = costmap.cost.shape
    return {
        "resolution": costmap.resolution,
        "origin": costmap.origin.tolist(),
        "rows": rows,
        "cols": cols,
        "cost": costmap.cost,
    }


def _robot(robot: RobotSpec) -> Message:
    return {name: codec.encode(getattr(robot, name)) for name in ROBOT_FIELDS}


def tick_message(
    fleet: FleetState,
    tasks: Iterable[Message],
    refused: Iterable[Message],
    links: Message | None,
    *,
    closed: bool,
) -> Message:
    """Tell what the sensors say, and what is new.

    Args:
        fleet: as localised.
        tasks: that have just arrived.
        refused: claims of the last tick that do not count, and why.
        links: which of each robot's links are up, None: as before.
        closed: whether no task will arrive any more.
    """
    message: Message = {
        "type": "tick",
        **{name: getattr(fleet, name) for name in _TOLD},
        "tasks": list(tasks),
        "refused": list(refused),
        "closed": closed,
    }
    if links is not None:
        message["links"] = links
    return message


def task_message(number: int, task: Task) -> Message:
    """Tell of a task."""
    return {
        "task": number,
        "start": task.start,
        "end": task.end,
        "deadline": task.deadline,
        "pickup_time": task.pickup_time,
        "dropoff_time": task.dropoff_time,
        "robot": task.robot,
    }


# --- encodings ------------------------------------------------------------------------------


def plain(value: Any, *, binary: bool) -> Any:
    """Write numpy arrays as bytes, or as nested lists with null for what is not finite.

    Args:
        value: message, or a part of one.
        binary: whether arrays become bytes.
    """
    if isinstance(value, np.ndarray):
        return _bytes(value) if binary else _lists(value)
    if isinstance(value, dict):
        return {key: plain(item, binary=binary) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, binary=binary) for item in value]
    if isinstance(value, float) and not binary and not np.isfinite(value):
        return None
    return value


def _bytes(array: np.ndarray) -> bytes:
    kind = "u1" if array.dtype.kind in "bu" else "<f8"
    return np.ascontiguousarray(array, dtype=kind).tobytes()


def _lists(array: Array | np.ndarray) -> Any:
    if array.dtype.kind != "f":
        return array.tolist()
    listed = np.where(np.isfinite(array), array, np.nan).astype(object)
    listed[np.isnan(array) | np.isinf(array)] = None
    return listed.tolist()
