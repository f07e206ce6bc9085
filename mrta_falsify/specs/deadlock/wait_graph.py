"""The wait-for graph: which robot waits for which, by blocked-by edges."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from mrta_falsify.core.fleet import BlockedBy

#: blocked-by edges of each robot that has any
EdgesByRobot = dict[int, list[BlockedBy]]


def is_unexplained(edge: BlockedBy) -> bool:
    """Whether the geometry shows no reason why the robot stands."""
    return edge.other < 0 and not edge.resource and edge.cause in ("stalled", "no-path")


def edges_by_robot(edges: Iterable[BlockedBy]) -> EdgesByRobot:
    """Group edges by the robot that waits."""
    grouped: EdgesByRobot = {}
    for edge in edges:
        grouped.setdefault(edge.robot, []).append(edge)
    return grouped


def awaited_by(start: int, among: Collection[int], edges: EdgesByRobot) -> set[int]:
    """Find the robots of ``among`` that ``start`` waits for, directly or through others."""
    reached: set[int] = set()
    border = [start]
    while border:
        for edge in edges.get(border.pop(), ()):
            if edge.cause != "human" and edge.other in among and edge.other not in reached:
                reached.add(edge.other)
                border.append(edge.other)
    return reached


def knots_of(stuck: Collection[int], edges: EdgesByRobot) -> list[tuple[int, ...]]:
    """Find the knots: strongly connected components of stuck robots that no edge leaves."""
    awaited = {i: awaited_by(i, stuck, edges) for i in sorted(stuck)}
    knots = {
        tuple(sorted(awaited[i] | {i})) for i in awaited if all(i in awaited[j] for j in awaited[i])
    }
    return sorted(knots)


def rings_of(among: Collection[int], edges: EdgesByRobot) -> list[tuple[int, ...]]:
    """Find the rings: robots, two or more, each of which waits for each other one in the end."""
    awaited = {i: awaited_by(i, among, edges) for i in sorted(among)}
    rings = {
        tuple(sorted({i} | {j for j in awaited[i] if i in awaited[j]}))
        for i in awaited
        if any(i in awaited[j] for j in awaited[i] - {i})
    }
    return sorted(rings)


def victims_of(
    members: Collection[int], stuck: Collection[int], edges: EdgesByRobot
) -> frozenset[int]:
    """Find the stuck robots that wait for one of ``members``, directly or through others."""
    knot = frozenset(members)
    return frozenset(i for i in stuck if i not in knot and awaited_by(i, stuck, edges) & knot)
