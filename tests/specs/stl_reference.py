"""A small, slow, obvious evaluator of discrete-time STL, to check the engine against.

Robustness as in Fainekos & Pappas, "Robustness of temporal logic specifications for
continuous-time signals", TCS 2009, on finite signals: windows are cut at the end of the
signal; an empty window makes ``always`` +inf and ``eventually`` and ``until`` -inf.
Times count in samples. ``left until right``: the left side must hold at all samples before
the one at which the right side does, not at that one. A property test holds the engine to
this on random formulas.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mrta_falsify.core.arrays import Array

Relation = Literal["<", "<=", ">", ">="]


@dataclass(frozen=True, slots=True)
class Predicate:
    """``signal relation bound``."""

    signal: str
    relation: Relation
    bound: float


@dataclass(frozen=True, slots=True)
class Not:
    """Negation."""

    inner: Node


@dataclass(frozen=True, slots=True)
class Junction:
    """``and``, ``or`` or ``->`` of two formulas."""

    operator: Literal["and", "or", "->"]
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Temporal:
    """``always``, ``eventually``, ``historically`` or ``once`` over a window of samples."""

    operator: Literal["always", "eventually", "historically", "once"]
    low: int
    high: int | None  #: None: no limit
    inner: Node


@dataclass(frozen=True, slots=True)
class Until:
    """``left until[low, high] right``."""

    low: int
    high: int | None  #: None: no limit
    left: Node
    right: Node


Node = Predicate | Not | Junction | Temporal | Until


def to_text(node: Node) -> str:
    """The formula in the syntax that users write, fully bracketed."""
    match node:
        case Predicate(signal, relation, bound):
            return f"({signal} {relation} {bound!r})"
        case Not(inner):
            return f"(not {to_text(inner)})"
        case Junction(operator, left, right):
            return f"({to_text(left)} {operator} {to_text(right)})"
        case Temporal(operator, low, high, inner):
            return f"({operator}{_window(low, high)} {to_text(inner)})"
        case Until(low, high, left, right):
            return f"({to_text(left)} until{_window(low, high)} {to_text(right)})"


def _window(low: int, high: int | None) -> str:
    return "" if high is None else f"[{low}, {high}]"


def robustness(node: Node, signals: Mapping[str, Array]) -> Array:
    """Robustness ``(K,)`` of ``node`` at every sample of ``signals``, each ``(K,)``."""
    match node:
        case Predicate(signal, relation, bound):
            margin = signals[signal] - bound
            return margin if relation in (">", ">=") else -margin
        case Not(inner):
            return -robustness(inner, signals)
        case Junction(operator, left, right):
            a, b = robustness(left, signals), robustness(right, signals)
            if operator == "and":
                return np.minimum(a, b)
            return np.maximum(-a if operator == "->" else a, b)
        case Temporal(operator, low, high, inner):
            return _windowed(operator, low, high, robustness(inner, signals))
        case Until(low, high, left, right):
            return _until(low, high, robustness(left, signals), robustness(right, signals))


def _windowed(operator: str, low: int, high: int | None, inner: Array) -> Array:
    count = len(inner)
    worst = operator in ("always", "historically")
    past = operator in ("historically", "once")
    result = np.empty(count)
    for k in range(count):
        if past:
            first, last = (0 if high is None else max(0, k - high)), k - low
        else:
            first, last = k + low, (count - 1 if high is None else min(count - 1, k + high))
        window = inner[first : last + 1] if last >= first else inner[:0]
        if worst:
            result[k] = window.min(initial=np.inf)
        else:
            result[k] = window.max(initial=-np.inf)
    return result


def _until(low: int, high: int | None, left: Array, right: Array) -> Array:
    count = len(left)
    result = np.full(count, -np.inf)
    for k in range(count):
        last = count - 1 if high is None else min(count - 1, k + high)
        for m in range(k + low, last + 1):
            held = left[k:m].min(initial=np.inf)
            result[k] = max(result[k], min(right[m], held))
    return result
