"""Peeling of a box until runs in it fail (the Patient Rule Induction Method).

Friedman and Fisher, "Bump hunting in high-dimensional data", Statistics and Computing 9, 1999; here
the failure stays inside.
"""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray

PURE = 0.95  # share of failures in a box at which peeling stops
PEEL = 0.1  # share of a box's points that one cut removes
FEWEST = 6  # points in a box below which nothing is cut any more


def peeled_box(points: Array, failed: BoolArray, center: Array) -> Array:
    """Peel a box around ``center`` until points in it fail.

    Begin with all points. Each cut takes away the outermost tenth on one side of one dimension,
    but never the centre. The cut that leaves the largest share of failures is made, until 95 %
    fail, few points are left, or no cut raises the share. The ends are those of the remaining
    points that fail, so the box claims nothing beyond where a failure was seen.

    Args:
        points: ``(n, d)``, the centre among them.
        failed: ``(n,)``.
        center: ``(d,)``, which fails.

    Returns:
        ``(d, 2)`` lower and upper ends.
    """
    inside = np.ones(len(points), dtype=np.bool_)
    while inside.sum() > FEWEST and failed[inside].mean() < PURE:
        cuts = [
            cut
            for d in range(points.shape[1])
            for cut in _cuts(points[:, d], inside, float(center[d]))
        ]
        shares = [(float(failed[cut].mean()), int(cut.sum())) for cut in cuts]
        if not shares or max(shares)[0] <= failed[inside].mean():
            break
        inside = cuts[shares.index(max(shares))]
    kept = points[inside & failed]
    ends: Array = np.stack([kept.min(axis=0), kept.max(axis=0)], axis=1)
    return ends


def _cuts(values: Array, inside: BoolArray, center: float) -> list[BoolArray]:
    """Cut from below and from above along one dimension; return what stays inside."""
    count = max(1, int(PEEL * inside.sum()))
    order = np.sort(values[inside])
    cuts = [inside & (values > min(order[count - 1], np.nextafter(center, -np.inf)))]
    cuts.append(inside & (values < max(order[-count], np.nextafter(center, np.inf))))
    return [cut for cut in cuts if cut.sum() < inside.sum()]
