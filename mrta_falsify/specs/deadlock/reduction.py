"""Reduction of the wait-for graph: strike out whoever may still move; the rest is stuck.

Reference: Holt, "Some deadlock properties of computer systems", ACM Computing Surveys 4(3), 1972.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot


@dataclass(frozen=True, slots=True)
class ReducedGraph:
    """The wait-for graph of one moment after its reduction."""

    edges: EdgesByRobot  #: of all robots, not only of the stuck ones
    permanent: frozenset[BlockedBy]  #: edges to something that will never move
    stuck: frozenset[int]  #: robots that the reduction leaves over


def idle_robots(edges: EdgesByRobot) -> set[int]:
    """Find the robots that wait for a task."""
    return {i for i, own in edges.items() if own[0].cause == "task"}


def stuck_robots(
    edges: EdgesByRobot, permanent: Collection[BlockedBy], may_move: Collection[int]
) -> frozenset[int]:
    """Reduce the graph until every robot left waits only for stuck robots or permanent things.

    Args:
        edges: of all robots.
        permanent: edges to something that will never move.
        may_move: robots that may move again whatever their edges say.
    """
    stuck = {i for i in edges if i not in may_move}
    while True:
        reducible = {
            i
            for i in stuck
            if any(
                edge not in permanent and (edge.cause == "human" or edge.other not in stuck)
                for edge in edges[i]
            )
        }
        if not reducible:
            return frozenset(stuck)
        stuck -= reducible
