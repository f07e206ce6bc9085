"""The functions of ``rclpy`` itself, for the program that is at work."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from simulator_interface.foreign.ros_nodes import executing, here, ros_logging, ros_node


class Context:
    """Whether a program's ROS runs."""

    def __init__(self) -> None:
        self._is_ok = False

    def init(self, args: Sequence[str] | None = None, **_: Any) -> None:
        """Start it."""
        self._is_ok = True

    def ok(self) -> bool:
        """Tell whether it runs."""
        return self._is_ok

    def shutdown(self) -> None:
        """End it."""
        self._is_ok = False

    try_shutdown = shutdown


def get_default_context() -> Context:
    """Give the context of the program that is at work."""
    program = here.program()
    if program.context is None:
        program.context = Context()
    context: Context = program.context
    return context


def init(*, args: Sequence[str] | None = None, context: Any = None, **_: Any) -> None:
    """Start ROS in the program that is at work."""
    (context or get_default_context()).init(args)


def ok(*, context: Any = None) -> bool:
    """Tell whether ROS runs."""
    return bool((context or get_default_context()).ok())


def shutdown(*, context: Any = None, uninstall_handlers: Any = None) -> None:
    """End ROS in the program that is at work."""
    (context or get_default_context()).shutdown()
    program = here.program()
    if program.executor is not None:
        program.executor.wake()


def get_global_executor() -> executing.Executor:
    """Give the executor of the functions below."""
    program = here.program()
    if program.executor is None:
        program.executor = executing.SingleThreadedExecutor(context=get_default_context())
    executor: executing.Executor = program.executor
    return executor


def create_node(node_name: str, **options: Any) -> ros_node.Node:
    """Make a node."""
    return ros_node.Node(node_name, **options)


def spin(one: Any, executor: Any = None) -> None:
    """Run a node's callbacks until ROS ends."""
    _with_node(one, executor, lambda ours: ours.spin())


def spin_once(one: Any, *, executor: Any = None, timeout_sec: float | None = None) -> None:
    """Run one callback of a node, or wait for it."""
    _with_node(one, executor, lambda ours: ours.spin_once(timeout_sec))


def spin_until_future_complete(
    one: Any, future: Any, executor: Any = None, timeout_sec: float | None = None
) -> None:
    """Run a node's callbacks until a future is done."""
    _with_node(one, executor, lambda ours: ours.spin_until_future_complete(future, timeout_sec))


def _with_node(one: Any, executor: Any, run: Callable[[executing.Executor], None]) -> None:
    ours = executor or get_global_executor()
    is_added = ours.add_node(one)
    try:
        run(ours)
    finally:
        if is_added:
            ours.remove_node(one)


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Leave out what stands between ``--ros-args`` and ``--``."""
    kept, is_ros = [], False
    for word in sys.argv if args is None else args:
        if word == "--ros-args":
            is_ros = True
        elif word == "--" and is_ros:
            is_ros = False
        elif not is_ros:
            kept.append(word)
    return kept


def get_logger(name: str) -> ros_logging.Logger:
    """Give a log that belongs to no node."""
    return ros_logging.Logger(here.program(), name)


try_shutdown = shutdown
