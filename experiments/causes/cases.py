"""Failures with one planted cause, and without one, drawn by a seed before anything explains them.

A *planted* fault is a planted defect of the stack in a world of the family that brings it out. In
half of them the configuration shows it, so that the shipped layer can be restored. In the other
half it sits *under the shipped name*: the shipped implementation of its layer has it, whatever the
configuration says, and only another implementation is free of it. The label is the layer whose
exchange for a clean implementation removes the fault.

Failures *without a cause* are hopeless deadlines, which nobody meets, rooms that a blockage shuts
during the run, and two faults of different layers each of which fails the world alone.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import defect as planted
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.stack.pipeline import Stack
from mrta_falsify.testing.planted import PLANTS
from mrta_falsify.trial import Job, judge, primary_and_secondary

ONE_IMPLEMENTATION = ("costmap",)  # layers that no row can exchange
HOPELESS = 4.0  # s after its arrival that a task is due, where nobody can be in time
SHUTS_AT, LASTS = 3.0, 1e4  # s, of a blockage around a room's stop
SHUT_SIZE = 3.0  # m, side of it
MAX_SEEDS = 400  # worlds of a family that are looked at
#: of the kind that has none, how many of each
SHARES = {"hopeless": 10, "shut": 10, "two": 10}


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One failure."""

    name: str
    kind: str  #: visible, hidden, hopeless, shut, two
    family: str  #: of worlds
    seed: int  #: of the world
    defects: tuple[str, ...] = ()
    label: str = ""  #: layer; empty: no layer of the stack

    def world(self) -> World:
        """Build its world."""
        world = PLANTS[self.family].world(self.seed)
        if self.kind == "hopeless":
            tasks = [dataclasses.replace(t, deadline=t.arrival + HOPELESS) for t in world.tasks]
            return dataclasses.replace(world, tasks=tuple(tasks))
        if self.kind == "shut":
            goal = world.rooms[world.tasks[0].end].point
            polygon = rectangle(SHUT_SIZE, SHUT_SIZE, tuple(goal))
            shut = Blockage(name="shut", polygon=polygon, start=SHUTS_AT, end=LASTS)
            return dataclasses.replace(world, events=(*world.events, shut))
        return world

    def job(self) -> Job:
        """Describe the run that fails."""
        defects = () if self.kind == "hidden" else self.defects
        config = StackConfig(engine=Choice("kinematic"), defects=defects)
        specifications, then = primary_and_secondary(self.specifications)
        return Job(
            world=self.world(),
            config=config,
            specifications=specifications,
            then=then,
            early_stop=True,
        )

    @property
    def specifications(self) -> tuple[str, ...]:
        """What it is judged by."""
        return tuple(dict.fromkeys((PLANTS[self.family].specification, *default_specifications())))


@contextlib.contextmanager
def faulty(case: Case) -> Iterator[None]:
    """Let the shipped implementations have the faults of a case of kind ``hidden``."""
    build = Stack.__init__
    shipped = StackConfig()

    def built(self: Stack, world: World, config: StackConfig, *more: object, **named: object):
        own = {
            name
            for name in case.defects
            if getattr(config, planted(name).layer) == getattr(shipped, planted(name).layer)
        }
        config = dataclasses.replace(config, defects=tuple(sorted({*config.defects, *own})))
        build(self, world, config, *more, **named)  # type: ignore[arg-type]

    if case.kind == "hidden":
        Stack.__init__ = built  # type: ignore[method-assign]
    try:
        yield
    finally:
        Stack.__init__ = build  # type: ignore[method-assign]


def fails(case: Case) -> bool:
    """Whether the run of a case fails in what is looked for first, or in its specification."""
    with faulty(case):
        try:
            judged = judge(case.job(), keep_trace=False)
        except Exception:
            return False
    wanted = PLANTS[case.family].specification
    return any(v.violated and (v.spec == wanted or judged.is_primary) for v in judged.verdicts)


def draw(seed: int, each: int) -> Iterator[Case]:
    """Draw failures: ``each`` of every defect and kind, then those without a cause."""
    random = np.random.default_rng(seed)
    for kind in ("visible", "hidden"):
        for defect in PLANTS:
            layer = planted(defect).layer
            if kind == "hidden" and layer in ONE_IMPLEMENTATION:
                continue
            found = 0
            for number in random.permutation(MAX_SEEDS)[: 10 * each]:
                case = _case(kind, defect, int(number), (defect,), layer)
                sound = _case("sound", defect, int(number), (), "")
                if found < each and fails(case) and not fails(sound):
                    found += 1
                    yield case
    families = list(PLANTS)
    for kind in ("hopeless", "shut"):
        found = 0
        while found < SHARES[kind]:
            family = families[int(random.integers(len(families)))]
            case = _case(kind, family, int(random.integers(MAX_SEEDS)), (), "")
            if fails(case):
                found += 1
                yield case
    found, tried = 0, 0
    while found < SHARES["two"] and tried < MAX_SEEDS:
        tried += 1
        family = families[int(random.integers(len(families)))]
        other = families[int(random.integers(len(families)))]
        number = int(random.integers(MAX_SEEDS))
        if planted(family).layer == planted(other).layer:
            continue
        case = _case("two", family, number, tuple(sorted((family, other))), "")
        alone = [_case("two", family, number, (name,), "") for name in (family, other)]
        if fails(case) and all(map(fails, alone)):
            found += 1
            yield case


def _case(kind: str, family: str, seed: int, defects: tuple[str, ...], label: str) -> Case:
    name = f"{kind}/{family}/{seed}"
    if kind == "two":
        name = f"{kind}/{'+'.join(defects)}/{family}/{seed}"
    return Case(name=name, kind=kind, family=family, seed=seed, defects=defects, label=label)
