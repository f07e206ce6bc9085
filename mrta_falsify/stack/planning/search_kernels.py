"""Compiled parts of the planners: search over a padded price grid, lines over cells.

A *price grid* is a costmap as the search sees it: one whole number per cell, 0 for cells
that must not be entered, else ``PRICE`` (free) and more. It has a border of one blocked
cell, so no neighbour lies outside. Cells are flat indices ``row * width + col``. All costs
are whole numbers, so sums do not depend on the order of summation.

A straight step between cells of prices p and q costs ``p + q``. A diagonal one costs
``(p + q) * 181 / 128`` rounded down; 181 / 128 is the square root of 2 to 2e-4. A diagonal
step needs both cells beside it free, so that it cuts no corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.compiled import njit

Prices = NDArray[np.uint16]  #: (rows, width) price grid
Costs = NDArray[np.int32]  #: (rows * width,) cost to come, of cells that are reached
Marks = NDArray[np.uint8]  #: (rows * width,) 0: not reached, REACHED, or CLOSED
Cells = NDArray[np.int32]  #: (n,) flat indices

PRICE = 50  #: price of a free cell; a straight step between free cells costs twice as much
REACHED = 1  # a way to the cell is known
CLOSED = 2  # its cost to come is final
DEARER = 1.005  # a true diagonal costs up to 0.4 % more than its rounded steps
_STRAIGHT = 2 * PRICE  # least cost of a straight step
_DIAGONAL = (2 * PRICE * 181) >> 7  # least cost of a diagonal step


@njit(cache=True)
def expand(  # noqa: PLR0915 - one loop
    prices: Prices, cost: Costs, marks: Marks, frontier: Cells, target: int
) -> Cells:  # pragma: no cover - compiled
    """Continue a search until the cost of ``target`` and of all its best paths is final.

    The search is A* with the octile distance to ``target`` as its consistent heuristic. Every
    closed cell therefore has its exact cost to come, whatever the target was, and the search
    may be continued towards another target: the frontier only gets new keys. Cells are closed
    until the smallest key exceeds the cost of ``target``. Then all cells on *every* best path
    are closed, and descending the costs gives the same path whatever was asked before.

    Args:
        prices: price grid.
        cost: cost to come; updated. Only the frontier's need be there at first, so that a new
            search touches no more memory than it needs.
        marks: which costs are there, and which are final; updated.
        frontier: reached cells that are not closed, in any order, repeats allowed.
        target: cell to reach, not blocked.

    Returns:
        The new frontier; empty if everything that can be reached is closed.

    Reference: Hart, Nilsson & Raphael, "A formal basis for the heuristic determination of
    minimum cost paths", 1968; bucket queue: Dial, "Algorithm 360", 1969.
    """
    width = prices.shape[1]
    price = prices.ravel()
    target_row, target_col = target // width, target % width
    keys = _keys(cost, frontier, width, target)
    # Bucket queue: heads[key - base] starts a linked list of pool entries.
    base = keys.min() if len(keys) else np.int64(0)
    heads = np.full((keys.max() - base if len(keys) else 0) + 65536, -1, np.int32)
    pool_cell = np.empty(max(4096, 2 * len(frontier)), np.int32)
    pool_next = np.empty(len(pool_cell), np.int32)
    used = waiting = _fill_queue(heads, pool_cell, pool_next, frontier, keys - base, marks)
    spare, key = -1, 0
    steps, step_row, step_col = _steps(width)
    while waiting > 0:
        while heads[key] < 0:
            key += 1
        if marks[target] == CLOSED and key + base > cost[target]:
            break
        entry = heads[key]
        heads[key] = pool_next[entry]
        pool_next[entry] = spare
        spare = entry
        waiting -= 1
        cell = pool_cell[entry]
        if marks[cell] == CLOSED:
            continue
        marks[cell] = CLOSED
        here, price_here = cost[cell], price[cell]
        row, col = cell // width - target_row, cell % width - target_col
        for k in range(8):
            other = cell + steps[k]
            if price[other] == 0 or marks[other] == CLOSED:
                continue
            if k >= 4 and _cuts_corner(price, cell, other, step_col[k]):
                continue
            pay = _pay(price_here, price[other], k)
            if marks[other] == REACHED and here + pay >= cost[other]:
                continue
            cost[other] = here + pay
            marks[other] = REACHED
            slot = here + pay + _octile(row + step_row[k], col + step_col[k]) - base
            if slot >= len(heads):
                heads = _doubled(heads)
            if spare >= 0:
                entry = spare
                spare = pool_next[entry]
            else:
                if used == len(pool_cell):
                    pool_cell, pool_next = _doubled(pool_cell), _doubled(pool_next)
                entry = used
                used += 1
            pool_cell[entry] = other
            pool_next[entry] = heads[slot]
            heads[slot] = entry
            waiting += 1
    return _open_cells(heads, key, waiting, pool_cell, pool_next, marks)


@njit(cache=True)
def _octile(rows: int, cols: int) -> int:  # pragma: no cover - compiled
    """Least cost of a way over so many rows and columns, of either sign."""
    rows, cols = abs(rows), abs(cols)
    return _STRAIGHT * max(rows, cols) + (_DIAGONAL - _STRAIGHT) * min(rows, cols)


@njit(cache=True)
def _steps(
    width: int,
) -> tuple[IntArray, IntArray, IntArray]:  # pragma: no cover - compiled
    """Steps to the eight neighbours, the straight ones first: in cells, rows and columns."""
    step_row = np.array([0, 0, -1, 1, -1, -1, 1, 1])
    step_col = np.array([-1, 1, 0, 0, -1, 1, -1, 1])
    return step_row * width + step_col, step_row, step_col


@njit(cache=True)
def _pay(price: int, other: int, k: int) -> np.int64:  # pragma: no cover - compiled
    """Cost of step ``k`` between cells of two prices."""
    pay = np.int64(price) + np.int64(other)
    return pay if k < 4 else (pay * 181) >> 7


@njit(cache=True)
def _cuts_corner(
    price: Prices, cell: int, other: int, beside: int
) -> bool:  # pragma: no cover - compiled
    """Whether a diagonal step passes a blocked cell."""
    return bool(price[cell + beside] == 0 or price[other - beside] == 0)


@njit(cache=True)
def _keys(
    cost: Costs, frontier: Cells, width: int, target: int
) -> IntArray:  # pragma: no cover - compiled
    """Cost to come and least cost to go of each frontier cell."""
    row, col = target // width, target % width
    keys = np.empty(len(frontier), np.int64)
    for i in range(len(frontier)):
        cell = frontier[i]
        keys[i] = cost[cell] + _octile(cell // width - row, cell % width - col)
    return keys


@njit(cache=True)
def _fill_queue(
    heads: Cells, pool_cell: Cells, pool_next: Cells, cells: Cells, slots: IntArray, marks: Marks
) -> int:  # pragma: no cover - compiled
    """Put the cells that are not closed into the slots of an empty bucket queue; how many."""
    used = 0
    for i in range(len(cells)):
        if marks[cells[i]] != CLOSED:
            pool_cell[used] = cells[i]
            pool_next[used] = heads[slots[i]]
            heads[slots[i]] = used
            used += 1
    return used


@njit(cache=True)
def _doubled(entries: Cells) -> Cells:  # pragma: no cover - compiled
    """The same entries in twice the room, the new half at -1."""
    longer = np.full(2 * len(entries), -1, np.int32)
    longer[: len(entries)] = entries
    return longer


@njit(cache=True)
def _open_cells(
    heads: Cells, key: int, waiting: int, pool_cell: Cells, pool_next: Cells, marks: Marks
) -> Cells:  # pragma: no cover - compiled
    """Cells that still wait in the bucket queue from ``key`` on and are not closed."""
    left = np.empty(waiting, np.int32)
    count = 0
    while waiting > 0:
        entry = heads[key]
        while entry >= 0:
            waiting -= 1
            if marks[pool_cell[entry]] != CLOSED:
                left[count] = pool_cell[entry]
                count += 1
            entry = pool_next[entry]
        key += 1
    return left[:count].copy()


@njit(cache=True)
def descend(
    prices: Prices, cost: Costs, marks: Marks, start: int
) -> Cells:  # pragma: no cover - compiled
    """Cells from ``start`` down the exact costs to where they are 0; ties by fixed order."""
    width = prices.shape[1]
    price = prices.ravel()
    steps, _, step_col = _steps(width)
    cells = np.empty(1024, np.int32)
    cells[0] = start
    count = 1
    cell = start
    while cost[cell] > 0:
        for k in range(8):
            other = cell + steps[k]
            if price[other] == 0 or marks[other] != CLOSED:
                continue
            if k >= 4 and _cuts_corner(price, cell, other, step_col[k]):
                continue
            if cost[other] + _pay(price[cell], price[other], k) == cost[cell]:
                break
        else:
            return cells[:0]  # cannot happen while the costs are exact
        cell = other
        if count == len(cells):
            cells = _doubled(cells)
        cells[count] = cell
        count += 1
    return cells[:count]


@njit(cache=True)
def line_cost(
    prices: Prices, x1: float, y1: float, x2: float, y2: float
) -> float:  # pragma: no cover - compiled
    """Cost of a straight line, inf if it meets a blocked cell; coordinates in cells.

    The integral of twice the price along the line, so that it compares with search costs.
    A line through a grid corner meets the cells on both sides; a line along a grid line
    counts as lying in the cells east or north of it, as a point does.
    """
    rows, width = prices.shape
    if not (0 < x1 < width and 0 < x2 < width and 0 < y1 < rows and 0 < y2 < rows):
        return np.inf
    dx, dy = x2 - x1, y2 - y1
    length = np.hypot(dx, dy)
    col, row = int(np.floor(x1)), int(np.floor(y1))
    last_col, last_row = int(np.floor(x2)), int(np.floor(y2))
    if prices[row, col] == 0 or prices[last_row, last_col] == 0:
        return np.inf
    step_col = 1 if dx > 0 else -1
    step_row = 1 if dy > 0 else -1
    per_col = 1.0 / abs(dx) if dx != 0.0 else np.inf
    per_row = 1.0 / abs(dy) if dy != 0.0 else np.inf
    next_col = ((col + 1 - x1) if dx > 0 else (x1 - col)) * per_col if dx != 0.0 else np.inf
    next_row = ((row + 1 - y1) if dy > 0 else (y1 - row)) * per_row if dy != 0.0 else np.inf
    total, done = 0.0, 0.0
    tolerance = 1e-9
    for _ in range(abs(last_col - col) + abs(last_row - row)):
        if col == last_col and row == last_row:
            break
        through_corner = abs(next_col - next_row) <= tolerance
        if through_corner and min(prices[row, col + step_col], prices[row + step_row, col]) == 0:
            return np.inf
        total += 2.0 * prices[row, col] * (min(next_col, next_row) - done) * length
        done = min(next_col, next_row)
        if through_corner:
            col += step_col
            row += step_row
            next_col += per_col
            next_row += per_row
        elif next_col < next_row:
            col += step_col
            next_col += per_col
        else:
            row += step_row
            next_row += per_row
        if prices[row, col] == 0:
            return np.inf
    return float(total + 2.0 * prices[row, col] * max(1.0 - done, 0.0) * length)


@njit(cache=True)
def pull_taut(prices: Prices, cost: Costs, cells: Cells) -> Cells:  # pragma: no cover - compiled
    """Corners of a path: cells whose straight connections cost no more than the path.

    Greedy from the start: each corner looks ahead along the path. It stops where the straight
    line to the next cell is blocked, or dearer than the path between the two.
    """
    width = prices.shape[1]
    corners = np.empty(len(cells), np.int32)
    corners[0] = cells[0]
    count, anchor = 1, 0
    while anchor < len(cells) - 1:
        reach = anchor + 1
        x, y = cells[anchor] % width + 0.5, cells[anchor] // width + 0.5
        while reach + 1 < len(cells):
            ahead = cells[reach + 1]
            pay = line_cost(prices, x, y, ahead % width + 0.5, ahead // width + 0.5)
            if pay > DEARER * (cost[cells[anchor]] - cost[ahead]):
                break
            reach += 1
        corners[count] = cells[reach]
        count += 1
        anchor = reach
    return corners[:count]


@njit(cache=True)
def nearest_free(
    prices: Prices, lethal: Marks, x: float, y: float, radius: float, leave: bool
) -> int:  # pragma: no cover - compiled
    """Free cell whose centre is nearest to a point, -1: none; lengths in cells.

    Args:
        prices: price grid.
        lethal: ``(rows * width,)`` 1 where a cell meets an obstacle.
        x: column coordinate.
        y: row coordinate.
        radius: farthest centre allowed.
        leave: ask for a straight way out: from the point to the centre the line may pass
            lethal cells only at its beginning (an obstacle it already stands in, never one
            in between).

    Returns:
        The cell; of equally near ones that with the smallest index.
    """
    rows, width = prices.shape
    best, best_distance = -1, radius * radius + 1e-9
    reach = int(np.ceil(radius)) + 1
    row0, col0 = int(np.floor(y)), int(np.floor(x))
    for row in range(max(1, row0 - reach), min(rows - 1, row0 + reach + 1)):
        for col in range(max(1, col0 - reach), min(width - 1, col0 + reach + 1)):
            if prices[row, col] == 0:
                continue
            distance = (col + 0.5 - x) ** 2 + (row + 0.5 - y) ** 2
            if distance >= best_distance:
                continue
            if leave and not _leads_out(lethal, width, rows, x, y, col + 0.5, row + 0.5):
                continue
            best, best_distance = row * width + col, distance
    return best


@njit(cache=True)
def _leads_out(
    lethal: Marks, width: int, rows: int, x1: float, y1: float, x2: float, y2: float
) -> bool:  # pragma: no cover - compiled
    samples = int(np.ceil(4.0 * np.hypot(x2 - x1, y2 - y1))) + 1
    out = False
    for k in range(samples + 1):
        share = k / samples
        row = int(np.floor(y1 + share * (y2 - y1)))
        col = int(np.floor(x1 + share * (x2 - x1)))
        if not (0 <= row < rows and 0 <= col < width):
            continue
        if lethal[row * width + col]:
            if out:
                return False
        else:
            out = True
    return out
