"""Who is a member of a deadlock, and who only waits behind it: by removals.

``i`` *holds* ``j`` if both are stuck and ``j`` reaches its next stop once ``i`` is gone. Members
are the robots of a set in which each holds each other one, directly or through others, and which
no robot outside of it holds. Victims are the stuck robots that are held from outside of theirs.

So both of a head-on pair are members, and all of a ring. Of a chain the root alone is one, also if
those behind it hold each other in turn. A robot that holds none and is held by none is alone.

Where several robots block each other so that no single one's absence helps (two against two in
single file), the smallest sets are removed whose absence lets another one through. The robots of
all such sets are members then.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

LARGEST_SET = 2  # robots removed at once: two against two in single file needs two

#: who of the stuck robots reaches its next stop without these
FreedWithout = Callable[[tuple[int, ...]], Collection[int]]


class Group(NamedTuple):
    """A deadlock and those who wait behind it."""

    members: tuple[int, ...]
    victims: tuple[int, ...]


def groups_of(stuck: Collection[int], freed_without: FreedWithout) -> list[Group]:
    """Split stuck robots into deadlocks.

    Args:
        stuck: robots that never reach their next stop.
        freed_without: tries a removal.
    """
    robots = sorted(stuck)
    holds = {i: set(freed_without((i,))) & set(robots) - {i} for i in robots} if robots[1:] else {}
    reach = {i: _reachable(i, holds) for i in robots}
    found, placed = [], set()
    for i in robots:
        members = {j for j in reach[i] if i in reach[j]} | {i}
        if i in placed or any(i in reach[j] for j in robots if j not in members):
            continue
        placed |= members
        found.append(Group(tuple(sorted(members)), tuple(sorted(reach[i] - members))))
    alone = [g.members[0] for g in found if len(g.members) == 1 and not g.victims]
    if len(alone) < LARGEST_SET + 1:
        return found
    together = _held_by_sets(alone, freed_without)
    rest = [g for g in found if not set(g.members) & set(together.members + together.victims)]
    return [*rest, together] if together.members else found


def _reachable(start: int, holds: Mapping[int, Collection[int]]) -> set[int]:
    """Robots that ``start`` holds, directly or through others."""
    reached: set[int] = set()
    border = [start]
    while border:
        new = set(holds.get(border.pop(), ())) - reached
        reached |= new
        border += sorted(new)
    return reached


def _held_by_sets(robots: Collection[int], freed_without: FreedWithout) -> Group:
    """Find the robots of the smallest sets that hold others; none: each stands alone."""
    for size in range(2, LARGEST_SET + 1):
        tried = {gone: set(freed_without(gone)) for gone in itertools.combinations(robots, size)}
        holding = {gone: freed & set(robots) - set(gone) for gone, freed in tried.items()}
        members = {i for gone, freed in holding.items() if freed for i in gone}
        if members:
            victims = set().union(*holding.values()) - members
            return Group(tuple(sorted(members)), tuple(sorted(victims)))
    return Group((), ())
