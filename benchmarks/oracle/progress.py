"""When did a robot last get nearer to what it wants? The clock of labels and delays.

Independent of the oracle, of blocked-by edges and of the stack's paths: distance to the goal
is measured along free space (walls and furniture only), so that a way round counts, and so
that shuffling to and fro, or a new path, does not.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.free_space import CELL, FreeSpace

STEP = 0.1  # m nearer to the goal than ever before: progress
SAME_GOAL = 0.5  # m, a robot that turns to and fro between goals gets no progress from it
DIAGONAL = float(np.sqrt(2.0))


@dataclass(slots=True)
class Progress:
    """Last progress of every robot; one object per run."""

    world: World
    step: float = STEP  #: how much nearer is progress [m]
    last: Array = field(init=False)  #: (N,) [s]
    _maps: dict[tuple[int, int], Array] = field(default_factory=dict)
    _best: list[list[tuple[int, Array, float]]] = field(init=False)
    _free: Array = field(init=False)

    def __post_init__(self) -> None:
        robots = len(self.world.robots)
        self.last = np.zeros(robots)
        self._best = [[] for _ in range(robots)]
        self._free = FreeSpace(self.world).lasting_free()

    def update(self, frame: Frame) -> Array:
        """Take in a tick; time ``(N,)`` [s] of each robot's last progress, not a copy.

        Progress is: nearer by 0.1 m than ever before to a goal of the present number of stops
        left, a goal it never had at this number, or a stop done.
        """
        intent, time = frame.intent, frame.sensed.time
        for i in range(len(self.last)):
            goal = intent.goal[i]
            if not np.isfinite(goal[0]):
                continue
            left = int(intent.tasks_left[i])
            away = self._distance(frame.sensed.pose[i, :2], goal)
            known = self._best[i]
            if known and known[0][0] != left:
                known.clear()
            for k, (_, old, best) in enumerate(known):
                if np.hypot(*(old - goal)) <= SAME_GOAL:
                    if away < best - self.step:
                        known[k] = (left, old, away)
                        self.last[i] = time
                    break
            else:
                known.append((left, goal.copy(), away))
                self.last[i] = time
        return self.last

    def _distance(self, position: Array, goal: Array) -> float:
        """Along free space if there is a way, else the straight distance [m]."""
        straight = float(np.hypot(*(position - goal)))
        cell = self._cell(goal)
        if cell not in self._maps:
            self._maps[cell] = _distances(self._free, cell)
        row, col = self._cell(position)
        way = float(self._maps[cell][row, col])
        return way if np.isfinite(way) and way > 5 * CELL else straight

    def _cell(self, point: Array) -> tuple[int, int]:
        rows, cols = self._free.shape
        col, row = np.floor((point - self.world.bounds[:2]) / CELL).astype(int)
        return int(np.clip(row, 0, rows - 1)), int(np.clip(col, 0, cols - 1))


def _distances(free: Array, goal: tuple[int, int]) -> Array:
    """Length of the shortest way to ``goal`` from every cell [m]; inf: none."""
    rows, cols = free.shape
    found = np.full(free.shape, np.inf)
    found[goal] = 0.0
    heap = [(0.0, *goal)]
    while heap:
        cost, row, col = heapq.heappop(heap)
        if cost > found[row, col]:
            continue
        for up in (-1, 0, 1):
            for side in (-1, 0, 1):
                r, c = row + up, col + side
                if not (0 <= r < rows and 0 <= c < cols and free[r, c]):
                    continue
                total = cost + CELL * (DIAGONAL if up and side else 1.0)
                if total < found[r, c] - 1e-9:
                    found[r, c] = total
                    heapq.heappush(heap, (total, r, c))
    return found
