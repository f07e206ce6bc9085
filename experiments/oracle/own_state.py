"""Who waits for whom, as a foreign stack has written it down itself.

A stack that remembers locks is not freed by taking a robot away: the lock stays. So members of its
deadlocks come from its own state, see :mod:`experiments.oracle.outside.driving`.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path

from experiments.oracle.membership import Group

#: for each robot that stands, why, and the robots for which it waits
Standing = dict[int, tuple[str, tuple[int, ...]]]


def state_at(path: Path, time: float) -> Standing:
    """Read why robots stood at a moment.

    Args:
        path: of the stack's file; none yet: nobody stands.
        time: [s].
    """
    found: Standing = {}
    if not path.exists():
        return found
    for line in path.read_text().splitlines():
        row = json.loads(line)
        if row["time"] > time + 1e-6:
            break
        found = {int(i): (why, tuple(robots)) for i, (why, *robots) in row["stand"].items()}
    return found


def groups_by_state(
    stuck: Collection[int], state: Standing, shut_off: Collection[int]
) -> list[Group]:
    """Split stuck robots into deadlocks by the stack's own state.

    Members are the robots of a set that wait for each other, directly or through others, and for
    no other stuck robot. A robot that is shut off waits for no robot.

    Args:
        stuck: robots that never reach their next stop.
        state: why robots stand.
        shut_off: robots to whose goal no way leads.
    """
    waits = {
        i: set() if i in shut_off else set(state.get(i, ("", ()))[1]) & set(stuck) - {i}
        for i in stuck
    }
    awaited = {i: _reachable(i, waits) for i in sorted(stuck)}
    members = {
        tuple(sorted(awaited[i] | {i})) for i in awaited if all(i in awaited[j] for j in awaited[i])
    }
    return [
        Group(knot, tuple(i for i in awaited if i not in knot and awaited[i] & set(knot)))
        for knot in sorted(members)
    ]


def _reachable(start: int, waits: Mapping[int, Collection[int]]) -> set[int]:
    reached: set[int] = set()
    border = [start]
    while border:
        new = set(waits.get(border.pop(), ())) - reached
        reached |= new
        border += sorted(new)
    return reached
