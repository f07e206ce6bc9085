"""When did a robot last make progress towards its goal?

The answer depends neither on blocked-by edges nor on the stack's paths. Distance to the goal is
measured along free space (walls and furniture only). So a way round counts as progress; shuffling
to and fro, or a new path, does not.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.occupancy import GRID_CELL, SolidGrid

PROGRESS_STEP = 0.1  # m nearer to the goal than ever before: progress
GOAL_SPREAD = 0.5  # m; goals this near to each other are one, so alternating is no progress
DETOUR_FROM = 5 * GRID_CELL  # m; below this the straight distance is better than one in cells


@dataclass(slots=True)
class ProgressClock:
    """Clock of the last progress of every robot; one object per run."""

    world: World
    step: float = PROGRESS_STEP  #: how much nearer is progress [m]
    last: Array = field(init=False)  #: (N,) [s]
    _maps: dict[tuple[int, int], Array] = field(default_factory=dict)
    _best: list[list[tuple[int, Array, float]]] = field(init=False)
    _free: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        robots = len(self.world.robots)
        self.last = np.zeros(robots)
        self._best = [[] for _ in range(robots)]
        self._free = SolidGrid(self.world).lasting_free()

    def update(self, frame: Frame) -> Array:
        """Take in a tick; time ``(N,)`` [s] of each robot's last progress, not a copy."""
        intent, pose = frame.intent, frame.sensed.pose
        for i in range(len(self.last)):
            self.advance(
                i, frame.sensed.time, pose[i, :2], intent.goal[i], int(intent.tasks_left[i])
            )
        return self.last

    def advance(self, i: int, time: float, position: Array, goal: Array, left: int) -> float:
        """Take in where robot ``i`` is; time of its last progress [s].

        Progress is a stop done, or a goal that the robot never had at its present number of stops
        left. To be nearer to such a goal by ``step`` than ever before is progress, too.

        Args:
            i: robot.
            time: [s].
            position: ``(2,)`` [m].
            goal: ``(2,)`` where it heads for [m]; nan: none, which changes nothing.
            left: stops left.
        """
        if not np.isfinite(goal[0]):
            return float(self.last[i])
        away = self._distance(position, goal)
        known = self._best[i]
        if known and known[0][0] != left:
            known.clear()
        for k, (_, old, best) in enumerate(known):
            if np.hypot(*(old - goal)) <= GOAL_SPREAD:
                if away < best - self.step:
                    known[k] = (left, old, away)
                    self.last[i] = time
                break
        else:
            known.append((left, goal.copy(), away))
            self.last[i] = time
        return float(self.last[i])

    def _distance(self, position: Array, goal: Array) -> float:
        """Measure the distance along free space if there is a way, else the straight one [m]."""
        straight = float(np.hypot(*(position - goal)))
        cell = self._cell(goal)
        if cell not in self._maps:
            self._maps[cell] = _distances(self._free, *cell, GRID_CELL)
        row, col = self._cell(position)
        way = float(self._maps[cell][row, col])
        return way if np.isfinite(way) and way > DETOUR_FROM else straight

    def _cell(self, point: Array) -> tuple[int, int]:
        rows, cols = self._free.shape
        col, row = np.floor((point - self.world.bounds[:2]) / GRID_CELL).astype(int)
        return int(np.clip(row, 0, rows - 1)), int(np.clip(col, 0, cols - 1))


@njit(cache=True)
def _distances(free: BoolArray, goal_row: int, goal_col: int, cell: float) -> Array:
    """Measure the shortest way to the goal's cell from every cell [m]; inf: none."""
    rows, cols = free.shape
    found = np.full(free.shape, np.inf)
    found[goal_row, goal_col] = 0.0
    heap = [(0.0, goal_row, goal_col)]
    while len(heap) > 0:
        cost, row, col = heapq.heappop(heap)
        if cost > found[row, col]:
            continue
        for up in range(-1, 2):
            for side in range(-1, 2):
                r, c = row + up, col + side
                if r < 0 or r >= rows or c < 0 or c >= cols or not free[r, c]:
                    continue
                total = cost + cell * math.sqrt(up * up + side * side)
                if total < found[r, c] - 1e-9:
                    found[r, c] = total
                    heapq.heappush(heap, (total, r, c))
    return found
