"""Who waits for whom among robots, as a graph: chains, cycles, and what would close one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mrta_falsify.core.fleet import BlockedBy

#: causes whose ``other`` is a robot; of ``human`` it is a person
BY_ROBOTS = frozenset(("queue", "barrier", "cluster", "no-path"))

#: robots that each robot waits for, directly
Waits = Mapping[int, frozenset[int]]


def waits_of(edges: Iterable[BlockedBy]) -> dict[int, frozenset[int]]:
    """Collect the robots that each robot waits for; those that wait for none are left out."""
    found: dict[int, set[int]] = {}
    for edge in edges:
        if edge.other >= 0 and edge.cause in BY_ROBOTS:
            found.setdefault(edge.robot, set()).add(edge.other)
    return {robot: frozenset(others) for robot, others in found.items()}


def awaited(waits: Waits, robot: int) -> frozenset[int]:
    """Find the robots that ``robot`` waits for, directly or through others."""
    reached: set[int] = set()
    border = set(waits.get(robot, ()))
    while border:
        reached |= border
        border = {other for one in border for other in waits.get(one, ())} - reached
    return frozenset(reached)


def in_cycles(waits: Waits) -> frozenset[int]:
    """Find the robots that wait for themselves through others."""
    return frozenset(robot for robot in waits if robot in awaited(waits, robot))


def followers(waits: Waits) -> dict[int, frozenset[int]]:
    """Find the robots that wait for each robot that itself waits for none."""
    found: dict[int, set[int]] = {}
    for robot in waits:
        for root in awaited(waits, robot) - waits.keys():
            found.setdefault(root, set()).add(robot)
    return {root: frozenset(robots) for root, robots in found.items()}
