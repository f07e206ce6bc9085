"""Which stuck robots belong together, and which of them are members of the deadlock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, awaited_by, knots_of


class StuckGroup(NamedTuple):
    """Robots that hold each other up for good."""

    members: tuple[int, ...]  #: without any of whom the others go free
    robots: tuple[int, ...]  #: members and victims, those to come included


def stuck_groups(
    stuck: Iterable[int],
    freed: Mapping[int, set[int]],
    edges: EdgesByRobot | None = None,
) -> list[StuckGroup]:
    """Split stuck robots into groups that hold each other up, and name the members.

    Args:
        stuck: robots that never make progress again.
        freed: for each of them, who goes free without it.
        edges: the wait-for graph, for robots of whom no single removal frees any other.

    Returns:
        Groups whose members are those without whom all others of the group go free; where there
        is no such robot, those without whom some do. Robots whom no removal frees, and that
        free no other, are told apart by the graph: knots are groups, and who waits for a group
        is its victim.
    """
    stuck = sorted(stuck)
    joined = _joined(stuck, freed)
    groups = [group for group in joined if len(group) > 1]
    alone = [i for group in joined if len(group) == 1 for i in group]
    found = [StuckGroup(_members_of(group, freed), tuple(sorted(group))) for group in groups]
    graph = edges or {}
    knots = [StuckGroup(knot, knot) for knot in knots_of(alone, graph)]
    found += [knot for knot in knots if not _leads_to(knot.members, found, stuck, graph)]
    for i in alone:
        if any(i in group.robots for group in found):
            continue
        k = _leads_to((i,), found, stuck, graph)[0]
        found[k] = StuckGroup(found[k].members, tuple(sorted({*found[k].robots, i})))
    return found


def _joined(stuck: Iterable[int], freed: Mapping[int, set[int]]) -> list[set[int]]:
    groups: list[set[int]] = []
    for i in stuck:
        joined = {i} | freed.get(i, set())
        for group in [group for group in groups if group & joined]:
            joined |= group
            groups.remove(group)
        groups.append(joined)
    return groups


def _members_of(group: set[int], freed: Mapping[int, set[int]]) -> tuple[int, ...]:
    members = tuple(i for i in sorted(group) if freed.get(i, set()) >= group - {i})
    return members or tuple(i for i in sorted(group) if freed.get(i))


def _leads_to(
    robots: tuple[int, ...], groups: list[StuckGroup], stuck: list[int], edges: EdgesByRobot
) -> list[int]:
    """Find the groups, by index, for whose robots one of ``robots`` waits; itself left out."""
    awaited = {j for i in robots for j in awaited_by(i, stuck, edges)} - set(robots)
    return [k for k, group in enumerate(groups) if awaited & set(group.robots)]
