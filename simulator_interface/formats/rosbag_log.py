"""Logs of ROS 2 as fleets: rosbag2 folders, and single ``.mcap`` and ``.db3`` files.

Read are poses (TF, PoseStamped, PoseWithCovarianceStamped, Odometry, rmf_fleet_msgs/FleetState and
RobotState), goals (PoseStamped on a topic whose last name has ``goal``), paths and maps. A robot is
named by its topics' namespace, its TF frames' prefix, or FleetState. Where several topics tell
poses, the best is taken: FleetState, TF to ``map``, poses, odometry.

Times are those of the recording; with ``/clock`` they are simulation time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import ConfigError, FormatError, InputError
from simulator_interface.formats.fleet_log import FleetLog, RobotLog, thinned
from simulator_interface.formats.nav2 import OccupancyGrid

ENDINGS = (".mcap", ".db3")
METADATA = "metadata.yaml"
POSES_EVERY = 0.05  # s; more is not kept
MOST_MESSAGES = 20_000_000
BASES = ("base_link", "base_footprint")
ALONE = "robot"  # name of a robot whose topics have no namespace
#: sources of poses, the best first
SOURCES = ("fleet states", "TF", "poses", "odometry")

#: Open-RMF's messages, for bags that do not hold their definitions
RMF_TYPES = {
    "rmf_fleet_msgs/msg/Location": (
        "builtin_interfaces/Time t\nfloat32 x\nfloat32 y\nfloat32 yaw\n"
        "bool obey_approach_speed_limit\nfloat32 approach_speed_limit\n"
        "string level_name\nuint64 index"
    ),
    "rmf_fleet_msgs/msg/RobotMode": (
        "uint32 mode\nuint64 mode_request_id\nstring performing_action"
    ),
    "rmf_fleet_msgs/msg/RobotState": (
        "string name\nstring model\nstring task_id\nuint64 seq\nRobotMode mode\n"
        "float32 battery_percent\nLocation location\nLocation[] path"
    ),
    "rmf_fleet_msgs/msg/FleetState": "string name\nRobotState[] robots",
}


def is_bag(path: Path) -> bool:
    """Whether a path is named as a log of ROS 2 is."""
    return path.suffix.lower() in ENDINGS or (path.is_dir() and (path / METADATA).is_file())


def read_bag(path: Path) -> FleetLog:
    """Read a log.

    Args:
        path: a rosbag2 folder, or a ``.mcap`` or ``.db3`` file.

    Raises:
        ConfigError: the extra ``mcap`` is not installed.
        FormatError: it cannot be read, is damaged, or tells no robot's poses.
    """
    if not path.exists():
        raise FormatError(f"{path}: cannot be read: there is no such file or folder")
    if (path / METADATA).is_file():
        codec.read_yaml(path / METADATA, doubled="last")  # refuses what would hang the library
    seen = _Seen()
    try:
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            "reading logs of ROS 2 needs the extra `mcap`; in the checkout: pip install '.[mcap]'"
        ) from None
    try:
        with Reader(path) as bag:
            store = get_typestore(Stores.ROS2_HUMBLE)
            wanted = [c for c in bag.connections if c.msgtype in _HEARD]
            _learn(store, wanted)
            for count, (connection, stamp, raw) in enumerate(bag.messages(wanted)):
                if count > MOST_MESSAGES:
                    raise FormatError(f"{path}: holds more than {MOST_MESSAGES} messages")
                message = store.deserialize_cdr(raw, connection.msgtype)
                _HEARD[connection.msgtype](seen, connection.topic, 1e-9 * stamp, message)
    except InputError:
        raise
    except Exception as error:
        said = str(error).splitlines() or [type(error).__name__]
        raise FormatError(f"{path}: is damaged, or no log of ROS 2: {said[0][:200]}") from None
    return seen.log(path)


def _learn(store: Any, connections: list[Any]) -> None:
    """Give the store Open-RMF's types, as the log defines them if it does."""
    from rosbags.typesys import get_types_from_msg  # noqa: PLC0415 - an extra

    types: dict[str, Any] = {}
    for name, text in RMF_TYPES.items():
        types.update(get_types_from_msg(text, name))
    for connection in connections:
        definition = connection.msgdef
        if connection.msgtype in RMF_TYPES and definition.format.name == "MSG":
            types.update(get_types_from_msg(definition.data, connection.msgtype))
    known = {name: fields for name, fields in types.items() if name not in store.fielddefs}
    store.register(known)


# --- what is heard ---------------------------------------------------------------------------


