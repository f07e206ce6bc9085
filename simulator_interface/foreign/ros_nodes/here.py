"""The stack that runs in this process, and which of its programs is at work."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simulator_interface.foreign.ros_nodes.fibres import Timeline
    from simulator_interface.foreign.ros_nodes.ros_graph import Graph
    from simulator_interface.foreign.ros_nodes.ros_programs import RunningProgram

_graphs: list[Graph] = []  # the last one counts


def enter(graph: Graph) -> None:
    """Set the graph of nodes that user code sees."""
    _graphs[:] = [graph]


def graph() -> Graph:
    """Give the graph of nodes.

    Raises:
        RuntimeError: there is none.
    """
    if not _graphs:
        raise RuntimeError("nodes run only inside a stack that the harness has started")
    return _graphs[-1]


def timeline() -> Timeline:
    """Give the simulated time of the graph."""
    return graph().timeline


def program() -> RunningProgram:
    """Give the program that is at work.

    Raises:
        RuntimeError: none is.
    """
    return timeline().fibre().program  # type: ignore[return-value]
