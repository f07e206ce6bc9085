"""Which robots decide together: connected components of the neighbour graph."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit


@njit(cache=True)
def connected_clusters(position: Array, connected: BoolArray, distance: float) -> IntArray:
    """Cluster robots that are neighbours, or neighbours of neighbours.

    Args:
        position: ``(N, 2)`` [m], map frame.
        connected: ``(N,)`` robots that share their states; the others stay alone.
        distance: two robots nearer than this [m] are neighbours.

    Returns:
        ``(N,)`` smallest robot number of each robot's cluster.
    """
    n = position.shape[0]
    label = np.arange(n)
    for i in range(n):
        if not connected[i]:
            continue
        for j in range(i):
            dx = position[i, 0] - position[j, 0]
            dy = position[i, 1] - position[j, 1]
            if connected[j] and dx * dx + dy * dy < distance * distance:
                low, high = min(label[i], label[j]), max(label[i], label[j])
                if low != high:
                    for k in range(i + 1):
                        if label[k] == high:
                            label[k] = low
    return label


@njit(cache=True)
def precedence(active: BoolArray, wants: BoolArray, demoted: BoolArray, rank: IntArray) -> IntArray:
    """Give the key ``(N,)`` by which robots of one cluster take precedence; smallest first.

    Active robots that want to move, then others that want to move (to a waiting spot, to a
    parking spot), then active robots at rest, then idle ones; within each group by rank,
    robots whose lead was suspended last.
    """
    n = active.shape[0]
    key = np.empty(n, dtype=np.int64)
    for i in range(n):
        group = (0 if wants[i] else 4) + (0 if active[i] else 2)
        if demoted[i]:
            group += 1
        key[i] = group * n + rank[i]
    return key


@njit(cache=True)
def elect_leaders(
    label: IntArray, eligible: BoolArray, active: BoolArray, key: IntArray
) -> IntArray:
    """Elect the leader ``(N,)`` of each robot's cluster.

    It is the best by ``key`` of the eligible robots, active ones before all others. Robots that
    are not eligible (they cannot receive remote commands) lead themselves.
    """
    n = label.shape[0]
    leader = np.arange(n)
    for i in range(n):
        if not eligible[i]:
            continue
        best = i
        for j in range(n):
            if not eligible[j] or label[j] != label[i] or j == best:
                continue
            if active[j] != active[best]:
                if active[j]:
                    best = j
            elif key[j] < key[best]:
                best = j
        leader[i] = best
    return leader
