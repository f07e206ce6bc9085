"""``tf2_ros``: transforms between frames, sent on ``/tf`` and ``/tf_static``, looked up in time."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.fibres import NS
from simulator_interface.foreign.ros_nodes.futures import Future
from simulator_interface.foreign.ros_nodes.quality import DurabilityPolicy, QoSProfile
from simulator_interface.foreign.ros_nodes.ros_messages import message_class
from simulator_interface.foreign.ros_nodes.ros_time import Duration, Time

Array = NDArray[np.float64]
KEPT = Duration(seconds=10)  # of transforms, tf2's default


class TransformException(Exception):  # noqa: N818 - tf2's name
    """A transform cannot be had."""


class LookupException(TransformException):
    """A frame is not known."""


class ConnectivityException(TransformException):
    """Two frames are not connected."""


class ExtrapolationException(TransformException):
    """A transform is known at other times only."""


class InvalidArgumentException(TransformException):
    """An argument is none."""


class TimeoutException(TransformException):
    """It took too long."""


@dataclass(frozen=True)
class Pose:
    """Where a frame is in its parent: turn by ``turn``, then move by ``shift``."""

    shift: Array  #: (3,) [m]
    turn: Array  #: (4,) quaternion x, y, z, w

    def after(self, inner: Pose) -> Pose:
        """Pose in this frame's parent of a frame that is at ``inner`` in this frame."""
        return Pose(self.shift + _rotated(self.turn, inner.shift), _product(self.turn, inner.turn))

    def inverse(self) -> Pose:
        """Pose of the parent in this frame."""
        back = self.turn * np.array([-1.0, -1.0, -1.0, 1.0])
        return Pose(-_rotated(back, self.shift), back)


@dataclass
class _History:
    """A frame in its parent, over time."""

    parent: str
    is_static: bool
    times: list[int] = field(default_factory=list)  # [ns], rising
    poses: list[Pose] = field(default_factory=list)

    def add(self, time: int, pose: Pose, kept: int) -> None:
        if self.is_static:
            self.times, self.poses = [0], [pose]
            return
        place = bisect.bisect_left(self.times, time)
        if place < len(self.times) and self.times[place] == time:
            self.poses[place] = pose
        else:
            self.times.insert(place, time)
            self.poses.insert(place, pose)
        old = bisect.bisect_left(self.times, self.times[-1] - kept)
        del self.times[:old], self.poses[:old]

    def at(self, time: int, frame: str) -> Pose:
        if self.is_static:
            return self.poses[0]
        if not self.times[0] <= time <= self.times[-1]:
            when = "past" if time < self.times[0] else "future"
            raise ExtrapolationException(
                f"Lookup would require extrapolation into the {when}. Requested time "
                f"{time / NS:.6f}, known from {self.times[0] / NS:.6f} to "
                f"{self.times[-1] / NS:.6f}, when looking up transform of frame [{frame}]"
            )
        place = bisect.bisect_left(self.times, time)
        if self.times[place] == time:
            return self.poses[place]
        share = (time - self.times[place - 1]) / (self.times[place] - self.times[place - 1])
        return _between(self.poses[place - 1], self.poses[place], share)


class Buffer:
    """Keeps transforms.

    Args:
        cache_time: how long [s]; tf2's default is 10 s.
        node: is taken and not needed.
    """

    def __init__(self, cache_time: Duration | None = None, node: Any = None) -> None:
        self._kept = (cache_time or KEPT).nanoseconds
        self._frames: dict[str, _History] = {}
        self._awaited: list[tuple[Future, tuple[str, str, Time]]] = []

    def set_transform(self, transform: Any, authority: str) -> None:
        """Add ``geometry_msgs/msg/TransformStamped``."""
        self._add(transform, is_static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Add one that holds at all times."""
        self._add(transform, is_static=True)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Time, timeout: Duration | None = None
    ) -> Any:
        """Give the transform that takes data from ``source_frame`` to ``target_frame``.

        Args:
            target_frame: data is taken to.
            source_frame: data is in.
            time: of the data; 0: the latest that all frames between know.
            timeout: to wait for it; another thread must spin.

        Raises:
            TransformException: it cannot be had.
        """
        timeline = here.timeline()
        until = timeline.now + (timeout.nanoseconds if timeout is not None else 0)
        while True:
            try:
                return self._lookup(target_frame, source_frame, time)
            except TransformException:
                if timeline.now >= until:
                    raise
            timeline.park(min(until, timeline.now + NS // 100))

    def can_transform(
        self, target_frame: str, source_frame: str, time: Time, timeout: Duration | None = None
    ) -> bool:
        """Tell whether a transform can be had."""
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException:
            return False
        return True

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Any:
        """Wait for a transform without blocking the executor."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self._lookup(target_frame, source_frame, time)

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Time) -> Future:
        """Give a future that is done when a transform can be had."""
        future, wanted = Future(), (target_frame, source_frame, time)
        self._awaited.append((future, wanted))
        self._tell_awaited()
        return future

    def all_frames_as_string(self) -> str:
        """List the frames."""
        return "\n".join(
            f"Frame {frame} exists with parent {history.parent}."
            for frame, history in sorted(self._frames.items())
        )

    def clear(self) -> None:
        """Forget all that may change."""
        self._frames = {f: history for f, history in self._frames.items() if history.is_static}

    def _add(self, transform: Any, *, is_static: bool) -> None:
        child, parent = (
            name.lstrip("/") for name in (transform.child_frame_id, transform.header.frame_id)
        )
        history = self._frames.get(child)
        if history is None or history.parent != parent:
            history = self._frames[child] = _History(parent, is_static)
        shift, turn = transform.transform.translation, transform.transform.rotation
        pose = Pose(
            np.array([shift.x, shift.y, shift.z]), np.array([turn.x, turn.y, turn.z, turn.w])
        )
        history.add(Time.from_msg(transform.header.stamp).nanoseconds, pose, self._kept)
        self._tell_awaited()

    def _tell_awaited(self) -> None:
        for entry in list(self._awaited):
            future, (target, source, time) = entry
            try:
                self._lookup(target, source, time)
            except TransformException:
                continue
            self._awaited.remove(entry)
            future.set_result(True)

    def _lookup(self, target_frame: str, source_frame: str, time: Time) -> Any:
        target, source = target_frame.lstrip("/"), source_frame.lstrip("/")
        ups = [self._up_from(frame) for frame in (target, source)]
        common = next((frame for frame in ups[1] if frame in ups[0]), None)
        if common is None:
            raise ConnectivityException(
                f"Could not find a connection between '{target}' and '{source}' because they are "
                "not part of the same tree."
            )
        ways = [way[: way.index(common)] for way in ups]
        when = time.nanoseconds or self._latest([*ways[0], *ways[1]])
        to_common = [self._pose(way, when) for way in ways]
        return _stamped(to_common[0].inverse().after(to_common[1]), when, target, source)

    def _up_from(self, frame: str) -> list[str]:
        """List a frame and all above it.

        Raises:
            LookupException: nobody has named it.
        """
        parents = {history.parent for history in self._frames.values()}
        if frame not in self._frames and frame not in parents:
            raise LookupException(f'"{frame}" passed to lookupTransform does not exist.')
        way = [frame]
        while way[-1] in self._frames and self._frames[way[-1]].parent not in way:
            way.append(self._frames[way[-1]].parent)
        return way

    def _latest(self, frames: Sequence[str]) -> int:
        moving = [self._frames[frame] for frame in frames]
        return min((h.times[-1] for h in moving if not h.is_static), default=0)

    def _pose(self, way: Sequence[str], time: int) -> Pose:
        pose = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
        for frame in way:
            pose = self._frames[frame].at(time, frame).after(pose)
        return pose


