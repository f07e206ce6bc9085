"""Which robots may be stuck, so that a forecast is worth its time."""

from __future__ import annotations

from typing import NamedTuple

from mrta_falsify.core.arrays import Array
from mrta_falsify.specs.deadlock.reduction import ReducedGraph, idle_robots

HARDLY_STUCK = 2.0  # s; at the end of an episode a robot that has stood for less is no suspect


class AskAfter(NamedTuple):
    """Times after which a robot is suspected [s]."""

    stuck: float  #: of being stuck by the reduced wait-for graph
    standing: float  #: of standing with a goal
    behind_people: float  #: of standing with nothing but people in its way


def find_suspects(
    graph: ReducedGraph,
    stuck_for: Array,
    stands_for: Array,
    limits: AskAfter,
    *,
    is_last: bool,
) -> set[int]:
    """Find the robots that may be stuck.

    Args:
        graph: reduced wait-for graph.
        stuck_for: ``(N,)`` for how long each robot has been stuck [s].
        stands_for: ``(N,)`` for how long each robot has stood on its spot [s].
        limits: when a robot is suspected.
        is_last: whether the episode ends, so that a later look cannot find the robot.
    """
    edges = graph.edges
    suspects = {i for i in graph.stuck if is_last or stuck_for[i] > limits.stuck}
    busy = set(edges) - idle_robots(edges)
    standing = HARDLY_STUCK if is_last else limits.standing
    suspects |= {i for i in busy if stands_for[i] > standing}
    behind_people = {i for i in busy if all(edge.cause == "human" for edge in edges[i])}
    return suspects | {i for i in behind_people if stands_for[i] > limits.behind_people}
