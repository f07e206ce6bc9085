"""Which robots decide together: connected components of the neighbour graph."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours


@njit(cache=True)
def connected_clusters(
    position: Array, connected: BoolArray, distance: float, near: Neighbours
) -> IntArray:
    """Cluster robots that are neighbours, or neighbours of neighbours.

    Args:
        position: ``(N, 2)`` [m], map frame.
        connected: ``(N,)`` robots that share their states; the others stay alone.
        distance: two robots nearer than this [m] are neighbours.
        near: within ``distance`` or farther.

    Returns:
        ``(N,)`` smallest robot number of each robot's cluster.
    """
    n = position.shape[0]
    label = np.arange(n)  # of each robot another one of its cluster, or itself, if it is the first
    for i in range(n):
        for m in range(near.first[i], near.first[i + 1]):
            j = near.number[m]
            if j > i:
                break
            dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
            are_neighbours = connected[i] and connected[j]
            if are_neighbours and dx * dx + dy * dy < distance * distance:
                a, b = _first_of(label, i), _first_of(label, j)
                label[max(a, b)] = min(a, b)
    for i in range(n):
        label[i] = _first_of(label, i)
    return label


@njit(cache=True)
def _first_of(label: IntArray, i: int) -> int:
    """Follow the labels from robot ``i``, and shorten the way for the next time."""
    while label[i] != i:
        label[i] = label[label[i]]
        i = label[i]
    return i


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
    best, leader = np.full(n, -1), np.arange(n)  # of each cluster, at its number; of each robot
    for j in range(n):
        known = best[label[j]]
        if eligible[j] and (known < 0 or _is_better(j, known, active, key)):
            best[label[j]] = j
    for i in range(n):
        if eligible[i]:
            leader[i] = best[label[i]]
    return leader


@njit(cache=True)
def _is_better(j: int, known: int, active: BoolArray, key: IntArray) -> bool:
    """Whether robot ``j`` leads rather than robot ``known``."""
    if active[j] != active[known]:
        return bool(active[j])
    return bool(key[j] < key[known])
