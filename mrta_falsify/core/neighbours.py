"""Who is near whom: lists of neighbours by spatial hashing, compiled.

Reference: Teschner et al., "Optimized spatial hashing for collision detection of deformable
objects", VMV 2003.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit

FEW = 150  # points, of which to compare all pairs costs less than to sort them into cells
ROOM = 16  # neighbours each, for which there is room at first


class Neighbours(NamedTuple):
    """The neighbours of each of N points, ascending; those of point ``i`` begin at ``first[i]``."""

    number: IntArray  #: (sum M,) of all points, one after the other
    first: IntArray  #: (N + 1,)


@njit(cache=True)
def _bucket(col: int, row: int, buckets: int) -> int:
    return (col * 73856093 ^ row * 19349663) % buckets


@njit(cache=True)
def neighbours_within(position: Array, radius: float) -> Neighbours:
    """List for each point which others are nearer than ``radius``.

    The cells of the hash are as wide as the radius, and there are as many buckets as points. So a
    point far away from all others costs no more than any other. Few points are in one cell.

    Args:
        position: ``(N, 2)`` [m], finite; further columns are not read.
        radius: [m], > 0.
    """
    n = position.shape[0]
    cell, buckets, around = (radius, n, 1) if n > FEW else (np.inf, 1, 0)
    col, row = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    begin, member = np.zeros(buckets + 1, dtype=np.int64), np.empty(n, dtype=np.int64)
    for i in range(n):
        col[i] = int(np.floor(position[i, 0] / cell))
        row[i] = int(np.floor(position[i, 1] / cell))
        begin[_bucket(col[i], row[i], buckets)] += 1
    for k in range(buckets):
        begin[k + 1] += begin[k]
    for i in range(n - 1, -1, -1):
        k = _bucket(col[i], row[i], buckets)
        begin[k] -= 1
        member[begin[k]] = i
    first, number = np.zeros(n + 1, dtype=np.int64), np.empty(ROOM * n, dtype=np.int64)
    count = 0
    for i in range(n):
        start = count
        for c in range(col[i] - around, col[i] + around + 1):
            for r in range(row[i] - around, row[i] + around + 1):
                k = _bucket(c, r, buckets)
                for m in range(begin[k], begin[k + 1]):
                    j = member[m]
                    if j == i or col[j] != c or row[j] != r:
                        continue
                    dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                    if dx * dx + dy * dy < radius * radius:
                        if count == number.shape[0]:
                            number = _twice_as_long(number)
                        place = count
                        while place > start and number[place - 1] > j:
                            number[place] = number[place - 1]
                            place -= 1
                        number[place] = j
                        count += 1
        first[i + 1] = count
    return Neighbours(number, first)


@njit(cache=True)
def _twice_as_long(number: IntArray) -> IntArray:
    longer = np.empty(2 * number.shape[0], dtype=np.int64)
    for k in range(number.shape[0]):
        longer[k] = number[k]
    return longer
