"""Which stuck robots belong together, and which of them are members of the deadlock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot, awaited_by, knots_of


class StuckGroup(NamedTuple):
    """Robots that hold each other up for good."""

    members: tuple[int, ...]  #: who hold each other, and whom no other robot holds
    robots: tuple[int, ...]  #: members and victims, those to come included


def stuck_groups(
    stuck: Iterable[int],
    freed: Mapping[int, set[int]],
    edges: EdgesByRobot | None = None,
) -> list[StuckGroup]:
    """Split stuck robots into groups that hold each other up, and name the members.

    A robot *holds* those who go free without it, and whom they hold. Members are robots of whom
    each holds each other one, and whom no other robot holds; victims are whom they hold.

    Args:
        stuck: robots that never make progress again.
        freed: for each of them, who goes free without it.
        edges: the wait-for graph, for robots of whom no single removal frees any other.

    Returns:
        The groups. Robots whom no removal frees, and that free no other, are told apart by the
        graph: knots are groups, and who waits for a group is its victim.
    """
    stuck = sorted(stuck)
    holds = {i: _held_by(i, freed) for i in stuck}
    found: list[StuckGroup] = []
    for i in stuck:
        holders = {j for j in stuck if i in holds[j]} - {i}
        if not holds[i] or not holders <= holds[i]:
            continue
        group = StuckGroup(tuple(sorted({i} | holders)), tuple(sorted({i} | holds[i])))
        if group not in found:
            found.append(group)
    alone = [i for i in stuck if not any(i in group.robots for group in found)]
    graph = edges or {}
    knots = [StuckGroup(knot, knot) for knot in knots_of(alone, graph)]
    found += [knot for knot in knots if not _leads_to(knot.members, found, stuck, graph)]
    for i in alone:
        if any(i in group.robots for group in found):
            continue
        k = _leads_to((i,), found, stuck, graph)[0]
        found[k] = StuckGroup(found[k].members, tuple(sorted({*found[k].robots, i})))
    return found


def _held_by(i: int, freed: Mapping[int, set[int]]) -> set[int]:
    """Find whom robot ``i`` holds, directly or through others."""
    held: set[int] = set()
    border = [i]
    while border:
        new = freed.get(border.pop(), set()) - held - {i}
        held |= new
        border += new
    return held


def _leads_to(
    robots: tuple[int, ...], groups: list[StuckGroup], stuck: list[int], edges: EdgesByRobot
) -> list[int]:
    """Find the groups, by index, for whose robots one of ``robots`` waits; itself left out."""
    awaited = {j for i in robots for j in awaited_by(i, stuck, edges)} - set(robots)
    return [k for k, group in enumerate(groups) if awaited & set(group.robots)]
