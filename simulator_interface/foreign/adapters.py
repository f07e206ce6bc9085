"""Stacks of other kinds by a short text: ``--stack ros_nodes:nodes.yaml``.

An adapter turns the text behind its name into the process that speaks the stack protocol.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Protocol

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack, bound_to, split_command
from mrta_falsify.core.registry import WithoutOptions


class StackAdapter(Protocol):
    """Gives the process that puts a stack of another kind on trial."""

    def stack(self, text: str, *, where: str, folder: Path) -> ExternalStack:
        """Give the process of a stack.

        Args:
            text: behind the adapter's name and the colon.
            where: it stands, for messages.
            folder: relative paths are relative to it.

        Raises:
            ConfigError: the text means nothing to it.
        """


class RosNodes(WithoutOptions):
    """ROS 2 nodes in Python without ROS, as a launch file of ours names them."""

    module = "simulator_interface.foreign.ros_nodes"
    needs = "a file with the nodes, as ros_nodes:nodes.yaml"

    def stack(self, text: str, *, where: str, folder: Path) -> ExternalStack:
        """See :class:`StackAdapter`."""
        if not text.strip() and self.needs:
            raise ConfigError(
                f"{where}: there is nothing behind the colon; it must be {self.needs}"
            )
        arguments = split_command(text, where=where) if text.strip() else ()
        command = (sys.executable, "-m", self.module, *arguments)
        return bound_to(ExternalStack(command=command), where=where, folder=folder)


class Dds(RosNodes):
    """Nodes of any kind on this machine, by a bridge to the middleware of ROS 2."""

    module = "simulator_interface.foreign.dds"
    needs = ""
