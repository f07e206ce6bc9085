"""The graph of who waits for whom, by blocked-by edges."""

from __future__ import annotations

from collections.abc import Iterable

from mrta_falsify.core.fleet import BlockedBy


def is_unexplained(edge: BlockedBy) -> bool:
    """Whether the geometry shows no reason why the robot stands."""
    return edge.other < 0 and not edge.resource and edge.cause in ("stalled", "no-path")


def by_robot(edges: Iterable[BlockedBy]) -> dict[int, list[BlockedBy]]:
    """Edges of each robot that has any."""
    grouped: dict[int, list[BlockedBy]] = {}
    for edge in edges:
        grouped.setdefault(edge.robot, []).append(edge)
    return grouped


def reach_of(start: int, lost: set[int], edges: dict[int, list[BlockedBy]]) -> set[int]:
    """Lost robots that ``start`` waits for, directly or through others."""
    reached: set[int] = set()
    border = [start]
    while border:
        for edge in edges[border.pop()]:
            if edge.cause != "human" and edge.other in lost and edge.other not in reached:
                reached.add(edge.other)
                border.append(edge.other)
    return reached


def cores_of(lost: set[int], edges: dict[int, list[BlockedBy]]) -> list[tuple[int, ...]]:
    """Smallest closed sets: strongly connected components that no edge leaves."""
    reach = {i: reach_of(i, lost, edges) for i in sorted(lost)}
    cores = {tuple(sorted(reach[i] | {i})) for i in reach if all(i in reach[j] for j in reach[i])}
    return sorted(cores)


def waiting_on(
    members: tuple[int, ...], lost: set[int], edges: dict[int, list[BlockedBy]]
) -> set[int]:
    """Lost robots that wait for one of ``members``, directly or through others."""
    core = set(members)
    return {i for i in lost - core if reach_of(i, lost, edges) & core}
