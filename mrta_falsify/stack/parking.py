"""Where a robot without tasks rests when somebody asks for the place it occupies."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mrta_falsify.core.arrays import Array

CLEARANCE = 0.6  # m centre to centre, the barrier distance: nearer, a spot counts as taken


def choose_spot(parking: Array, position: Array, others: Array, taken: Collection[int]) -> int:
    """Nearest free parking spot.

    Args:
        parking: ``(P, 2)`` spots [m], map frame.
        position: ``(2,)`` of the robot that has to go [m].
        others: ``(K, 2)`` of all other robots [m].
        taken: spots that robots rest on or head for.

    Returns:
        Spot number, the smaller one of equally near ones; -1 if none is free.
    """
    if not len(parking):
        return -1
    gaps = np.hypot(*(parking - position).T)
    for spot in np.argsort(np.round(gaps, 6), kind="stable").tolist():
        if spot in taken:
            continue
        if len(others) and np.hypot(*(others - parking[spot]).T).min() <= CLEARANCE:
            continue
        return int(spot)
    return -1
