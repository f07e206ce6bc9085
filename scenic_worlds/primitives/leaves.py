"""Scenic's random primitives replaced by inverse maps of coordinates in [0, 1].

Scenic lets any random value be conditioned to another (``conditionTo``, the hook its own
pruning uses). A :class:`DrivenLeaf` stands for one primitive and takes its value from the
coordinates it owns; everything computed from primitives is left to Scenic.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scenic.core.distributions import (
    DiscreteRange,
    Distribution,
    Normal,
    Range,
    RejectionException,
    Samplable,
    TruncatedNormal,
    needsSampling,
    supportInterval,
)
from scenic.core.object_types import Mutator, OrientationMutator, PositionMutator
from scenic.core.regions import PointInRegionDistribution
from scenic.core.vectors import Vector, VectorMethodDistribution, VectorOperatorDistribution
from scipy.special import ndtr, ndtri

from mrta_falsify.core.arrays import Array
from scenic_worlds.primitives import randomness
from scenic_worlds.primitives.charts import FLOOR_AXES, Axis, axes_of_random, chart_of
from scenic_worlds.primitives.polygons import LAST

PLAIN = (int, float, str)  # options that are equal if they look alike
MAX_NAMED = 64  # integers of a range that are told by value
TAIL = 1e-12  # normal quantiles are taken within this of 0 and 1: 7 standard deviations

#: values of dependencies and coordinates in, sampled value out
Draw = Callable[[Any, Sequence[float]], Any]


class Coordinates:
    """The point of the unit cube that all leaves of one program read.

    Attributes:
        u: the point, moved into the intervals.
        intervals: least and largest share of some coordinates; 0 to 1 for all others.
    """

    def __init__(self) -> None:
        self.u: list[float] = []
        self.intervals: dict[int, tuple[float, float]] = {}

    def set(self, u: Array) -> None:
        """Use ``u`` ``(k,)`` from now on."""
        self.u = u.tolist()
        for place in self.intervals:
            self.u[place] = self._inside(place, self.u[place])

    def change(self, places: list[int], values: list[float]) -> None:
        """Use other values in some places."""
        for place, value in zip(places, values, strict=True):
            self.u[place] = self._inside(place, value)

    def _inside(self, place: int, value: float) -> float:
        if place not in self.intervals:
            return value
        low, high = self.intervals[place]
        return min(low + (high - low) * value, high)


class DrivenLeaf(Samplable):  # type: ignore[misc] # Scenic has no types
    """Takes the place of one random primitive.

    Args:
        primitive: what Scenic would sample, after its own conditioning.
        source: of the coordinates.
        is_choice: whether the primitive picks one of a list of options.
        options: these.
        words: what each of them is.
    """

    def __init__(
        self,
        primitive: Distribution,
        source: Coordinates,
        *,
        is_choice: bool,
        options: Sequence[Any] = (),
        words: tuple[str, ...] = (),
    ) -> None:
        super().__init__(primitive._dependencies)
        self._needsSampling = self._isLazy = True  # even without dependencies
        self.primitive = primitive
        self.axes, self._draw = _drive(primitive, is_choice=is_choice, options=options, words=words)
        self._source = source
        self.start = self.stop = 0

    def place(self, start: int) -> None:
        """Own the coordinates from ``start`` on."""
        self.start, self.stop = start, start + len(self.axes)

    def sampleGiven(self, value: Any) -> Any:  # noqa: N802 - Scenic's name
        """Compute the primitive's value at the coordinates it owns."""
        return self._draw(value, self._source.u[self.start : self.stop])


def is_primitive(thing: Any) -> bool:
    """Whether Scenic draws random numbers for ``thing`` itself, not for what it is made of."""
    computed = (VectorOperatorDistribution, VectorMethodDistribution)
    return (
        isinstance(thing, Distribution)
        and not isinstance(thing, computed)
        and not type(thing)._deterministic
    )


