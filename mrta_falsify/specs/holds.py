"""How long robots were held, and by whom or what.

Folds blocked-by edges into seconds. A robot is held while an edge says that a person, another
robot or a solid keeps it from moving on; two edges at once hold it once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.world import World

LITTLE = 0.1  # of a time; who was held for less of it was held by nothing
LARGE = 0.25  # of the time in which a robot was held; a kind that held it for less is left out
MAX_HOLDERS = 4  # whom or what the evidence names
_ANY = ("", "")  # key of what holds a robot, whatever it is


def kind_of(edge: BlockedBy) -> str:
    """Name the kind of what holds a robot: person, robot or solid; empty: nothing that is seen."""
    if edge.other >= 0:
        return "person" if edge.cause == "human" else "robot"
    return "solid" if edge.cause in ("wall", "no-path") else ""


@dataclass(slots=True)
class _Hold:
    """By whom or what one robot was held; a key is a kind, and a name or nothing."""

    since: float  #: what came before is not counted [s]
    spent: dict[tuple[str, str], float] = field(default_factory=dict)  #: over [s]
    begun: dict[tuple[str, str], float] = field(default_factory=dict)  #: of what goes on [s]


class Holds:
    """Adds up how long each robot was held since it made progress; one object per episode."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._holds: dict[int, _Hold] = {}  # of the robots that were held
        self._edges: tuple[BlockedBy, ...] = ()

    def update(self, edges: tuple[BlockedBy, ...], time: float, since: Array) -> None:
        """Take in a tick.

        Args:
            edges: that hold from ``time`` on; the same object if nothing has changed.
            time: [s].
            since: ``(N,)`` last progress of each robot [s].
        """
        if edges is self._edges:
            return
        self._edges = edges
        keys = self._keys(edges)
        for i, hold in self._holds.items():
            for key in hold.begun.keys() - keys.get(i, set()):
                hold.spent[key] = hold.spent.get(key, 0.0) + time - hold.begun.pop(key)
        for i, held in keys.items():
            hold = self._holds.setdefault(i, _Hold(float(since[i])))
            for key in held - hold.begun.keys():
                hold.begun[key] = time

    def forget(self, since: Array) -> None:
        """Leave out what came before the last progress of each robot, ``(N,)`` [s]."""
        for i, hold in list(self._holds.items()):
            last = float(since[i])
            if last > hold.since:
                hold.since, hold.spent = last, {}
                hold.begun = dict.fromkeys(hold.begun, last)
                if not hold.begun:
                    del self._holds[i]

    def evidence(self, i: int, time: float) -> dict[str, Any]:
        """Tell how long robot ``i`` was held since its last progress, until ``time`` [s].

        Returns:
            ``held_s``: the seconds in which anything held it; ``held``: by kind; ``holders``: by
            name, those that held it longest. The longest come first.
        """
        hold = self._holds.get(i, _Hold(time))
        spent = dict(hold.spent)
        for key, begun in hold.begun.items():
            spent[key] = spent.get(key, 0.0) + time - begun
        ordered = sorted(spent.items(), key=lambda item: (-item[1], item[0]))
        longest = [(key, round(seconds, 3)) for key, seconds in ordered if seconds > 0.0]
        holders = [(name, seconds) for (_, name), seconds in longest if name]
        return {
            "held_s": round(spent.get(_ANY, 0.0), 3),
            "held": {kind: seconds for (kind, name), seconds in longest if kind and not name},
            "holders": dict(holders[:MAX_HOLDERS]),
        }

    def _keys(self, edges: Iterable[BlockedBy]) -> dict[int, set[tuple[str, str]]]:
        found: dict[int, set[tuple[str, str]]] = {}
        for edge in edges:
            kind = kind_of(edge)
            if kind:
                held = found.setdefault(edge.robot, {_ANY})
                held |= {(kind, ""), (kind, self._name(edge, kind))}
        return found

    def _name(self, edge: BlockedBy, kind: str) -> str:
        if kind == "solid":
            return "" if edge.resource == "unreachable" else edge.resource
        bodies = self._world.humans if kind == "person" else self._world.robots
        return bodies[edge.other].name


def main_kinds(evidence: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Name the kinds that account for a loss of progress, sorted.

    Args:
        evidence: of ``progress``, as :meth:`Holds.evidence` completes it.

    Returns:
        Kinds that held the robot for at least a quarter of the time in which it was held; none if
        it was held for less than a tenth of the time without progress. None: the evidence is of an
        older version and does not tell.
    """
    held = evidence.get("held")
    if not isinstance(held, Mapping):
        return None
    held_s = float(evidence.get("held_s", 0.0))
    if held_s < LITTLE * (float(evidence.get("time", 0.0)) - float(evidence["since"])):
        return ()
    return tuple(sorted(kind for kind, seconds in held.items() if seconds >= LARGE * held_s))
