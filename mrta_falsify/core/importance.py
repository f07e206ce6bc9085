"""Which search dimensions go with failing, as shares of variance with intervals.

Trials are grouped by one coordinate at a time. Its importance is the share of the variance of
failing that lies between the groups: the first-order index of Sobol, estimated by Kelley's
epsilon squared, which is zero on average where the coordinate does not matter. The interval turns
the noncentral F distribution around (Steiger, Psychological Methods 9, 2004). It holds for all
coordinates together (Bonferroni). What only two coordinates together bring about is not seen.

A sampler that looks for failures repeats coordinates and moves them together. Then the intervals
are too narrow, and a coordinate may go with failing because another one causes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from mrta_falsify.core.arrays import Array, BoolArray

LEVEL = 0.95  # of all intervals together
LEAST_OF_EACH = 5  # failures and passes below which nothing is told
MAX_GROUPS = 6  # of a coordinate
LEAST_IN_GROUP = 8  # trials
BISECTIONS = 50
LARGEST_RATIO = 1e6  # of variances, where a coordinate decides alone


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Trials whose coordinate lies in one interval."""

    low: float  #: least coordinate among them, in [0, 1]
    high: float
    trials: int
    failures: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Importance:
    """How much of the variance of failing one coordinate explains by itself."""

    dimension: int
    share: float  #: estimate, in [0, 1]
    low: float  #: of the interval; above 0: it matters
    high: float
    groups: tuple[Group, ...]  #: by coordinate

    @property
    def matters(self) -> bool:
        """Whether failing goes with it beyond chance."""
        return self.low > 0.0


def importances(
    points: Array, failed: BoolArray, levels: Sequence[int] = ()
) -> tuple[Importance, ...]:
    """Rank the coordinates by how much failing goes with them.

    Args:
        points: ``(n, k)`` of the unit cube, one row per judged trial.
        failed: ``(n,)``.
        levels: values of a discrete coordinate, 0: continuous; all are if empty.

    Returns:
        The largest first; empty with fewer than five failures or passes. Coordinates that never
        vary are left out.
    """
    failed = np.asarray(failed, dtype=bool)
    if min(failed.sum(), (~failed).sum()) < LEAST_OF_EACH:
        return ()
    groupings = {}
    for i in range(points.shape[1]):
        labels = _group_labels(points[:, i], levels[i] if levels else 0)
        if len(np.unique(labels)) > 1:
            groupings[i] = labels
    if not groupings:
        return ()
    shares, lows, highs = _intervals(list(groupings.values()), failed.astype(float))
    found = [
        Importance(
            dimension=i,
            share=float(share),
            low=float(low),
            high=float(high),
            groups=_groups(points[:, i], labels, failed),
        )
        for (i, labels), share, low, high in zip(
            groupings.items(), shares, lows, highs, strict=True
        )
    ]
    return tuple(sorted(found, key=lambda one: (-one.low, -one.share, one.dimension)))


def _group_labels(values: Array, levels: int) -> np.ndarray:
    """Number the group of each value: its level, or a part of about as many trials as the others.

    Args:
        values: ``(n,)`` in [0, 1].
        levels: of a discrete coordinate, 0: continuous.
    """
    if 0 < levels <= MAX_GROUPS:
        return np.asarray(np.minimum((values * levels).astype(int), levels - 1))
    count = int(np.clip(len(values) // LEAST_IN_GROUP, 2, MAX_GROUPS))
    edges = np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1])
    return np.asarray(np.searchsorted(np.unique(edges), values, side="right"))


def _groups(values: Array, labels: np.ndarray, failed: BoolArray) -> tuple[Group, ...]:
    return tuple(
        Group(
            low=float(values[labels == label].min()),
            high=float(values[labels == label].max()),
            trials=int((labels == label).sum()),
            failures=int(failed[labels == label].sum()),
        )
        for label in np.unique(labels)
    )


def _intervals(groupings: list[np.ndarray], outcome: Array) -> tuple[Array, Array, Array]:
    """Estimate the share of variance between groups, with its interval, for each grouping."""
    total, between, counts = len(outcome), [], []
    spread = float(((outcome - outcome.mean()) ** 2).sum())
    for labels in groupings:
        _, numbers, sizes = np.unique(labels, return_inverse=True, return_counts=True)
        means = np.bincount(numbers, weights=outcome) / sizes
        between.append(float((sizes * (means - outcome.mean()) ** 2).sum()))
        counts.append(len(sizes))
    above = np.array(counts, dtype=float) - 1.0  # degrees of freedom between groups
    below = np.maximum(total - 1.0 - above, 1.0)  # and within them
    inside = np.maximum(spread - np.array(between), 0.0) / below
    ratio = np.array(between) / above / np.maximum(inside, 1e-12)
    ratio = np.minimum(ratio, LARGEST_RATIO)
    share = np.clip((np.array(between) - above * inside) / spread, 0.0, 1.0)
    tail = 0.5 * (1.0 - LEVEL) / len(groupings)
    low, high = (_noncentrality(ratio, above, below, p) for p in (1.0 - tail, tail))
    # where a coordinate decides alone, the ratio has been cut off
    return share, low / (low + total), np.maximum(share, high / (high + total))


def _noncentrality(ratio: Array, above: Array, below: Array, level: float) -> Array:
    """Find the noncentrality at which an F ratio lies at the quantile ``level``; 0 at least."""
    low = np.zeros_like(ratio)
    high = np.full_like(ratio, 1.0)
    for _ in range(BISECTIONS):
        beyond = special.ncfdtr(above, below, high, ratio) > level
        if not beyond.any():
            break
        high[beyond] *= 2.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        is_more = special.ncfdtr(above, below, middle, ratio) > level
        low, high = np.where(is_more, middle, low), np.where(is_more, high, middle)
    return np.where(special.ncfdtr(above, below, np.zeros_like(ratio), ratio) > level, low, 0.0)
