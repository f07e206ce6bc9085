"""A robot's usual topics: what the door tells as ROS messages, and ROS messages as answers.

The same code fills the messages of any ROS-like middleware. It takes ``make(type_name)``, which
gives a message with default values, and sets its fields. Frames are those of REP-105; metres,
radians and seconds in the map frame.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.costmap import LETHAL, UNKNOWN
from mrta_falsify.core.errors import ConfigError, FormatError
from mrta_falsify.core.parsing import parse_json
from simulator_interface.foreign.laser_scans import Scans

NANO = 1_000_000_000  # ns in a second
OCCUPIED, UNEXPLORED = 100, -1  # of nav_msgs/OccupancyGrid
ROBOT = "{robot}"  # stands for a robot's name in names of topics and frames

Make = Callable[[str], Any]  #: gives a message of a type, ``pkg/msg/Name``, with its defaults


class Qos(NamedTuple):
    """How messages of a topic are kept and delivered."""

    depth: int = 10  #: how many are kept
    is_reliable: bool = True
    is_transient_local: bool = False  #: whether the last are given to whoever comes later


#: profiles of rclcpp and tf2_ros: QoS(10), SensorDataQoS, StaticBroadcasterQoS and what maps use,
#: DynamicBroadcasterQoS
DEFAULT = Qos()
SENSOR_DATA = Qos(depth=5, is_reliable=False)
LATCHED = Qos(depth=1, is_transient_local=True)
TRANSFORMS = Qos(depth=100)
ALL_TASKS = Qos(depth=1000, is_transient_local=True)  # whoever comes later hears of all


class Topic(NamedTuple):
    """A topic under its full name."""

    name: str  #: begins with a slash
    type: str  #: of its messages
    qos: Qos
    field: str  #: of :class:`Topics` that names it
    robot: int = -1  #: whose it is; -1: of all


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Names of topics and frames; ``{robot}`` stands for a robot's name. Empty: no such topic."""

    clock: str = "/clock"
    map: str = "/map"
    tf: str = "/tf"
    tf_static: str = "/tf_static"
    people: str = "/people"
    tasks: str = "/tasks"  #: tasks that arrive, as JSON in a String; this harness's own
    events: str = "/events"  #: claims and other events, as JSON in a String; this harness's own
    odom: str = "/{robot}/odom"
    scan: str = "/{robot}/scan"
    cmd_vel: str = "/{robot}/cmd_vel"
    goal_pose: str = "/{robot}/goal_pose"
    plan: str = "/{robot}/plan"
    map_frame: str = "map"
    odom_frame: str = "{robot}/odom"
    base_frame: str = "{robot}/base_link"
    stamped: bool = False  #: whether cmd_vel carries TwistStamped; Nav2: enable_stamped_cmd_vel
    reliable_scan: bool = False  #: whether subscribers of scans may ask for reliable delivery
    range_max: float = quantity(above=0.0, unit="m", default=10.0)  #: of scans


#: by field of ``Topics``: what the harness publishes, and what it listens to
PUBLISHED = {
    "tf_static": ("tf2_msgs/msg/TFMessage", LATCHED),
    "map": ("nav_msgs/msg/OccupancyGrid", LATCHED),
    "odom": ("nav_msgs/msg/Odometry", DEFAULT),
    "scan": ("sensor_msgs/msg/LaserScan", SENSOR_DATA),
    "people": ("geometry_msgs/msg/PoseArray", DEFAULT),
    "tf": ("tf2_msgs/msg/TFMessage", TRANSFORMS),
    "tasks": ("std_msgs/msg/String", ALL_TASKS),
    "clock": ("rosgraph_msgs/msg/Clock", DEFAULT),
}
HEARD = {
    "cmd_vel": ("geometry_msgs/msg/Twist", DEFAULT),
    "goal_pose": ("geometry_msgs/msg/PoseStamped", DEFAULT),
    "plan": ("nav_msgs/msg/Path", DEFAULT),
    "events": ("std_msgs/msg/String", Qos(depth=100)),
}
PER_ROBOT = ("odom", "scan", "cmd_vel", "goal_pose", "plan")


class Said(NamedTuple):
    """What a message says about one robot; None where it says nothing."""

    twist: tuple[float, float, float] | None = None  #: forward, left [m/s], turn rate [rad/s]
    goal: tuple[float, float] | None = None  #: [m]
    path: Array | None = None  #: (L, 2) [m]
    event: dict[str, Any] | None = None  #: of the door's `command`
    stamp: int | None = None  #: [ns] of simulated time, of a message that has one


