"""Logs of ROS 2 as fleets: rosbag2 folders, several of one run, and single storage files.

Read are poses (TF, PoseStamped, PoseWithCovarianceStamped, Odometry, rmf_fleet_msgs/FleetState and
RobotState), goals (PoseStamped on a topic whose last name has ``goal``), paths and maps. A robot is
named by its topics' namespace, its TF frames' prefix (``ada/base_link``, ``ada_base_link``), or
FleetState. Where several topics tell
poses, the best is taken: FleetState, TF to ``map``, poses, odometry.

Times are those of the recording; with ``/clock`` they are simulation time. They count from the
first pose to the last message of any topic. A robot whose poses fall silent stands
where it was last seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import ConfigError, FormatError, InputError
from mrta_falsify.core.words import is_date
from simulator_interface.formats.bag_files import (
    METADATA,
    Recording,
    files_of,
    is_stored,
    messages_of,
)
from simulator_interface.formats.fleet_log import FleetLog, RobotLog, thinned, with_stands
from simulator_interface.formats.nav2 import OccupancyGrid

ROS_1 = (".bag", ".active")
POSES_EVERY = 0.05  # s; more is not kept
MAX_MESSAGES = 20_000_000
MAX_SECONDS = 7 * 86400.0  # that a log lasts; more is a stamp that is not one
LATEST_END = 86400.0  # s after the last pose
BASES = ("base_link", "base_footprint")
BETWEEN = "/_-."  # a prefix and a frame's own name
#: last parts of namespaces that name a program of a robot, and no robot
PROGRAMS = ("odometry", "amcl", "localization", "move_base", "move_base_simple")
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
    if path.is_dir():
        return (path / METADATA).is_file() or bool(files_of(path))
    return is_stored(path) or path.suffix.lower() in ROS_1


def read_bag(path: Path) -> FleetLog:
    """Read a log.

    Args:
        path: a rosbag2 folder, a folder of several bags of one run, or a ``.mcap`` or ``.db3``
            file, compressed or not.

    Raises:
        ConfigError: the extra ``mcap`` is not installed.
        FormatError: it cannot be read, is damaged from its begin on, or tells no robot's poses.
    """
    if not path.exists():
        raise FormatError(f"{path}: cannot be read: there is no such file or folder")
    if path.suffix.lower() in ROS_1:
        raise FormatError(
            f"{path}: is a ROS 1 bag, which is not supported; convert it: `rosbags-convert --src "
            f"{path.name} --dst {path.stem}`"
        )
    try:
        import lz4.frame  # noqa: F401, PLC0415 - an extra
        import zstandard  # noqa: F401, PLC0415
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            "reading logs of ROS 2 needs the extra `mcap`; in the checkout: pip install '.[mcap]'"
        ) from None
    seen, recording = _Seen(), Recording()
    store = get_typestore(Stores.ROS2_HUMBLE)
    unread: dict[str, int] = {}
    try:
        for count, row in enumerate(messages_of(path, _HEARD, recording)):
            if count > MAX_MESSAGES:
                raise FormatError(f"{path}: holds more than {MAX_MESSAGES} messages")
            if not count:
                _learn(store, recording.definitions)
            try:
                message = store.deserialize_cdr(row.raw, row.kind)
                _HEARD[row.kind](seen, row.topic, 1e-9 * row.stamp, message)
            except InputError:
                raise
            except Exception:
                unread[row.topic] = unread.get(row.topic, 0) + 1
    except InputError:
        raise
    except Exception as error:
        said = str(error).splitlines() or [type(error).__name__]
        raise FormatError(f"{path}: is damaged, or no log of ROS 2: {said[0][:200]}") from None
    if recording.refused and not seen.tracks:
        raise FormatError(recording.refused[0])
    recording.notes += [f"{said} (left out)" for said in recording.refused]
    recording.notes += [
        f"{count} messages of {topic} could not be read" for topic, count in unread.items()
    ]
    recording.is_cut |= bool(unread)
    return seen.log(path, recording)


def _learn(store: Any, definitions: dict[str, str]) -> None:
    """Give the store Open-RMF's types, as the log defines them if it does."""
    from rosbags.typesys import get_types_from_msg  # noqa: PLC0415 - an extra

    types: dict[str, Any] = {}
    for name, text in RMF_TYPES.items():
        types.update(get_types_from_msg(text, name))
    for name, text in definitions.items():
        if name in RMF_TYPES:
            types.update(get_types_from_msg(text, name))
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

    def log(self, path: Path, recording: Recording) -> FleetLog:
        """Put together what was heard."""
        chosen = {
            robot: best
            for robot, tracks in sorted(self.tracks.items())
            if (best := self._best(tracks)) is not None
        }
        if not chosen:
            raise FormatError(
                f"{path}: has no robot's poses; it needs Odometry, PoseStamped, "
                "PoseWithCovarianceStamped, TF to a base_link, or Open-RMF's FleetState"
            )
        begin = min(self._time(min(track.times)) for _, track in chosen.values())
        end = max(self._time(max(track.times)) for _, track in chosen.values())
        ended = end if recording.end is None else self._time(1e-9 * recording.end)
        end = max(end, ended) if ended - end <= LATEST_END else end
        if end - begin > MAX_SECONDS:
            raise FormatError(
                f"{path}: lasts {(end - begin) / 86400.0:.0f} days by its stamps; a log of at most "
                f"{MAX_SECONDS / 86400.0:.0f} is read"
            )
        robots = []
        for robot, (source, track) in chosen.items():
            times = np.array([self._time(time) - begin for time in track.times])
            order = np.argsort(times, kind="stable")
            kept = order[thinned(times[order], POSES_EVERY)]
            time, pose = with_stands(times[kept], np.array(track.poses)[kept])
            robots.append(
                RobotLog(
                    name=robot,
                    time=frozen_array(time),
                    pose=frozen_array(pose),
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
            robots=tuple(robots),
            grid=self._grid(),
            duration=end - begin,
            notes=(*recording.notes, *notes),
            is_cut=recording.is_cut,
            begins_at=begin if len(self.clock) < 2 and is_date(begin) else None,
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
    parts = topic.strip("/").split("/")[:-1]
    while parts and parts[-1] in PROGRAMS:
        parts.pop()
    return "/".join(parts) or ALONE


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
            seen.goals.setdefault(_owner(topic), []).append((time, frozen_array([x, y])))
    else:
        seen.add_pose(_owner(topic), "poses", time, _pose(message.pose))


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
        prefix = _prefix(child, BASES)
        if prefix is not None:
            pose = _in_map(seen, space, child, prefix)
            if pose is not None:
                seen.add_pose(prefix or space or ALONE, "TF", time, pose)


def _prefix(frame: str, names: tuple[str, ...]) -> str | None:
    """Find what stands before one of the names in a frame, empty: nothing; None: it is none."""
    for name in names:
        before = frame.removesuffix(name)
        if before != frame and (not before or before[-1] in BETWEEN):
            return before.rstrip(BETWEEN)
    return None


def _in_map(seen: _Seen, space: str, frame: str, prefix: str) -> tuple[float, float, float] | None:
    """Find the pose of a robot's base in ``map``; None: it does not hang on it.

    What hangs on a base of another name (``arm_base_link`` on ``base_link``) is part of that robot.
    """
    x, y, yaw = 0.0, 0.0, 0.0
    for _ in range(10):
        if _prefix(frame, ("map",)) is not None:
            return x, y, yaw
        if (space, frame) not in seen.frames or _prefix(frame, BASES) not in (None, prefix):
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