@dataclass(slots=True)
class _Track:
    """Poses of one robot from one source."""

    times: list[float] = field(default_factory=list)
    poses: list[tuple[float, float, float]] = field(default_factory=list)

    def add(self, time: float, pose: tuple[float, float, float]) -> None:
        if all(map(math.isfinite, pose)) and max(map(abs, pose)) < 1e6:
            self.times.append(time)
            self.poses.append(pose)


@dataclass(slots=True)
class _Seen:
    """Everything that the messages told so far."""

    tracks: dict[str, dict[str, _Track]] = field(default_factory=dict)  #: by robot and source
    goals: dict[str, list[tuple[float, Array]]] = field(default_factory=dict)
    paths: dict[str, list[tuple[float, Array]]] = field(default_factory=dict)
    grids: dict[str, OccupancyGrid] = field(default_factory=dict)  #: by topic
    frames: dict[tuple[str, str], tuple[str, tuple[float, float, float]]] = field(
        default_factory=dict
    )  #: by namespace and frame: its parent, and its pose in it
    clock: list[tuple[float, float]] = field(default_factory=list)  #: recorded and simulated [s]
    levels: dict[str, int] = field(default_factory=dict)  #: poses by level name

    def add_pose(
        self, robot: str, source: str, time: float, pose: tuple[float, float, float]
    ) -> None:
        self.tracks.setdefault(robot, {}).setdefault(source, _Track()).add(time, pose)

    def add_path(self, robot: str, time: float, points: list[tuple[float, float]]) -> None:
        if points and np.isfinite(points).all():
            self.paths.setdefault(robot, []).append((time, frozen_array(points)))

    def log(self, path: Path) -> FleetLog:
        """Put together what was heard."""
        chosen = {
            robot: best
            for robot, tracks in sorted(self.tracks.items())
            if (best := self._best(tracks)) is not None
        }
        if not chosen:
            raise FormatError(
                f"{path}: tells no robot's poses; it needs Odometry, PoseStamped, "
                "PoseWithCovarianceStamped, TF to a base_link, or Open-RMF's FleetState"
            )
        begin = min(self._time(track.times[0]) for _, track in chosen.values())
        end = max(self._time(track.times[-1]) for _, track in chosen.values())
        robots = []
        for robot, (source, track) in chosen.items():
            times = np.array([self._time(time) - begin for time in track.times])
            order = np.argsort(times, kind="stable")
            kept = order[thinned(times[order], POSES_EVERY)]
            robots.append(
                RobotLog(
                    name=robot,
                    time=frozen_array(times[kept]),
                    pose=frozen_array(np.array(track.poses)[kept]),
                    source=source,
                    goals=self._since(self.goals.get(robot, []), begin),
                    paths=self._since(self.paths.get(robot, []), begin),
                )
            )
        sources = {source: [r.name for r in robots if r.source == source] for source in SOURCES}
        notes = [
            f"poses of {', '.join(names) if len(names) < len(robots) else 'all'} are from {source}"
            for source, names in sources.items()
            if names
        ]
        if len(self.levels) > 1:
            said = ", ".join(f"{name} ({count} poses)" for name, count in self.levels.items())
            notes.append(f"the log has several levels, taken for one: {said}")
        return FleetLog(
            robots=tuple(robots), grid=self._grid(), duration=end - begin, notes=tuple(notes)
        )

    def _since(
        self, rows: list[tuple[float, Array]], begin: float
    ) -> tuple[tuple[float, Array], ...]:
        found = [(self._time(time) - begin, points) for time, points in rows]
        return tuple(sorted(found, key=lambda row: row[0]))

    def _time(self, recorded: float) -> float:
        if len(self.clock) < 2:
            return recorded
        recorded_at, simulated = np.array(self.clock).T
        return float(np.interp(recorded, recorded_at, simulated))

    @staticmethod
    def _best(tracks: dict[str, _Track]) -> tuple[str, _Track] | None:
        for source in SOURCES:
            if source in tracks and tracks[source].times:
                return source, tracks[source]
        return None

    def _grid(self) -> OccupancyGrid | None:
        """Choose the map: of the topics the one called ``map``, a costmap last."""
        if not self.grids:
            return None

        def rank(topic: str) -> tuple[bool, bool, str]:
            return "costmap" in topic, topic.rpartition("/")[2] != "map", topic

        return self.grids[min(self.grids, key=rank)]


def _owner(topic: str) -> str:
    """Name the robot that a topic belongs to, by its namespace."""
    return topic.strip("/").rpartition("/")[0] or ALONE


def _yaw(turn: Any) -> float:
    return math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)
    )


def _pose(pose: Any) -> tuple[float, float, float]:
    return float(pose.position.x), float(pose.position.y), _yaw(pose.orientation)


def _heard_odometry(seen: _Seen, topic: str, time: float, message: Any) -> None:
    seen.add_pose(_owner(topic), "odometry", time, _pose(message.pose.pose))


