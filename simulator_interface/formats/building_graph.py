"""The lanes of a building as a graph: shortest ways between its vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mrta_falsify.core.arrays import Array, IntArray
from simulator_interface.formats.building_file import Level


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
