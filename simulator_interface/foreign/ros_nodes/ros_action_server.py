"""``rclpy.action``, the server: serves goals that take a while, over services and topics."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable
from typing import Any

from simulator_interface.foreign.ros_nodes.futures import Future
from simulator_interface.foreign.ros_nodes.quality import (
    QoSProfile,
    qos_profile_action_status_default,
)
from simulator_interface.foreign.ros_nodes.ros_graph import Publisher
from simulator_interface.foreign.ros_nodes.ros_messages import interface_module, message_class
from simulator_interface.foreign.ros_nodes.ros_services import Service


class GoalStatus(enum.IntEnum):
    """As ``action_msgs/msg/GoalStatus``."""

    STATUS_UNKNOWN = 0
    STATUS_ACCEPTED = 1
    STATUS_EXECUTING = 2
    STATUS_CANCELING = 3
    STATUS_SUCCEEDED = 4
    STATUS_CANCELED = 5
    STATUS_ABORTED = 6


class GoalResponse(enum.Enum):
    """What a server says to a goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(enum.Enum):
    """What a server says to being asked to cancel."""

    REJECT = 1
    ACCEPT = 2


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept each goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Refuse to cancel."""
    return CancelResponse.REJECT


def default_handle_accepted_callback(goal_handle: Any) -> None:
    """Execute each goal at once."""
    goal_handle.execute()


class ServerGoalHandle:
    """A goal, seen by its server.

    Args:
        server: that accepted it.
        goal_id: of it.
        request: its goal.
    """

    def __init__(self, server: ActionServer, goal_id: Any, request: Any) -> None:
        self.goal_id, self.request = goal_id, request
        self.status = GoalStatus.STATUS_ACCEPTED
        self.result = Future()
        self._server = server

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self.status < GoalStatus.STATUS_SUCCEEDED

    @property
    def is_cancel_requested(self) -> bool:
        """Whether it is to be cancelled."""
        return self.status == GoalStatus.STATUS_CANCELING

    def execute(self, execute_callback: Callable[[Any], Any] | None = None) -> None:
        """Have it executed by the executor."""
        if not self.is_cancel_requested:
            self._becomes(GoalStatus.STATUS_EXECUTING)
        self._server.execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Tell how it goes.

        Raises:
            TypeError: it is of another type.
        """
        self._server.publish_feedback(self, feedback)

    def succeed(self, response: Any = None) -> None:
        """End it well."""
        self._becomes(GoalStatus.STATUS_SUCCEEDED)

    def abort(self, response: Any = None) -> None:
        """End it badly."""
        self._becomes(GoalStatus.STATUS_ABORTED)

    def canceled(self, response: Any = None) -> None:
        """End it as was asked."""
        self._becomes(GoalStatus.STATUS_CANCELED)

    def cancel(self) -> None:
        """Take note that it is to be cancelled."""
        self._becomes(GoalStatus.STATUS_CANCELING)

    def _becomes(self, status: GoalStatus) -> None:
        self.status = status
        self._server.publish_status()


