"""Array types, and the one way to make an array read-only."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]


def frozen_array(values: ArrayLike) -> Array:
    """Copy ``values`` to a read-only float64 array of any shape."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