def _drive(
    primitive: Any, *, is_choice: bool, options: Sequence[Any], words: tuple[str, ...]
) -> tuple[tuple[Axis, ...], Draw]:
    kind = type(primitive)
    if kind is Range:
        return _range(primitive)
    if kind is Normal:
        return _normal(primitive)
    if kind is TruncatedNormal:
        return _truncated_normal(primitive)
    if kind is DiscreteRange:
        return _integer(primitive, is_choice=is_choice, options=options, words=words)
    if kind is PointInRegionDistribution:
        return _point(primitive)
    return _opaque(primitive)


# --- numbers ---------------------------------------------------------------------------------


def _bounds(low: Any, high: Any) -> tuple[float | None, float | None]:
    (least, _), (_, most) = supportInterval(low), supportInterval(high)
    return (None if least is None else float(least)), (None if most is None else float(most))


def _range(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    low, high = primitive.low, primitive.high

    def draw(value: Any, u: Sequence[float]) -> float:
        start, end = value[low], value[high]
        return float(start + (end - start) * u[0])

    return (Axis("range", *_bounds(low, high)),), draw


def _quantile(share: float) -> float:
    return float(ndtri(min(max(share, TAIL), 1.0 - TAIL)))


def _normal(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    def draw(value: Any, u: Sequence[float]) -> float:
        return float(value[primitive.mean] + value[primitive.stddev] * _quantile(u[0]))

    return (Axis("normal"),), draw


def _truncated_normal(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    low, high = float(primitive.low), float(primitive.high)

    def draw(value: Any, u: Sequence[float]) -> float:
        mean, deviation = value[primitive.mean], value[primitive.stddev]
        start, end = (low - mean) / deviation, (high - mean) / deviation
        # measured from the tail on the far side of the mean, where shares do not cancel
        if start > 0.0:
            share = ndtr(-start) + u[0] * (ndtr(-end) - ndtr(-start))
            z = -ndtri(share)
        else:
            z = ndtri(ndtr(start) + u[0] * (ndtr(end) - ndtr(start)))
        return float(min(max(mean + deviation * z, low), high))

    return (Axis("normal", low, high),), draw


def _fixed_integers(primitive: Any, count: int) -> tuple[str, ...]:
    """Name the integers of a range, if its bounds are no random values and they are not many."""
    is_fixed = all(isinstance(bound, (int, float)) for bound in (primitive.low, primitive.high))
    if not is_fixed or count > MAX_NAMED:
        return ()
    return tuple(repr(math.ceil(primitive.low) + i) for i in range(count))


def _plain(options: Sequence[Any]) -> tuple[str, ...]:
    """Name options, if all are numbers or names; () otherwise."""
    return tuple(map(repr, options)) if all(isinstance(o, PLAIN) for o in options) else ()


def _integer(
    primitive: Any, *, is_choice: bool, options: Sequence[Any], words: tuple[str, ...]
) -> tuple[tuple[Axis, ...], Draw]:
    kind = "choice" if is_choice else "integer"
    least, most = _bounds(primitive.low, primitive.high)
    count = 0 if least is None or most is None else math.floor(most) - math.ceil(least) + 1
    named = _plain(options) if is_choice else _fixed_integers(primitive, count)
    if primitive.weights or len(named) != count:
        named = ()
    axis = (
        Axis("choice", choices=count, values=named, options=words if len(words) == count else ())
        if kind == "choice"
        else Axis("integer", least, most, count, named)
    )
    if primitive.weights:
        ends = np.cumsum(primitive.weights)

        def draw_weighted(value: Any, u: Sequence[float]) -> int:
            place = int(np.searchsorted(ends, min(u[0], LAST) * ends[-1], side="right"))
            return int(primitive.options[min(place, len(ends) - 1)])

        return (axis,), draw_weighted

    def draw(value: Any, u: Sequence[float]) -> int:
        low, high = math.ceil(value[primitive.low]), math.floor(value[primitive.high])
        if high < low:
            raise RejectionException(primitive.emptyMessage)
        return int(low + min(int(u[0] * (high - low + 1)), high - low))

    return (axis,), draw


# --- points ----------------------------------------------------------------------------------


def _point(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    region = primitive.region
    if needsSampling(region):
        return _point_in_random(primitive)
    chart = chart_of(region)
    if chart is None:
        return _opaque(primitive)
    point = chart.point
    return chart.axes, lambda value, u: point(u)


def _point_in_random(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    """Draw a point in a region that depends on other random values, charted when known."""
    region = primitive.region
    count = axes_of_random(region) or FLOOR_AXES
    _, seeded = _opaque(primitive)

    def draw(value: Any, u: Sequence[float]) -> Vector:
        chart = chart_of(value[region])
        if chart is None:
            return seeded(value, u)
        return chart.point(_stretched(u, len(chart.axes)))

    return (Axis("point"),) * count, draw


def _stretched(u: Sequence[float], count: int) -> Sequence[float]:
    """Lengthen ``u`` to as many coordinates as wanted, drawn from a hash of ``u``."""
    if len(u) >= count:
        return u
    return (*u, *_generator(u).random(count - len(u)))


# --- what has no inverse map -----------------------------------------------------------------


def _opaque(primitive: Any) -> tuple[tuple[Axis, ...], Draw]:
    """Seed Scenic's own sampling by one coordinate: deterministic, not smooth."""

    def draw(value: Any, u: Sequence[float]) -> Any:
        with randomness.seeded_by(_generator(u)):
            return primitive.sampleGiven(value)

    return (Axis("opaque"),), draw


def _generator(u: Sequence[float]) -> np.random.Generator:
    """Make a generator that depends on the bits of ``u`` only."""
    digest = hashlib.sha256(struct.pack(f"<{len(u)}d", *u)).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "little"))


# --- mutation --------------------------------------------------------------------------------


class DrivenMutator(Mutator):  # type: ignore[misc] # Scenic has no types
    """Takes the place of one mutator of an object.

    Args:
        mutator: Scenic's, or a user's own.
        source: of the coordinates.
    """

    def __init__(self, mutator: Mutator, source: Coordinates) -> None:
        self._mutator = mutator
        self._source = source
        self.names = _noise_names(mutator)
        kind = "opaque" if self.names is None else "normal"
        self.axes = (Axis(kind),) * (1 if self.names is None else len(self.names))  # type: ignore[arg-type]
        self.start = self.stop = 0

    def place(self, start: int) -> None:
        """Own the coordinates from ``start`` on."""
        self.start, self.stop = start, start + len(self.axes)

    def appliedTo(self, obj: Any) -> tuple[Any, bool]:  # noqa: N802 - Scenic's name
        """Mutate an object; also tell whether the inherited mutator comes next."""
        u = self._source.u[self.start : self.stop]
        if self.names is None:
            with randomness.seeded_by(_generator(u)):
                mutated, proceed = self._mutator.appliedTo(obj)
                return mutated, bool(proceed)
        shares = iter(u)
        noise = [
            deviation * obj.mutationScale * _quantile(next(shares)) if deviation else 0.0
            for deviation in self._mutator.stddevs
        ]
        if type(self._mutator) is PositionMutator:
            obj.position += Vector(*noise)
        else:
            obj.yaw += noise[0]
            obj.pitch += noise[1]
            obj.roll += noise[2]
        return obj, True


def _noise_names(mutator: Mutator) -> list[str] | None:
    """Name what the mutator adds noise to, if its noise is known to be normal."""
    parts = {
        PositionMutator: ("mutation.x", "mutation.y", "mutation.z"),
        OrientationMutator: ("mutation.yaw", "mutation.pitch", "mutation.roll"),
    }.get(type(mutator))
    if parts is None:
        return None
    return [part for part, deviation in zip(parts, mutator.stddevs, strict=True) if deviation]
