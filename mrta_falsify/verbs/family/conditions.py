"""The learned box in words: conditions on dimensions, and the nearest neighbours that pass."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.findings import Condition, ConditionFate
from mrta_falsify.verbs.family.learning import BoxSearch

MOST_NEIGHBOURS = 3  # that pass, named


def conditions_of(search: BoxSearch) -> tuple[Condition, ...]:
    """Put the learned rule in words, in the order of the dimensions."""
    free = set(search.free)
    conditions = []
    for i, value in enumerate(search.case.u):
        if i in free:
            continue
        low, high = search.box.get(i, (float(value), float(value)))
        fate: ConditionFate = "interval" if high > low else "held"
        conditions.append(
            Condition(
                dimension=search.runs.program.space.dimensions[i].name,
                fate=fate if i in search.ruling else "unknown",
                low=low,
                high=high,
                text=_text(search, i, low, high),
            )
        )
    return tuple(conditions)


def passing_neighbours(search: BoxSearch) -> tuple[str, ...]:
    """Describe the nearest points that pass by their values outside the rule."""
    graded = sorted(search.box)
    center = search.case.u[graded]

    def distance(u: Array) -> float:
        return float(np.abs(u[graded] - center).max())

    texts = []
    for u in sorted(search.passing, key=distance):
        outside = [i for i in graded if not search.box[i][0] <= u[i] <= search.box[i][1]]
        if outside:
            values = (_text(search, i, float(u[i]), float(u[i])) for i in outside)
            texts.append(", ".join(values))
    return tuple(dict.fromkeys(texts))[:MOST_NEIGHBOURS]


def _text(search: BoxSearch, number: int, low: float, high: float) -> str:
    """Write a condition in the program's units, at the other values of the failure."""
    program = search.runs.program
    dimension = program.space.dimensions[number]
    values: list[float] = []
    for share in (low, high):
        u = np.array(search.case.u)
        u[number] = share
        (value,) = program.values_at(u, [number])
        if value is None and dimension.low is not None and dimension.high is not None:
            value = dimension.low + share * (dimension.high - dimension.low)
        if value is None or dimension.kind == "opaque":
            return f"{dimension.name} as in the failure"
        values.append(value)
    if dimension.kind == "choice":
        return f"{dimension.name} is option {values[0] + 1:.0f} of {dimension.choices}"
    if low == high:
        return f"{dimension.name} = {values[0]:.4g}"
    return f"{dimension.name} from {min(values):.4g} to {max(values):.4g}"