def _heard_pose(seen: _Seen, topic: str, time: float, message: Any) -> None:
    if "goal" in topic.rpartition("/")[2]:
        x, y, _ = _pose(message.pose)
        if math.isfinite(x) and math.isfinite(y):
            seen.goals.setdefault(_goal_owner(topic), []).append((time, frozen_array([x, y])))
    else:
        seen.add_pose(_owner(topic), "poses", time, _pose(message.pose))


def _goal_owner(topic: str) -> str:
    owner = _owner(topic)
    return owner.removesuffix("/move_base_simple").removesuffix("move_base_simple") or ALONE


def _heard_covariance(seen: _Seen, topic: str, time: float, message: Any) -> None:
    if topic.rpartition("/")[2] != "initialpose":  # where an operator put it
        seen.add_pose(_owner(topic), "poses", time, _pose(message.pose.pose))


def _heard_path(seen: _Seen, topic: str, time: float, message: Any) -> None:
    points = [(p.pose.position.x, p.pose.position.y) for p in message.poses]
    seen.add_path(_owner(topic), time, points)


def _heard_map(seen: _Seen, topic: str, time: float, message: Any) -> None:
    info = message.info
    data = np.asarray(message.data, dtype=np.int8)
    if data.size != info.width * info.height or not data.size or not info.resolution > 0.0:
        raise FormatError(
            f"{topic}: has {data.size} cells for {info.width} x {info.height} of "
            f"{info.resolution:g} m; a map has one value a cell"
        )
    if ((data > 0) & (data < 100)).any():  # a costmap: only its lethal cells are solid
        data = np.where(data == 100, 100, np.where(data < 0, -1, 0)).astype(np.int8)
    x, y, yaw = _pose(info.origin)
    seen.grids[topic] = OccupancyGrid(
        data=data.reshape(info.height, info.width),
        resolution=float(np.round(info.resolution, 6)),
        origin=frozen_array([x, y]),
        yaw=yaw,
    )


def _heard_transforms(seen: _Seen, topic: str, time: float, message: Any) -> None:
    space = topic.strip("/").rpartition("/")[0]
    for row in message.transforms:
        child, parent = (f.strip("/") for f in (row.child_frame_id, row.header.frame_id))
        move = row.transform
        place = float(move.translation.x), float(move.translation.y), _yaw(move.rotation)
        seen.frames[space, child] = parent, place
        prefix, _, last = child.rpartition("/")
        if last in BASES:
            pose = _in_map(seen, space, child)
            if pose is not None:
                seen.add_pose(prefix or space or ALONE, "TF", time, pose)


def _in_map(seen: _Seen, space: str, frame: str) -> tuple[float, float, float] | None:
    """Find the pose of a frame in ``map``; None: it does not hang on it."""
    x, y, yaw = 0.0, 0.0, 0.0
    for _ in range(10):
        if frame.rpartition("/")[2] == "map":
            return x, y, yaw
        if (space, frame) not in seen.frames:
            return None
        frame, (dx, dy, turn) = seen.frames[space, frame]
        cos, sin = math.cos(turn), math.sin(turn)
        x, y, yaw = dx + cos * x - sin * y, dy + sin * x + cos * y, yaw + turn
    return None


def _heard_fleet(seen: _Seen, topic: str, time: float, message: Any) -> None:
    for state in message.robots:
        _heard_robot(seen, topic, time, state)


def _heard_robot(seen: _Seen, topic: str, time: float, message: Any) -> None:
    at = message.location
    if not message.name:
        return
    seen.add_pose(message.name, "fleet states", time, (float(at.x), float(at.y), float(at.yaw)))
    if at.level_name:
        seen.levels[at.level_name] = seen.levels.get(at.level_name, 0) + 1
    seen.add_path(message.name, time, [(float(p.x), float(p.y)) for p in message.path])


def _heard_clock(seen: _Seen, topic: str, time: float, message: Any) -> None:
    seen.clock.append((time, message.clock.sec + 1e-9 * message.clock.nanosec))


_HEARD: dict[str, Callable[[_Seen, str, float, Any], None]] = {
    "nav_msgs/msg/Odometry": _heard_odometry,
    "geometry_msgs/msg/PoseStamped": _heard_pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _heard_covariance,
    "nav_msgs/msg/Path": _heard_path,
    "nav_msgs/msg/OccupancyGrid": _heard_map,
    "tf2_msgs/msg/TFMessage": _heard_transforms,
    "rmf_fleet_msgs/msg/FleetState": _heard_fleet,
    "rmf_fleet_msgs/msg/RobotState": _heard_robot,
    "rosgraph_msgs/msg/Clock": _heard_clock,
}
