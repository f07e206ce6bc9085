"""Logs of a fleet that tests write with ``rosbags``: two robots meet in a corridor for one.

The building is 16 x 4 m, a room at each end and a corridor 1 m wide between them. ``ada`` drives
east and ``bob`` west; they meet at x = 8 at 12 s and stand until the end. ``cyd`` drives to and
fro in the eastern room all the time.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from simulator_interface.formats.rosbag_log import RMF_TYPES

DURATION = 75.0  # s; they have stood for more than a minute then
EVERY = 0.2  # s
MET = 12.0  # s
STORE = get_typestore(Stores.ROS2_HUMBLE)
_types: dict[str, Any] = {}
for _name, _text in RMF_TYPES.items():
    _types.update(get_types_from_msg(_text, _name))
STORE.register(_types)
GOALS = {"ada": (14.0, 2.0), "bob": (2.0, 2.0)}


def pose_at(name: str, time: float) -> tuple[float, float, float]:
    """Where a robot is [m, m, rad]."""
    share = min(time / MET, 1.0)
    if name == "ada":
        return 2.0 + 5.7 * share, 2.0, 0.0
    if name == "bob":
        return 14.0 - 5.7 * share, 2.0, np.pi
    return 14.5, 2.0 + np.sin(0.3 * time), np.pi / 2.0


def _new(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def _stamp(time: float) -> Any:
    return _new("builtin_interfaces/msg/Time", sec=int(time), nanosec=int(time % 1.0 * 1e9))


def _header(time: float, frame: str = "map") -> Any:
    return _new("std_msgs/msg/Header", stamp=_stamp(time), frame_id=frame)


def _point(x: float, y: float, kind: str = "Point") -> Any:
    return _new(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=0.0)


def _turn(yaw: float) -> Any:
    half = 0.5 * yaw
    return _new(
        "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
    )


def _pose(x: float, y: float, yaw: float = 0.0) -> Any:
    return _new("geometry_msgs/msg/Pose", position=_point(x, y), orientation=_turn(yaw))


def _with_covariance(pose: Any) -> Any:
    return _new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36))


def _stamped(time: float, x: float, y: float) -> Any:
    return _new("geometry_msgs/msg/PoseStamped", header=_header(time), pose=_pose(x, y))


def _odometry(name: str, time: float) -> tuple[str, str, Any]:
    still = _new(
        "geometry_msgs/msg/Twist",
        linear=_point(0.0, 0.0, "Vector3"),
        angular=_point(0.0, 0.0, "Vector3"),
    )
    message = _new(
        "nav_msgs/msg/Odometry",
        header=_header(time),
        child_frame_id=f"{name}/base_link",
        pose=_with_covariance(_pose(*pose_at(name, time))),
        twist=_new(
            "geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=np.zeros(36)
        ),
    )  # fmt: skip
    return f"/{name}/odom", "nav_msgs/msg/Odometry", message


def _localised(name: str, time: float) -> tuple[str, str, Any]:
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    pose = _with_covariance(_pose(*pose_at(name, time)))
    return f"/{name}/amcl_pose", kind, _new(kind, header=_header(time), pose=pose)


def _status(name: str) -> tuple[str, str, Any]:
    return f"/{name}/status", "std_msgs/msg/String", _new("std_msgs/msg/String", data="NAVIGATING")


def _transforms(time: float, names: list[str], between: str = "/") -> tuple[str, str, Any]:
    """TF with odometry's frame in between, shifted by 1 m and turned by 90 degrees."""
    rows = []
    for name in names:
        x, y, yaw = pose_at(name, time)
        for parent, child, place in (
            ("map", f"{name}{between}odom", (1.0, 0.0, np.pi / 2.0)),
            (
                f"{name}{between}odom",
                f"{name}{between}base_link",
                (y, 1.0 - x, yaw - np.pi / 2.0),
            ),
            (f"{name}{between}base_link", f"{name}{between}arm_base_link", (0.2, 0.0, 0.0)),
        ):
            move = _new(
                "geometry_msgs/msg/Transform",
                translation=_point(place[0], place[1], "Vector3"),
                rotation=_turn(place[2]),
            )
            rows.append(
                _new(
                    "geometry_msgs/msg/TransformStamped",
                    header=_header(time, parent),
                    child_frame_id=child,
                    transform=move,
                )
            )
    return "/tf", "tf2_msgs/msg/TFMessage", _new("tf2_msgs/msg/TFMessage", transforms=rows)


