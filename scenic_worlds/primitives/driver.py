"""A compiled Scenic program as a function of a point of the unit cube."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scenic.core.distributions import TupleDistribution, needsSampling
from scenic.core.object_types import Point
from scenic.core.scenarios import Scenario
from scenic.core.utils import DefaultIdentityDict
from scenic.core.vectors import Vector

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.candidate import Dimension, SearchSpace
from scenic_worlds.checking import names_in_worlds
from scenic_worlds.primitives.charts import Axis
from scenic_worlds.primitives.leaves import Coordinates, DrivenLeaf, DrivenMutator
from scenic_worlds.primitives.naming import Found, Root, find_primitives, roots_of
from scenic_worlds.primitives.plan import EvaluationPlan, NodeRejected

#: properties of an object that decide where it is and what it touches
GEOMETRY = (
    "position",
    "orientation",
    "heading",
    "shape",
    "width",
    "length",
    "height",
    "allowCollisions",
    "regionContainedIn",
    "active",
)


@dataclass(frozen=True, slots=True)
class Unit:
    """Coordinates that one primitive or mutator owns."""

    name: str
    start: int
    stop: int


class Driver:
    """Drives every random primitive of a scenario; the scenario stays changed.

    Sets of units are kept as bit sets in an ``int``: bit i is unit i.

    Args:
        scenario: compiled by Scenic, not driven before.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.names = names_in_worlds(scenario.objects)  #: of the objects, as in the worlds
        self.source = Coordinates()
        self._roots = roots_of(scenario)
        self._units: list[Unit] = []
        self._dimensions: list[Dimension] = []
        self._unit_of: dict[int, int] = {}
        self._mutations: dict[int, int] = {}
        self._primitives: dict[int, Any] = {}  # first coordinate -> what has its value
        for found in find_primitives(self._roots):
            self._drive_leaf(found)
        for root in self._roots:
            self._drive_mutators(root)
        self.space = SearchSpace(tuple(self._dimensions))
        self.units = tuple(self._units)
        # one order for every process, also for Scenic's own sampling and serialisation
        scenario.dependencies = tuple(root.value for root in self._roots)
        self._plan = EvaluationPlan(scenario.dependencies, self._unit_of, self._mutations)

    def _drive_leaf(self, found: Found) -> None:
        proxy = found.value._conditioned
        leaf = DrivenLeaf(
            proxy, self.source, is_choice=found.is_choice, options=found.options, words=found.words
        )
        leaf.place(len(self._dimensions))
        found.value.conditionTo(leaf)
        self._unit_of[id(found.value)] = len(self._units)
        self._primitives[leaf.start] = found.value
        self._add_unit(found.name, leaf.axes, [f".{i}" for i in range(len(leaf.axes))])

    def _drive_mutators(self, root: Root) -> None:
        thing = root.value._conditioned
        if not isinstance(thing, Point) or _never_mutates(thing):
            return
        driven: list[Any] = []
        for mutator in thing.mutator:
            if mutator is None:
                driven.append(None)
                continue
            replacement = DrivenMutator(mutator, self.source)
            replacement.place(len(self._dimensions))
            driven.append(replacement)
            if replacement.axes:
                unit = len(self._units)
                key = id(root.value)
                self._mutations[key] = self._mutations.get(key, 0) | 1 << unit
                names = [f".{name}" for name in replacement.names or ("mutation",)]
                self._add_unit(root.name, replacement.axes, names, always=True)
        object.__setattr__(thing, "mutator", tuple(driven))

    def _add_unit(
        self, name: str, axes: tuple[Axis, ...], suffixes: list[str], *, always: bool = False
    ) -> None:
        start = len(self._dimensions)
        for axis, suffix in zip(axes, suffixes, strict=True):
            full = name + suffix if always or len(axes) > 1 else name
            self._dimensions.append(
                Dimension(
                    name=full,
                    kind=axis.kind,
                    low=axis.low,
                    high=axis.high,
                    choices=axis.choices,
                    values=axis.values,
                    options=axis.options,
                )
            )
        self._units.append(Unit(name, start, len(self._dimensions)))

    # --- evaluation ----------------------------------------------------------------------

    def begin(self) -> Sample:
        """Begin a sample of which nothing is known yet."""
        return Sample(self.source, self._plan)

    def restrict(self, intervals: Mapping[int, tuple[float, float]]) -> None:
        """Let some coordinates move within an interval only, all others freely.

        The unit cube is mapped onto the box of the intervals, so that a uniform point gives
        what the program would give if it were conditional on the box.

        Args:
            intervals: least and largest share, in [0, 1], by number of the coordinate.
        """
        self.source.intervals = dict(intervals)

    def value_of(self, sample: Sample, place: int) -> float | None:
        """Look up the value that belongs to a coordinate; None if it is not a number.

        Args:
            sample: complete.
            place: number of the coordinate.
        """
        unit = next(unit for unit in self.units if unit.start <= place < unit.stop)
        primitive = self._primitives.get(unit.start)
        value = None if primitive is None else sample.values[primitive]
        if isinstance(value, Vector) and unit.stop - unit.start > 1:
            return float(value[place - unit.start])
        return float(value) if isinstance(value, (int, float)) else None

    # --- who owns what -------------------------------------------------------------------

    @property
    def roots(self) -> tuple[Root, ...]:
        """Everything that scenes contain or requirements use, as long as it is random."""
        return self._roots

    @property
    def all_units(self) -> int:
        """Every unit."""
        return (1 << len(self.units)) - 1

    def units_of(self, value: Any) -> int:
        """Find the units that a value of the program depends on, as a bit set."""
        if not needsSampling(value):
            return 0
        return self._plan.units_of(value)

    def units_of_label(self, label: str) -> int:
        """Find the units of an object, ``param NAME`` or ``param NAME[i]``; 0 if unknown."""
        for item, name in self.names.items():
            if name == label:
                return self.units_of(item)
        match = re.fullmatch(r"param (\w+)(?:\[(\d+)\])?", label)
        if match is None:
            return 0
        value = self.scenario.params.get(match[1])
        parts = value.coordinates if isinstance(value, TupleDistribution) else ()
        if match[2] is not None and int(match[2]) < len(parts):
            value = parts[int(match[2])]
        return self.units_of(value)

    def geometry_units(self, thing: Any) -> int:
        """Find the units that decide where an object is and what it touches."""
        units = self._mutations.get(id(thing), 0)
        for name in GEOMETRY:
            units |= self.units_of(getattr(thing, name, None))
        return units

    def depends_on(self, thing: Any, other: Any) -> bool:
        """Whether object ``thing`` is computed from object ``other``."""
        return self._plan.depends_on(thing, other)

    def steps(self, needed: Iterable[Any], units: int) -> tuple[int, ...]:
        """List what to compute anew for the values ``needed`` when ``units`` change, in order."""
        return self._plan.between(needed, units)

    def coordinates(self, units: int) -> BoolArray:
        """Mark which of the k coordinates belong to ``units``, ``(k,)``."""
        mask = np.zeros(len(self.space), dtype=np.bool_)
        for number in bits(units):
            mask[self.units[number].start : self.units[number].stop] = True
        return mask


