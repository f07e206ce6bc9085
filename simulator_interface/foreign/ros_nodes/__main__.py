"""Run a user's nodes as a stack.

``--stack "exec:python -m simulator_interface.foreign.ros_nodes LAUNCH.yaml"``
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import Any

from mrta_falsify.core.errors import InputError
from simulator_interface.clients.mrta_stack import serve
from simulator_interface.foreign.robot_topics import RobotTopics
from simulator_interface.foreign.ros_nodes.launching import LaunchFile, launches_of, read_launch
from simulator_interface.foreign.ros_nodes.node_stack import NodeGraph, NodeStack
from simulator_interface.foreign.ros_nodes.ros_messages import message_class


def main(arguments: list[str]) -> None:
    """Read the launch file and answer the harness."""
    if len(arguments) != 1:
        sys.exit("usage: python -m simulator_interface.foreign.ros_nodes LAUNCH.yaml")
    path = Path(arguments[0]).resolve()
    try:
        launch = read_launch(path)
    except InputError as error:
        sys.exit(str(error))
    serve(
        functools.partial(_stack, launch, path.parent),
        name=launch.name,
        says=launch.says,
        can=("branch",) if launch.forks else (),
    )


def _stack(launch: LaunchFile, folder: Path, world: dict[str, Any], harness: Any) -> NodeStack:
    topics = RobotTopics(world, launch.topics, lambda kind: message_class(kind)())
    try:
        graph = NodeGraph(
            world,
            launches_of(launch.programs, topics.robots),
            folders=[str(folder / name) for name in launch.folders],
            interfaces=[str(folder / name) for name in launch.interfaces],
        )
    except (InputError, ValueError) as error:
        sys.exit(str(error))
    return NodeStack(graph, topics, harness, launch.drives)


if __name__ == "__main__":
    main(sys.argv[1:])