def _fleet(time: float, names: list[str]) -> tuple[str, str, Any]:
    def location(x: float, y: float, yaw: float) -> Any:
        return _new(
            "rmf_fleet_msgs/msg/Location",
            t=_stamp(time), x=x, y=y, yaw=yaw, obey_approach_speed_limit=False,
            approach_speed_limit=0.0, level_name="L1", index=0,
        )  # fmt: skip

    robots = [
        _new(
            "rmf_fleet_msgs/msg/RobotState",
            name=name, model="tiny", task_id="", seq=0,
            mode=_new("rmf_fleet_msgs/msg/RobotMode", mode=2, mode_request_id=0,
                      performing_action=""),
            battery_percent=90.0, location=location(*pose_at(name, time)),
            path=[location(*GOALS[name], 0.0)] if name in GOALS else [],
        )
        for name in names
    ]  # fmt: skip
    kind = "rmf_fleet_msgs/msg/FleetState"
    return "/fleet_states", kind, _new(kind, name="tiny", robots=robots)


def _path(name: str, time: float) -> tuple[str, str, Any]:
    x, y, _ = pose_at(name, time)
    poses = [_stamped(time, *point) for point in np.linspace((x, y), GOALS[name], 20)]
    kind = "nav_msgs/msg/Path"
    return f"/{name}/plan", kind, _new(kind, header=_header(time), poses=poses)


def _map() -> tuple[str, str, Any]:
    resolution = 0.1
    data = np.full((44, 164), 100, dtype=np.int8)
    data[2:42, 2:42] = 0
    data[2:42, 122:162] = 0
    data[17:27, 42:122] = 0
    kind = "nav_msgs/msg/OccupancyGrid"
    info = _new(
        "nav_msgs/msg/MapMetaData",
        map_load_time=_stamp(0.0), resolution=resolution, width=164, height=44,
        origin=_pose(-0.2, -0.2),
    )  # fmt: skip
    return "/map", kind, _new(kind, header=_header(0.0), info=info, data=data.ravel())


def _moves(name: str, time: float) -> bool:
    return name not in GOALS or time <= MET


def messages(kind: str, until: float = DURATION) -> list[tuple[float, str, str, Any]]:
    """List the messages of a log: time [s], topic, type, message.

    Args:
        kind: ``odometry`` (with goals and a map), ``tf`` (with plans and a map), ``poses`` (no
            goals, with a map), ``motion`` (the same by AMCL: only while a robot moves, and a status
            to the end), ``flat`` (``tf`` with frames as ``ada_base_link``), ``fleet`` (Open-RMF's,
            no map).
        until: when it ends [s].
    """
    names = ["ada", "bob", "cyd"]
    rows: list[tuple[float, str, str, Any]] = []
    if kind != "fleet":
        rows.append((0.0, *_map()))
    for time in np.arange(0.0, until, EVERY).tolist():
        if kind == "odometry":
            rows += [(time, *_odometry(name, time)) for name in names]
        elif kind == "poses":
            rows += [(time, *_localised(name, time)) for name in names]
        elif kind == "motion":
            rows += [(time, *_localised(name, time)) for name in names if _moves(name, time)]
            rows += [(time, *_status(name)) for name in names]
        elif kind in ("tf", "flat"):
            rows.append((time, *_transforms(time, names, "/" if kind == "tf" else "_")))
        else:
            rows.append((time, *_fleet(time, names)))
    for name, goal in GOALS.items():
        if kind == "odometry":
            goal_pose = _stamped(1.0, *goal)
            rows.append((1.0, f"/{name}/goal_pose", "geometry_msgs/msg/PoseStamped", goal_pose))
        if kind in ("tf", "flat"):
            rows += [(time, *_path(name, time)) for time in (0.5, 5.5)]
    return sorted(rows, key=lambda row: (row[0], row[1]))


def write(
    path: Path,
    kind: str,
    storage: str,
    until: float = DURATION,
    *,
    packed: CompressionMode = CompressionMode.NONE,
    only: Callable[[float, str], bool] = lambda time, topic: True,
) -> Path:
    """Write a log as a rosbag2 folder.

    Args:
        path: the folder.
        kind: as :func:`messages` has it.
        storage: ``mcap`` or ``sqlite3``.
        until: when it ends [s].
        packed: what is compressed by zstd.
        only: messages that are written, by time and topic.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    bag = Writer(path, version=9, storage_plugin=plugin)
    if packed is not CompressionMode.NONE:
        bag.set_compression(packed, CompressionFormat.ZSTD)
    with bag:
        topics: dict[str, Any] = {}
        for time, topic, msgtype, message in messages(kind, until):
            if not only(time, topic):
                continue
            if topic not in topics:
                topics[topic] = bag.add_connection(topic, msgtype, typestore=STORE)
            raw = STORE.serialize_cdr(message, msgtype)
            bag.write(topics[topic], int(1.7e18 + time * 1e9), raw)
    return path
