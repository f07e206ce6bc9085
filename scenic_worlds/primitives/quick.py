"""Shortcuts for the two values that most of a sample's time goes into: objects and headings.

Both give what Scenic itself would; they only leave out what is the same in every sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from scenic.core.distributions import FunctionDistribution, needsSampling, underlyingFunction
from scenic.core.object_types import Constructible, Object, Point
from scenic.core.vectors import Orientation
from scipy.spatial.transform import Rotation

#: values of dependencies in, sampled value out
Compute = Callable[[Any], Any]

_FROM_EULER = underlyingFunction(Orientation.fromEuler)


def quick_compute(node: Any) -> Compute:
    """Choose how to compute a value of a program: by a shortcut where one is known.

    Args:
        node: any value that needs sampling, after conditioning.
    """
    if isinstance(node, FunctionDistribution) and node.function is _FROM_EULER:
        return _orientation(node)
    if isinstance(node, Object) and _is_ordinary(node):
        return _object(node)
    compute: Compute = node.sampleGiven
    return compute


def _is_ordinary(thing: Any) -> bool:
    """Whether an object is built as Scenic's classes are, and its view angles are fixed."""
    kind = type(thing)
    return (
        kind.__init__ is Object.__init__
        and kind.sampleGiven is Point.sampleGiven
        and not needsSampling(thing.viewAngles)
    )


def _object(thing: Any) -> Compute:
    """Copy the first sampled object and fill in the random properties."""
    kind: Any = type(thing)
    random = [(p, getattr(thing, p)) for p in thing.properties if needsSampling(getattr(thing, p))]
    mutates = needsSampling(thing.mutationScale) or thing.mutationScale != 0
    template: dict[str, Any] = {}

    def compute(value: Any) -> Any:
        if not template:
            first = Constructible.sampleGiven(thing, value)
            template.update(object.__getattribute__(first, "__dict__"))
        made = kind.__new__(kind, _internal=True)
        fields = object.__getattribute__(made, "__dict__")
        fields.update(template)
        for name, part in random:
            fields[name] = value[part]
        fields["hw"] = half_width = fields["width"] / 2
        fields["hl"] = half_length = fields["length"] / 2
        fields["hh"] = half_height = fields["height"] / 2
        fields["radius"] = math.hypot(half_width, half_length, half_height)
        fields["_relations"] = []
        fields["_dynamicProxy"] = fields["_conditioned"] = made
        return _mutated(thing, made, value) if mutates else made

    return compute


def _mutated(thing: Any, made: Any, value: Any) -> Any:
    """As ``Point.sampleGiven`` does it."""
    if value[thing.mutationScale] == 0:
        return made
    for mutator in thing.mutator:
        if mutator is None:
            continue
        made, proceed = mutator.appliedTo(made)
        if not proceed:
            break
    made._recomputeDynamicFinals()
    return made


def _orientation(node: Any) -> Compute:
    """Rotation about the vertical without scipy's general path."""
    _, yaw, pitch, roll = node.arguments

    def compute(value: Any) -> Any:
        if value[pitch] != 0 or value[roll] != 0:
            return node.sampleGiven(value)
        half = value[yaw] / 2
        return Orientation(Rotation.from_quat((0.0, 0.0, math.sin(half), math.cos(half))))

    return compute
