"""``nav2_simple_commander``: a robot that is sent somewhere; the harness plans and drives."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator_interface.foreign.ros_nodes.ros_messages import message_class
from simulator_interface.foreign.ros_nodes.ros_node import Node

Array = NDArray[np.float64]
SPACING = 0.05  # m between the poses of a path, the resolution of Nav2's usual map


class TaskResult(enum.IntEnum):
    """How a task of the navigator ended."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


class BasicNavigator(Node):
    """Asks for paths; the planner is the harness's, in place of Nav2's planner server."""

    #: gives the points ``(L, 2)`` [m] of a path between two points ``(2,)``, set by the stack
    planner: Callable[[Array, Array], Array] | None = None

    def __init__(self, node_name: str = "basic_navigator", namespace: str = "") -> None:
        super().__init__(node_name, namespace=namespace or None)
        self.initial_pose: Any = None

    def setInitialPose(self, initial_pose: Any) -> None:  # noqa: N802 - Nav2's name
        """Take note of where the robot is."""
        self.initial_pose = initial_pose

    def waitUntilNav2Active(self, **_: Any) -> None:  # noqa: N802 - Nav2's name
        """Return at once."""

    def getPath(  # noqa: N802 - Nav2's name
        self, start: Any, goal: Any, planner_id: str = "", use_start: bool = False
    ) -> Any:
        """Give ``nav_msgs/msg/Path`` between two poses; None: there is none."""
        if BasicNavigator.planner is None:
            raise NotImplementedError("the stand-in for Nav2: nobody plans in this stack")
        ends = [np.array([p.pose.position.x, p.pose.position.y]) for p in (start, goal)]
        points = evenly_spaced(BasicNavigator.planner(*ends), SPACING)
        if not len(points):
            return None
        path = message_class("nav_msgs/msg/Path")()
        path.header.frame_id = "map"
        path.header.stamp = self.get_clock().now().to_msg()
        path.poses = [self._posed(point, path.header) for point in points]
        return path

    def getPathThroughPoses(  # noqa: N802 - Nav2's name
        self, start: Any, goals: Sequence[Any], planner_id: str = "", use_start: bool = False
    ) -> Any:
        """Give a path through several poses; None: there is none."""
        legs = [self.getPath(*ends) for ends in zip([start, *goals], goals, strict=False)]
        if not legs or any(leg is None for leg in legs):
            return None
        legs[0].poses = [pose for leg in legs for pose in leg.poses]
        return legs[0]

    def _posed(self, point: Array, header: Any) -> Any:
        pose = message_class("geometry_msgs/msg/PoseStamped")(header=header.copied())
        pose.pose.position.x, pose.pose.position.y = float(point[0]), float(point[1])
        return pose

    def __getattr__(self, name: str) -> Any:
        if name in NAV2_NAMES:
            raise NotImplementedError(f"the stand-in for Nav2 has no BasicNavigator.{name}")
        return super().__getattr__(name)


NAV2_NAMES = frozenset(
    (
        "assistedTeleop", "backup", "cancelTask", "changeMap", "clearAllCostmaps",
        "clearGlobalCostmap", "clearLocalCostmap", "followPath", "followWaypoints", "getFeedback",
        "getGlobalCostmap", "getLocalCostmap", "getResult", "goThroughPoses", "goToPose",
        "isTaskComplete", "lifecycleShutdown", "lifecycleStartup", "smoothPath", "spin",
    )
)  # fmt: skip


def evenly_spaced(points: Array, spacing: float) -> Array:
    """Give points ``(L, 2)`` along a polyline about ``spacing`` [m] apart, its ends among them."""
    if len(points) < 2:
        return points
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    places = np.linspace(0.0, arc[-1], max(2, int(arc[-1] / spacing) + 1))
    return np.stack([np.interp(places, arc, points[:, k]) for k in (0, 1)], axis=1)