class RobotTopics:
    """The topics of one world.

    Args:
        world: message of the door.
        topics: their names.
        make: gives messages.

    Raises:
        ConfigError: two topics have one name, or a name is none.
    """

    def __init__(self, world: Mapping[str, Any], topics: Topics, make: Make) -> None:
        self._world = world
        self._names = topics
        self._make = make
        self.robots: tuple[str, ...] = tuple(robot["name"] for robot in world["robots"])
        radii = [robot["radius"] for robot in world["robots"]]
        self._radii = np.array(radii, dtype=np.float64)
        self.published = tuple(self._topics(PUBLISHED))  #: in the order of publication
        self.heard = tuple(self._topics(HEARD))
        names = [topic.name for topic in (*self.published, *self.heard)]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(
                    f"topics: {names.count(name)} topics are named {name}; "
                    f"{ROBOT} in a name stands for each robot's"
                )

    def at_start(self) -> list[tuple[Topic, Any]]:
        """Fill what is published once: the map, and the transforms that do not change."""
        fill = {"map": self._map, "tf_static": self._fixed_transforms}
        return [(topic, fill[topic.field]()) for topic in self.published if topic.field in fill]

    def at_tick(self, tick: Mapping[str, Any]) -> list[tuple[Topic, Any]]:
        """Fill what is published each tick, the clock last.

        Args:
            tick: message of the door, with arrays.
        """
        scans = Scans(tick, self._radii, self._names.range_max)
        fill: dict[str, Callable[[int], Any]] = {
            "odom": lambda robot: self._odometry(tick, robot),
            "scan": lambda robot: self._scan(tick, scans, robot),
            "people": lambda _: self._people(tick),
            "tf": lambda _: self._transforms(tick),
            "clock": lambda _: self._clock(tick),
        }
        filled = []
        for topic in self.published:
            if topic.field == "tasks":
                filled += [(topic, self._task(task)) for task in tick["tasks"]]
            elif topic.field in fill:
                filled.append((topic, fill[topic.field](topic.robot)))
        return filled

    def read(self, topic: Topic, message: Any) -> Said:
        """Read a message of a topic that is listened to.

        Raises:
            ConfigError: the text of an event is none.
        """
        if topic.field == "events":
            return Said(event=self._event(topic, message.data))
        if topic.field == "plan":
            points = [(p.pose.position.x, p.pose.position.y) for p in message.poses]
            path = np.array(points, dtype=np.float64).reshape(-1, 2)
            return Said(path=path, stamp=_nanoseconds(message.header.stamp))
        if topic.field == "goal_pose":
            place = message.pose.position
            goal = (float(place.x), float(place.y))
            return Said(goal=goal, stamp=_nanoseconds(message.header.stamp))
        twist, stamp = message, None
        if self._names.stamped:
            twist, stamp = message.twist, _nanoseconds(message.header.stamp)
        linear = float(twist.linear.x), float(twist.linear.y)
        return Said(twist=(*linear, float(twist.angular.z)), stamp=stamp)

    # --- names ---------------------------------------------------------------------------------

    def _topics(self, table: Mapping[str, tuple[str, Qos]]) -> Iterator[Topic]:
        for field, (kind, qos) in table.items():
            pattern: str = getattr(self._names, field)
            if not pattern:
                continue
            if field == "scan" and self._names.reliable_scan:
                qos = DEFAULT  # noqa: PLW2901
            if field == "cmd_vel" and self._names.stamped:
                kind = "geometry_msgs/msg/TwistStamped"  # noqa: PLW2901
            for robot, name in enumerate(self.robots) if field in PER_ROBOT else [(-1, "")]:
                yield Topic(_full_name(field, pattern, name), kind, qos, field, robot)

    def _frame(self, pattern: str, robot: int) -> str:
        return pattern.replace(ROBOT, _token(self.robots[robot]))

    # --- messages ------------------------------------------------------------------------------

    def _clock(self, tick: Mapping[str, Any]) -> Any:
        message = self._make("rosgraph_msgs/msg/Clock")
        _fill_stamp(message.clock, tick["time"])
        return message

    def _odometry(self, tick: Mapping[str, Any], robot: int) -> Any:
        message = self._make("nav_msgs/msg/Odometry")
        _fill_header(message.header, tick["time"], self._frame(self._names.odom_frame, robot))
        message.child_frame_id = self._frame(self._names.base_frame, robot)
        x, y, yaw = tick["pose"][robot].tolist()
        _fill_pose(message.pose.pose, x, y, yaw)
        forward, left, turn_rate = tick["velocity"][robot].tolist()
        message.twist.twist.linear.x = forward
        message.twist.twist.linear.y = left
        message.twist.twist.angular.z = turn_rate
        return message

    def _scan(self, tick: Mapping[str, Any], scans: Scans, robot: int) -> Any:
        message = self._make("sensor_msgs/msg/LaserScan")
        _fill_header(message.header, tick["time"], self._frame(self._names.base_frame, robot))
        first, ranges = scans.of(robot)
        step = 2.0 * math.pi / max(1, len(ranges))
        message.angle_min = first
        message.angle_max = first + step * max(0, len(ranges) - 1)
        message.angle_increment = step
        message.scan_time = float(self._world["dt"])
        message.range_max = self._names.range_max
        message.ranges = ranges.tolist()
        return message

    def _task(self, task: Mapping[str, Any]) -> Any:
        """Tell a task as the door does, and where its rooms are."""
        rooms = self._world["rooms"]
        said = dict(task)
        for end in ("start", "end"):
            room = rooms[task[end]]
            said[f"{end}_room"], said[f"{end}_point"] = room["name"], list(room["point"])
        message = self._make("std_msgs/msg/String")
        message.data = json.dumps(codec.finite(said), sort_keys=True)
        return message

    def _event(self, topic: Topic, text: str) -> dict[str, Any]:
        try:
            event = parse_json(text, topic.name)
        except FormatError:
            event = None
        if not isinstance(event, dict):
            raise ConfigError(
                f"{topic.name}: {text!r:.80} is no event; it must be a JSON object with `kind`, "
                "and what applies of `robot`, `task`, `resource`, `other`, `detail`"
            )
        if event.get("robot") in self.robots:
            event["robot"] = self.robots.index(event["robot"])
        return event

    def _people(self, tick: Mapping[str, Any]) -> Any:
        message = self._make("geometry_msgs/msg/PoseArray")
        _fill_header(message.header, tick["time"], self._names.map_frame)
        poses = []
        for place, velocity in zip(tick["human_position"], tick["human_velocity"], strict=True):
            if np.isfinite(place).all():
                pose = self._make("geometry_msgs/msg/Pose")
                heading = math.atan2(velocity[1], velocity[0]) if velocity.any() else 0.0
                _fill_pose(pose, float(place[0]), float(place[1]), heading)
                poses.append(pose)
        message.poses = poses
        return message

    def _transforms(self, tick: Mapping[str, Any]) -> Any:
        message = self._make("tf2_msgs/msg/TFMessage")
        names = self._names
        message.transforms = [
            self._transform(
                tick["time"],
                self._frame(names.odom_frame, robot),
                self._frame(names.base_frame, robot),
                pose.tolist(),
            )
            for robot, pose in enumerate(tick["pose"])
        ]
        return message

    def _fixed_transforms(self) -> Any:
        """Give map -> odom, which is no turn and no shift: odometry is as localised."""
        message = self._make("tf2_msgs/msg/TFMessage")
        frames = {self._frame(self._names.odom_frame, robot) for robot in range(len(self.robots))}
        message.transforms = [
            self._transform(0.0, self._names.map_frame, frame, [0.0, 0.0, 0.0])
            for frame in sorted(frames - {self._names.map_frame})
        ]
        return message

    def _transform(self, time: float, parent: str, child: str, pose: list[float]) -> Any:
        stamped = self._make("geometry_msgs/msg/TransformStamped")
        _fill_header(stamped.header, time, parent)
        stamped.child_frame_id = child
        stamped.transform.translation.x, stamped.transform.translation.y = pose[0], pose[1]
        _fill_turn(stamped.transform.rotation, pose[2])
        return stamped

    def _map(self) -> Any:
        """Give what is solid; inflation is left to whoever plans."""
        told = self._world["map"]
        table = np.zeros(256, dtype=np.int8)
        table[LETHAL], table[UNKNOWN] = OCCUPIED, UNEXPLORED
        cost = np.frombuffer(bytes(told["cost"]), dtype=np.uint8)
        message = self._make("nav_msgs/msg/OccupancyGrid")
        message.header.frame_id = self._names.map_frame
        message.info.resolution = float(told["resolution"])
        message.info.width, message.info.height = int(told["cols"]), int(told["rows"])
        x, y = told["origin"]
        message.info.origin.position.x, message.info.origin.position.y = float(x), float(y)
        message.data = table[cost].tolist()
        return message