class Sample:
    """Values of a program at one point of the unit cube, moved from point to point.

    Attributes:
        values: of everything random in the program; complete unless :meth:`move` raised.
    """

    def __init__(self, source: Coordinates, plan: EvaluationPlan) -> None:
        self.values = DefaultIdentityDict()
        self._source = source
        self._plan = plan
        self._left: Sequence[int] = range(len(plan))

    def move(self, u: Array, changed: int) -> None:
        """Compute what depends on the units ``changed``, and what was left when it last failed.

        Args:
            u: ``(k,)``, the same as before but for the coordinates of ``changed``.
            changed: units, as a bit set.

        Raises:
            NodeRejected: a value cannot be computed here.
        """
        self._source.set(u)
        numbers = self._left
        if len(numbers) < len(self._plan):
            numbers = sorted({*numbers, *self._plan.dependents(changed)})
        try:
            self._plan.evaluate(self.values, numbers)
        except NodeRejected as rejected:
            self._left = numbers[rejected.done :]
            raise
        self._left = ()

    def nudge(self, places: list[int], values: list[float], numbers: Sequence[int]) -> None:
        """Change some coordinates and compute some values, nothing else; see :meth:`Driver.steps`.

        Raises:
            NodeRejected: a value cannot be computed here.
        """
        self._source.change(places, values)
        self._plan.evaluate(self.values, numbers)


def bits(number: int) -> Iterable[int]:
    """Yield the positions of the bits set in ``number``, ascending."""
    while number:
        low = number & -number
        yield low.bit_length() - 1
        number ^= low


def _never_mutates(thing: Any) -> bool:
    return not needsSampling(thing.mutationScale) and thing.mutationScale == 0
