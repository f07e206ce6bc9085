"""``rclpy.action``, the client: sends goals that take a while, over services and topics."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import numpy as np

from simulator_interface.foreign.ros_nodes import here
from simulator_interface.foreign.ros_nodes.futures import Future
from simulator_interface.foreign.ros_nodes.quality import QoSProfile
from simulator_interface.foreign.ros_nodes.ros_action_server import GoalStatus, goal_key
from simulator_interface.foreign.ros_nodes.ros_graph import Subscription
from simulator_interface.foreign.ros_nodes.ros_messages import interface_module, message_class
from simulator_interface.foreign.ros_nodes.ros_time import Time


class ClientGoalHandle:
    """A goal, seen by its client.

    Args:
        client: that sent it.
        goal_id: of it.
        response: of the server.
    """

    def __init__(self, client: ActionClient, goal_id: Any, response: Any) -> None:
        self.goal_id, self.accepted = goal_id, response.accepted
        self.stamp = Time.from_msg(response.stamp)
        self.status = GoalStatus.STATUS_UNKNOWN
        self._client = client

    def get_result_async(self) -> Future:
        """Ask for the result; the future gives ``result`` and ``status``."""
        return self._client.ask_result(self.goal_id)

    def get_result(self) -> Any:
        """Wait for the result; another thread must spin."""
        future = self.get_result_async()
        future.ended.wait(here.timeline())
        return future.result()

    def cancel_goal_async(self) -> Future:
        """Ask the server to cancel it."""
        return self._client.ask_cancel(self.goal_id)


class ActionClient:
    """Sends goals of one action.

    Args:
        node: it belongs to.
        action_type: with ``Goal``, ``Result`` and ``Feedback``.
        action_name: of it.
        callback_group: of its callbacks.
        more: qualities of service, which are as ROS 2's defaults.
    """

    def __init__(
        self,
        node: Any,
        action_type: Any,
        action_name: str,
        *,
        callback_group: Any = None,
        **more: Any,
    ) -> None:
        self._node, self._type = node, action_type
        name = f"{action_name}/_action"
        cancel = interface_module("action_msgs", "srv").CancelGoal
        self._send, self._result, self._cancel = (
            node.create_client(kind, f"{name}/{part}", callback_group=callback_group)
            for kind, part in (
                (action_type.Impl.SendGoalService, "send_goal"),
                (action_type.Impl.GetResultService, "get_result"),
                (cancel, "cancel_goal"),
            )
        )
        self._feedback: Subscription = node.create_subscription(
            action_type.Impl.FeedbackMessage,
            f"{name}/feedback",
            self._on_feedback,
            QoSProfile(depth=10),
            callback_group=callback_group,
        )
        self._hears: dict[bytes, Callable[[Any], object]] = {}
        self._handles: dict[bytes, ClientGoalHandle] = {}
        self._draw = random.Random(f"goals of {node.get_fully_qualified_name()} {action_name}")

    def server_is_ready(self) -> bool:
        """Tell whether there is a server."""
        is_ready: bool = self._send.service_is_ready()
        return is_ready

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server, at most ``timeout_sec`` [s]; say whether there is one."""
        is_ready: bool = self._send.wait_for_service(timeout_sec)
        return is_ready

    def send_goal_async(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], object] | None = None,
        goal_uuid: Any = None,
    ) -> Future:
        """Send a goal; the future gives its handle.

        Raises:
            TypeError: it is of another type.
        """
        if not isinstance(goal, self._type.Goal):
            raise TypeError(f"Expected {self._type.Goal}, got {type(goal)}")
        goal_id = goal_uuid or self._new_identity()
        if feedback_callback is not None:
            self._hears[goal_key(goal_id)] = feedback_callback
        request = self._type.Impl.SendGoalService.Request(goal_id=goal_id, goal=goal)
        handle = Future(executor=self._node.executor)

        def hand_out(answer: Future) -> None:
            made = ClientGoalHandle(self, goal_id, answer.result())
            self._handles[goal_key(goal_id)] = made
            handle.set_result(made)

        self._send.call_async(request).add_done_callback(hand_out)
        return handle

    def send_goal(self, goal: Any, **more: Any) -> Any:
        """Send a goal and wait for its result; another thread must spin."""
        future = self.send_goal_async(goal, **more)
        future.ended.wait(here.timeline())
        return future.result().get_result()

    def ask_result(self, goal_id: Any) -> Future:
        """See :meth:`ClientGoalHandle.get_result_async`."""
        request = self._type.Impl.GetResultService.Request(goal_id=goal_id)
        future: Future = self._result.call_async(request)
        handle = self._handles[goal_key(goal_id)]

        def note(answer: Future) -> None:
            handle.status = GoalStatus(answer.result().status)

        future.add_done_callback(note)
        return future

    def ask_cancel(self, goal_id: Any) -> Future:
        """See :meth:`ClientGoalHandle.cancel_goal_async`."""
        request = interface_module("action_msgs", "srv").CancelGoal.Request()
        request.goal_info.goal_id = goal_id
        future: Future = self._cancel.call_async(request)
        return future

    def destroy(self) -> None:
        """End it."""
        self._node.destroy_subscription(self._feedback)

    def _on_feedback(self, message: Any) -> None:
        hear = self._hears.get(goal_key(message.goal_id))
        if hear is not None:
            hear(message)

    def _new_identity(self) -> Any:
        numbers = np.frombuffer(self._draw.randbytes(16), dtype=np.uint8)
        return message_class("unique_identifier_msgs/msg/UUID")(uuid=numbers)