class TransformListener:
    """Fills a buffer from ``/tf`` and ``/tf_static``.

    Args:
        buffer: to be filled.
        node: that subscribes.
        spin_thread: is taken; the node's executor hears.
        more: qualities of service, which are as ROS 2's defaults.
    """

    def __init__(
        self, buffer: Buffer, node: Any, *, spin_thread: bool = False, **more: Any
    ) -> None:
        kind = message_class("tf2_msgs/msg/TFMessage")
        static = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

        def hear(message: Any) -> None:
            for transform in message.transforms:
                buffer.set_transform(transform, "tf")

        def hear_static(message: Any) -> None:
            for transform in message.transforms:
                buffer.set_transform_static(transform, "tf_static")

        node.create_subscription(kind, "/tf", hear, QoSProfile(depth=100))
        node.create_subscription(kind, "/tf_static", hear_static, static)


class TransformBroadcaster:
    """Sends transforms on ``/tf``.

    Args:
        node: that publishes.
        qos: quality of service.
    """

    TOPIC = "/tf"
    QOS = QoSProfile(depth=100)

    def __init__(self, node: Any, qos: QoSProfile | None = None) -> None:
        self._type = message_class("tf2_msgs/msg/TFMessage")
        self._publisher = node.create_publisher(self._type, self.TOPIC, qos or self.QOS)

    def sendTransform(self, transform: Any) -> None:  # noqa: N802 - tf2's name
        """Send one transform, or several."""
        several = list(transform) if isinstance(transform, (list, tuple)) else [transform]
        self._publisher.publish(self._type(transforms=several))


class StaticTransformBroadcaster(TransformBroadcaster):
    """Sends transforms that hold at all times."""

    TOPIC = "/tf_static"
    QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def _stamped(pose: Pose, time: int, target: str, source: str) -> Any:
    made = message_class("geometry_msgs/msg/TransformStamped")()
    made.header.stamp, made.header.frame_id = Time(nanoseconds=time).to_msg(), target
    made.child_frame_id = source
    shift, turn = made.transform.translation, made.transform.rotation
    shift.x, shift.y, shift.z = (float(number) for number in pose.shift)
    turn.x, turn.y, turn.z, turn.w = (float(number) for number in pose.turn)
    return made


def _product(first: Array, second: Array) -> Array:
    x, y, z, w = first
    a, b, c, d = second
    return np.array(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ]
    )


def _rotated(turn: Array, point: Array) -> Array:
    axis, w = turn[:3], turn[3]
    cross = 2.0 * np.cross(axis, point)
    rotated: Array = point + w * cross + np.cross(axis, cross)
    return rotated


def _between(first: Pose, second: Pose, share: float) -> Pose:
    """Give the pose at a share of the way: linear, and along the shortest turn (slerp)."""
    cosine = float(first.turn @ second.turn)
    other = second.turn if cosine >= 0.0 else -second.turn
    angle = np.arccos(min(1.0, abs(cosine)))
    weights = (1.0 - share, share)
    if angle > 1e-6:
        weights = tuple(np.sin(np.array([1.0 - share, share]) * angle) / np.sin(angle))
    turn = weights[0] * first.turn + weights[1] * other
    shift = (1.0 - share) * first.shift + share * second.shift
    return Pose(shift, turn / np.linalg.norm(turn))
