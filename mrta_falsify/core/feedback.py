"""What a sampler is told about a proposal, and the cube it searches."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any, Literal

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import SearchSpace
from mrta_falsify.core.codec import later, quantity
from mrta_falsify.core.renamed import renamed_attribute

#: descriptors of how much a run asked of the stack, see :mod:`mrta_falsify.specs.loads`
LOADS = ("queue", "waiting", "chain", "crowd", "waited", "rerouted")
#: what a scene asks of any stack before it runs, see :mod:`mrta_falsify.preflight`
DEMANDS = (
    "queue",  #: robots that wait for one room
    "gathered",  #: robots that come to one room at about one time
    "sharing",  #: robots at one resource, beyond its capacity
    "waited",  #: s at rooms, all robots
    "open",  #: tasks at one time
    "uneven",  #: stops of the busiest robot
    "hurry",  #: s after its deadline that the latest task is done
    "again",  #: stops in the room of the stop before
    "ring",  #: robots that each want the room of the next one, all at about one time
    "driven",  #: m, all robots
    "narrow",  #: m, weighted with the costs of walls nearby
    "furniture",  #: m beside furniture
    "crowd",  #: robots in one spot, nearer ones counting more
    "meetings",  #: of two robots
    "head_on",  #: s that two robots are near and drive against each other
    "people",  #: s that robots drive near people
    "disturbed",  #: s that robots drive while an event lasts
)
#: a narrow place used against each other by a hair is as near as a cycle that just closed
ENCROACHMENT_COUNTS = 0.5
#: how a proposal ended, as a sampler sees it
Fate = Literal["judged", "rejected"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cube:
    """The unit cube [0, 1]^k as a sampler sees it: coordinates, and what belongs together."""

    dimensions: int = quantity(low=0, default=0)  #: k
    levels: tuple[int, ...] = ()  #: values of a discrete coordinate, 0: continuous; () : all are
    groups: tuple[int, ...] = ()  #: coordinates of one object share a number; (): none do
    owners: tuple[str, ...] = later(())  #: names of the objects by number; (): not known
    kin: tuple[int, ...] = later(())  #: coordinates that say the same of like objects share one
    labels: tuple[tuple[int, ...], ...] = later(())
    """Numbers of the values of each discrete coordinate, equal for equal ones; (): its levels."""

    def level(self, i: int) -> int:
        """Count the values of coordinate ``i``, 0: continuous."""
        return self.levels[i] if self.levels else 0

    def labels_of(self, i: int) -> tuple[int, ...]:
        """Number the values of coordinate ``i``, kin alike; () if it is continuous."""
        own = self.labels[i] if self.labels else ()
        return own or tuple(range(self.level(i)))

    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """Group the coordinates, in order of their first coordinate."""
        if not self.groups:
            return tuple((i,) for i in range(self.dimensions))
        found: dict[int, list[int]] = {}
        for i, group in enumerate(self.groups):
            found.setdefault(group, []).append(i)
        return tuple(tuple(block) for block in found.values())

    def families(self) -> tuple[tuple[int, ...], ...]:
        """Group the coordinates that say the same of several objects, in order of the objects."""
        found: dict[int, list[int]] = {}
        for i, family in enumerate(self.kin):
            found.setdefault(family, []).append(i)
        return tuple(tuple(family) for family in found.values() if len(family) > 1)

    def blocks_of(self, names: Collection[str]) -> tuple[int, ...]:
        """Find the blocks of named objects; ``tasks[3]`` stands for all of its fields."""
        return tuple(
            number
            for number, owner in enumerate(self.owners)
            if any(owner == name or owner.startswith(f"{name}[") for name in names)
        )


def cube_of(space: SearchSpace) -> Cube:
    """Build the cube of a search space.

    A dimension's object is its name up to the first dot; each parameter is one. Dimensions are kin
    whose names differ in the first number only (``tasks[0][2]`` and ``tasks[1][2]``), if their
    values are known or as many.
    """
    owners = [_owner(dimension.name) for dimension in space.dimensions]
    numbers = {owner: i for i, owner in enumerate(dict.fromkeys(owners))}
    fields = [
        (
            re.sub(r"\d+", "#", dimension.name, count=1),
            dimension.kind,
            0 if dimension.values else dimension.choices,
        )
        for dimension in space.dimensions
    ]
    values = dict.fromkeys(value for dimension in space.dimensions for value in dimension.values)
    label_of = {value: number for number, value in enumerate(values)}
    families = {name: i for i, name in enumerate(dict.fromkeys(fields))}
    return Cube(
        dimensions=len(space.dimensions),
        levels=tuple(
            dimension.choices if dimension.kind in ("choice", "integer") else 0
            for dimension in space.dimensions
        ),
        groups=tuple(numbers[owner] for owner in owners),
        owners=tuple(numbers),
        kin=tuple(families[name] for name in fields),
        labels=tuple(
            tuple(label_of[value] for value in dimension.values) for dimension in space.dimensions
        ),
    )


def _owner(name: str) -> str:
    """Name the object of a dimension: ``bed1.position.0`` is of ``bed1``."""
    return name if name.startswith("param ") else name.split(".", 1)[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feedback:
    """Result of one proposal.

    Objectives are normalised margins of the judged specifications: larger is safer, below 0
    is a violation, and 1 is about as safe as the specification can tell. The score is one
    number made of them; samplers minimise it.
    """

    number: int  #: of the proposal
    u: Array  #: (k,) realised, which repair may have moved
    fate: Fate = "judged"
    score: float = 0.0  #: smaller is closer to a violation; meaningless unless judged
    objectives: dict[str, float] = field(default_factory=dict)  #: by specification
    descriptors: dict[str, float] = field(default_factory=dict)  #: in [0, 1], what happened
    failed: bool = False  #: a specification is violated that the search is for
    signature: str = ""  #: of the failure mode, told apart by its copies; empty: no failure
    mode: str = ""  #: of the failure, whatever its copies do
    blamed: tuple[
        int, ...
    ] = ()  #: blocks of the cube that took part when it was nearest to failing

    @property
    def nearness(self) -> float:
        """How near the run came to a deadlock, 1 being nearest; 0 where that is not described."""
        cycle = self.descriptors.get("cycle", 0.0)
        return max(cycle, ENCROACHMENT_COUNTS * self.descriptors.get("encroachment", 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class SceneLoads:
    """A scene that was looked at without running it."""

    u: Array  #: (k,) realised, which repair may have moved
    demands: Array  #: (m,) by ``DEMANDS``, in units of their own; larger asks for more


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """Estimates of the probability of a violation, from a sampler that makes them.

    Such a sampler has a method ``estimates() -> Estimates``.
    """

    repeats: tuple[float, ...] = ()  #: independent, of equal law, each without bias
    uniform_trials: int = 0  #: independent uniform trials, their number fixed beforehand
    uniform_failures: int = 0  #: violations among them
    waiting_for: str = ""  #: why there are no repeats yet


def __getattr__(name: str) -> Any:
    return renamed_attribute(sys.modules[__name__], name, {"Rehearsed": "SceneLoads"})