def _token(robot: str) -> str:
    """Turn a robot's name into letters, digits and underscores, as names in ROS are."""
    return re.sub(r"[^A-Za-z0-9_]", "_", robot)


def _full_name(field: str, pattern: str, robot: str) -> str:
    name = pattern.replace(ROBOT, _token(robot))
    if not name.startswith("/") or not all(part.isidentifier() for part in name[1:].split("/")):
        raise ConfigError(
            f"topics.{field}: {name!r} is no name of a topic; it begins with a slash, and its "
            "parts are letters, digits and underscores, a digit not first"
        )
    return name


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def nanoseconds_of(time: float) -> int:
    """Round simulated time [s] to whole nanoseconds."""
    return round(time * NANO)


def _fill_stamp(stamp: Any, time: float) -> None:
    stamp.sec, stamp.nanosec = divmod(nanoseconds_of(time), NANO)


def _fill_header(header: Any, time: float, frame: str) -> None:
    _fill_stamp(header.stamp, time)
    header.frame_id = frame


def _fill_pose(pose: Any, x: float, y: float, yaw: float) -> None:
    pose.position.x, pose.position.y = x, y
    _fill_turn(pose.orientation, yaw)


def _fill_turn(rotation: Any, yaw: float) -> None:
    rotation.z, rotation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
