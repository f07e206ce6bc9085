"""What the stand-in does not have is refused by its name."""

from __future__ import annotations

import importlib
from collections.abc import Collection
from types import ModuleType
from typing import Any

#: names of ``rclpy.node.Node`` (Humble) that the stand-in has not
KNOWN_NODE_NAMES = frozenset(
    (
        "add_post_set_parameters_callback",
        "add_pre_set_parameters_callback",
        "create_service_event_publisher",
        "describe_parameter",
        "describe_parameters",
        "get_client_names_and_types_by_node",
        "get_node_names",
        "get_node_names_and_namespaces",
        "get_publisher_names_and_types_by_node",
        "get_publishers_info_by_topic",
        "get_service_names_and_types",
        "get_service_names_and_types_by_node",
        "get_subscriber_names_and_types_by_node",
        "get_subscriptions_info_by_topic",
        "remove_waitable",
        "set_descriptor",
        "set_parameters_callback",
        "wait_for_node",
    )
)


def refusing(name: str, members: dict[str, Any], known: Collection[str] = ()) -> ModuleType:
    """Make a module that says so when it is asked for something else.

    Args:
        name: of the module.
        members: that it has.
        known: full names of modules that can be imported, those under it among them.
    """
    module = ModuleType(name)
    vars(module).update(members)
    module.__path__ = []  # a package: what is under it is refused by name as well

    def missing(member: str) -> Any:
        if f"{name}.{member}" in known:
            return importlib.import_module(f"{name}.{member}")
        if member.startswith("__"):
            raise AttributeError(member)
        raise AttributeError(f"the stand-in for ROS 2 has no {name}.{member}")

    module.__getattr__ = missing  # type: ignore[method-assign]
    return module
