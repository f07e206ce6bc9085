"""The lanes of a building as a graph: shortest ways between its vertices."""

from __future__ import annotations

import collections
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mrta_falsify.core.arrays import Array, IntArray
from simulator_interface.formats.building_file import Level


@dataclass(slots=True)
class LaneUse:
    """How many ways lead along a lane, in either direction."""

    total: int = 0
    by_end: collections.Counter[int] = field(default_factory=collections.Counter)

    def is_for_others(self, vertex: int) -> bool:
        """Whether a way leads along the lane that neither starts nor ends at ``vertex``."""
        return self.total > self.by_end[vertex]


class LaneGraph:
    """Shortest ways along lanes, in their directions, without the inside of lifts.

    The lanes of all graphs count: one fleet drives them all.

    Args:
        level: with lanes.
    """

    def __init__(self, level: Level) -> None:
        self._points = np.array([vertex.point for vertex in level.vertices]).reshape(-1, 2)
        self.lanes = tuple(
            lane
            for lane in level.lanes
            if lane.start != lane.end
            and not any(level.vertices[k].has("lift_cabin") for k in (lane.start, lane.end))
        )
        pairs = [(lane.start, lane.end) for lane in self.lanes]
        pairs += [
            (lane.end, lane.start) for lane in self.lanes if lane.parameters.get("bidirectional")
        ]
        self.touched = frozenset(k for pair in pairs for k in pair)
        lengths = {  # a vertex may lie on another one: no length would be no lane
            pair: max(float(np.hypot(*(self._points[pair[1]] - self._points[pair[0]]))), 1e-6)
            for pair in pairs
        }
        ends = np.array(list(lengths), dtype=np.int64).reshape(-1, 2)
        count = len(level.vertices)
        matrix = csr_array((list(lengths.values()), (ends[:, 0], ends[:, 1])), shape=(count, count))
        self._distance: Array
        self._before: IntArray
        self._distance, self._before = dijkstra(matrix, return_predecessors=True)

    def distance(self, start: int, end: int) -> float:
        """Measure the way from one vertex to another [m], inf: there is none."""
        return float(self._distance[start, end])

    def way(self, start: int, end: int) -> Array:
        """Find the points ``(K, 2)`` [m] of the way, both ends included; empty: there is none."""
        if not np.isfinite(self._distance[start, end]):
            return np.zeros((0, 2))
        passed = [end]
        while passed[-1] != start:
            passed.append(int(self._before[start, passed[-1]]))
        return self._points[passed[::-1]]

    def uses(self, ends: Iterable[tuple[int, int]]) -> dict[tuple[int, int], LaneUse]:
        """Count the shortest ways along each lane.

        Args:
            ends: first and last vertex of each way.

        Returns:
            The use of each lane by its two vertices, the smaller one first; only what is used.
        """
        found: dict[tuple[int, int], LaneUse] = collections.defaultdict(LaneUse)
        for start, end in ends:
            if start == end or not np.isfinite(self._distance[start, end]):
                continue
            there = end
            while there != start:
                here = int(self._before[start, there])
                use = found[min(here, there), max(here, there)]
                use.total += 1
                use.by_end.update((start, end))
                there = here
        return dict(found)
