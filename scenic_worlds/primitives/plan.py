"""In which order a program's values are computed, and what depends on what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from scenic.core.distributions import RejectionException, Samplable, needsSampling
from scenic.core.object_types import Constructible
from scenic.core.utils import DefaultIdentityDict

from scenic_worlds.primitives.quick import quick_compute


class NodeRejected(Exception):  # noqa: N818 - a rejection, not an error
    """A value could not be computed at this point of the unit cube.

    Args:
        reason: in Scenic's words.
        units: numbers of the units that the value depends on, as a bit set.
        done: how many of the values asked for were computed before.
    """

    def __init__(self, reason: str, units: int, done: int) -> None:
        super().__init__(reason)
        self.reason = reason
        self.units = units
        self.done = done


class EvaluationPlan:
    """All random values of a program, parts before wholes.

    Sets of units are kept as bit sets in an ``int``: bit i is unit i.

    Args:
        roots: values to compute.
        unit_of: unit number of each driven primitive, by ``id``.
        mutations: units of each object's mutators, by ``id`` of the object.
    """

    def __init__(
        self, roots: Sequence[Samplable], unit_of: Mapping[int, int], mutations: Mapping[int, int]
    ) -> None:
        self._nodes = tuple(_parts_first(roots))
        self._index = {id(node): i for i, node in enumerate(self._nodes)}
        self._sampled = tuple(quick_compute(node._conditioned) for node in self._nodes)
        self._units: list[int] = []
        self._objects: list[int] = []
        for i, node in enumerate(self._nodes):
            units = mutations.get(id(node), 0)
            if id(node) in unit_of:
                units |= 1 << unit_of[id(node)]
            objects = 1 << i if isinstance(node, Constructible) else 0
            for part in node._conditioned._dependencies:
                number = self._index.get(id(part))
                if number is not None:
                    units |= self._units[number]
                    objects |= self._objects[number]
            self._units.append(units)
            self._objects.append(objects)

    def __len__(self) -> int:
        """Count the values."""
        return len(self._nodes)

    def evaluate(self, values: DefaultIdentityDict, numbers: Sequence[int]) -> None:
        """Compute the values ``numbers``, ascending, from what ``values`` has already.

        Raises:
            NodeRejected: one cannot be computed; ``values`` is then incomplete.
        """
        storage = values.storage
        nodes, sampled = self._nodes, self._sampled
        done = 0
        try:
            for i in numbers:
                storage[id(nodes[i])] = sampled[i](values)
                done += 1
        except RejectionException as error:
            units = self._units[numbers[done]]
            raise NodeRejected(str(error) or "rejected", units, done) from None

    def dependents(self, units: int) -> list[int]:
        """List the values that depend on any of ``units``, by number, ascending."""
        return [i for i, needed in enumerate(self._units) if needed & units]

    def between(self, needed: Iterable[Any], units: int) -> tuple[int, ...]:
        """List the values that ``needed`` is made of and that depend on ``units``, by number."""
        found: set[int] = set()
        waiting = [self._index.get(id(value)) for value in needed]
        while waiting:
            number = waiting.pop()
            if number is None or number in found or not self._units[number] & units:
                continue
            found.add(number)
            parts = self._nodes[number]._conditioned._dependencies
            waiting.extend(self._index.get(id(part)) for part in parts)
        return tuple(sorted(found))

    def units_of(self, value: Any) -> int:
        """Find the units that ``value`` depends on; none if it is not part of the plan."""
        number = self._index.get(id(value))
        return 0 if number is None else self._units[number]

    def depends_on(self, value: Any, other: Any) -> bool:
        """Whether ``value`` is computed from the object ``other``."""
        number, origin = self._index.get(id(value)), self._index.get(id(other))
        if number is None or origin is None:
            return False
        return bool(self._objects[number] >> origin & 1)


def _parts_first(roots: Sequence[Samplable]) -> list[Samplable]:
    """List everything random that the roots are made of, each after what it depends on."""
    order: list[Samplable] = []
    seen: set[int] = set()
    stack: list[tuple[Samplable, bool]] = [(root, False) for root in reversed(roots)]
    while stack:
        value, expanded = stack.pop()
        if expanded:
            order.append(value)
            continue
        if id(value) in seen:
            continue
        seen.add(id(value))
        stack.append((value, True))
        parts = [part for part in value._conditioned._dependencies if needsSampling(part)]
        stack.extend((part, False) for part in reversed(parts) if id(part) not in seen)
    return order