class ActionServer:
    """Serves goals of one action.

    Args:
        node: it belongs to.
        action_type: with ``Goal``, ``Result`` and ``Feedback``.
        action_name: of it.
        execute_callback: called with a goal handle; gives the result, or a coroutine that does.
        callback_group: of its callbacks.
        goal_callback: says whether a goal is accepted.
        handle_accepted_callback: called with the handle of a goal that was.
        cancel_callback: says whether a goal is cancelled.
        more: qualities of service, which are as ROS 2's defaults.
    """

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[Any], Any],
        *,
        callback_group: Any = None,
        goal_callback: Callable[[Any], GoalResponse] = default_goal_callback,
        handle_accepted_callback: Callable[[Any], object] = default_handle_accepted_callback,
        cancel_callback: Callable[[Any], CancelResponse] = default_cancel_callback,
        **more: Any,
    ) -> None:
        self._node, self._type, self._execute = node, action_type, execute_callback
        self._goal_callback, self._cancel_callback = goal_callback, cancel_callback
        self._accepted = handle_accepted_callback
        self._group = callback_group
        self._goals: dict[bytes, ServerGoalHandle] = {}
        name = f"{action_name}/_action"
        cancel = interface_module("action_msgs", "srv").CancelGoal
        self._services: list[Service] = [
            node.create_service(kind, f"{name}/{part}", callback, callback_group=callback_group)
            for kind, part, callback in (
                (action_type.Impl.SendGoalService, "send_goal", self._on_goal),
                (action_type.Impl.GetResultService, "get_result", self._on_result),
                (cancel, "cancel_goal", self._on_cancel),
            )
        ]
        self._feedback: Publisher = node.create_publisher(
            action_type.Impl.FeedbackMessage, f"{name}/feedback", QoSProfile(depth=10)
        )
        self._status: Publisher = node.create_publisher(
            message_class("action_msgs/msg/GoalStatusArray"),
            f"{name}/status",
            qos_profile_action_status_default,
        )

    def execute(self, goal: ServerGoalHandle, callback: Callable[[Any], Any] | None) -> None:
        """Have a goal executed."""
        task = self._node.executor.create_task(self._run, goal, callback or self._execute)
        task.callback_group = self._group or self._node.default_callback_group

    def publish_feedback(self, goal: ServerGoalHandle, feedback: Any) -> None:
        """Tell how a goal goes."""
        if not isinstance(feedback, self._type.Feedback):
            raise TypeError(f"Expected {self._type.Feedback}, got {type(feedback)}")
        message = self._type.Impl.FeedbackMessage(goal_id=goal.goal_id, feedback=feedback)
        self._feedback.publish(message)

    def publish_status(self) -> None:
        """Tell how all goals stand."""
        status, info = (
            message_class(f"action_msgs/msg/{name}") for name in ("GoalStatus", "GoalInfo")
        )
        array = message_class("action_msgs/msg/GoalStatusArray")
        rows = [
            status(goal_info=info(goal_id=goal.goal_id), status=int(goal.status))
            for goal in self._goals.values()
        ]
        self._status.publish(array(status_list=rows))

    def destroy(self) -> None:
        """End it."""
        for service in self._services:
            self._node.destroy_service(service)

    async def _run(self, goal: ServerGoalHandle, callback: Callable[[Any], Any]) -> None:
        try:
            result = callback(goal)
            if inspect.isawaitable(result):
                result = await result
        except Exception as error:
            self._node.get_logger().error(f"Error raised in execute callback: {error}")
            result = None
        if goal.is_active:
            self._node.get_logger().warning("Goal state not set, assuming aborted.")
            goal.abort()
        goal.result.set_result(result if result is not None else self._type.Result())

    def _on_goal(self, request: Any, response: Any) -> Any:
        key = goal_key(request.goal_id)
        is_taken = key not in self._goals
        response.accepted = is_taken and self._goal_callback(request.goal) == GoalResponse.ACCEPT
        if response.accepted:
            response.stamp = self._node.get_clock().now().to_msg()
            goal = self._goals[key] = ServerGoalHandle(self, request.goal_id, request.goal)
            self._accepted(goal)
        return response

    async def _on_result(self, request: Any, response: Any) -> Any:
        goal = self._goals.get(goal_key(request.goal_id))
        if goal is None:
            response.status = int(GoalStatus.STATUS_UNKNOWN)
            return response
        response.result = await goal.result
        response.status = int(goal.status)
        return response

    def _on_cancel(self, request: Any, response: Any) -> Any:
        key = goal_key(request.goal_info.goal_id)
        wanted = [self._goals[key]] if key in self._goals else []
        if not any(key):  # no identity stands for all goals
            wanted = list(self._goals.values())
        for goal in wanted:
            if goal.is_active and self._cancel_callback(goal) == CancelResponse.ACCEPT:
                goal.cancel()
                info = message_class("action_msgs/msg/GoalInfo")(goal_id=goal.goal_id)
                response.goals_canceling.append(info)
        response.return_code = 0 if response.goals_canceling else 1
        return response


def goal_key(goal_id: Any) -> bytes:
    """Give the identity of a goal as a key."""
    return bytes(goal_id.uuid)
