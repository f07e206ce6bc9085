"""Outlines as shapely's polygons, many in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array


def polygons(outlines: Sequence[Array]) -> NDArray[np.object_]:
    """Build the polygons of n outlines ``(V, 2)`` [m], ``(n,)``.

    Raises:
        ValueError: an outline has fewer than three corners.
    """
    if not len(outlines):
        return np.empty(0, dtype=np.object_)
    owners = np.repeat(np.arange(len(outlines)), [len(outline) for outline in outlines])
    return np.asarray(
        shapely.polygons(shapely.linearrings(np.concatenate(outlines), indices=owners))
    )
