"""Compiled parts of the insertion allocators: routes as linked lists with slack times.

Node ``r < n`` is the start of robot r, nodes ``n + 2 k`` and ``n + 2 k + 1`` are pickup and
drop of task k. Every node knows its time, the latest time that spoils no deadline after it,
the load behind it, and how many drops follow, so that trying a place costs constant time.
Travel times are closed under shortest paths: going elsewhere first is never quicker.

Reference: constant-time tests after Savelsbergh, "The vehicle routing problem with time
windows: minimizing route duration", 1992; regret after Potvin & Rousseau, EJOR 1993; ruin and
recreate after Shaw, 1998, and Christiaens & Vanden Berghe ("blinks"), 2020.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, IntArray

NONE = -1
FREE, GONE = -1, -2  #: owners of tasks that nobody has, and that are not in the table any more
FAR = 1e18


class Routes(NamedTuple):
    """Routes of n robots over m tasks; N = n + 2 m nodes, R rooms."""

    travel: Array  #: (R, R) [s]
    capacity: IntArray  #: (n,)
    room: IntArray  #: (N,) where the node is
    service: Array  #: (N,) [s]
    release: Array  #: (N,) the leg toward the node starts no earlier [s]
    due: Array  #: (N,) time that must be kept [s], inf: none
    after: IntArray  #: (N,) next node, -1: none
    before: IntArray  #: (N,) previous node, -1: none
    time: Array  #: (N,) end of service; of a robot's node: when it is free [s]
    latest: Array  #: (N,) largest time that keeps all due times from here on [s]
    load: IntArray  #: (N,) on board behind the node; of a robot's node: at its start
    drops: IntArray  #: (N,) drops behind the node
    owner: IntArray  #: (m,) robot, FREE or GONE
    aboard: IntArray  #: (m,) 1: picked up already, only the drop is in the route


class Weights(NamedTuple):
    """What one second costs."""

    completion: float  #: of a task's completion time
    travel: float  #: of a route's end
    makespan: float  #: of the last route's end
    own: float  #: extra weight of the inserted task's own completion time


class Place(NamedTuple):
    """Where a task goes in a route."""

    cost: float  #: increase of the objective, inf: nowhere
    pick: int  #: node before the pickup; NONE if it is on board
    drop: int  #: node before the drop; the pickup's own node if it comes directly behind


@njit(cache=True)
def refresh(w: Routes, r: int) -> None:  # pragma: no cover - compiled
    """Times, loads and slacks of robot ``r``'s route, from its order of nodes."""
    n = len(w.capacity)
    x, last = w.after[r], r
    while x != NONE:
        p = last
        w.time[x] = max(w.time[p], w.release[x]) + w.travel[w.room[p], w.room[x]] + w.service[x]
        w.load[x] = w.load[p] + 1 - 2 * ((x - n) & 1)
        last = x
        x = w.after[x]
    w.latest[last] = w.due[last]
    w.drops[last] = 0
    x = last
    while x != r:
        p = w.before[x]
        w.latest[p] = min(w.due[p], w.latest[x] - w.service[x] - w.travel[w.room[p], w.room[x]])
        w.drops[p] = w.drops[x] + ((x - n) & 1)
        x = p


@njit(cache=True)
def end_of(w: Routes, r: int) -> float:  # pragma: no cover - compiled
    """Time [s] of the last node of a route."""
    x = r
    while w.after[x] != NONE:
        x = w.after[x]
    return float(w.time[x])


@njit(cache=True)
def _price(
    weights: Weights, done: float, shifts: float, old_end: float, new_end: float, span: float
) -> float:  # pragma: no cover - compiled
    cost = weights.completion * (done * (1.0 + weights.own) + shifts)
    cost += weights.travel * (new_end - old_end)
    return cost + weights.makespan * max(0.0, new_end - span)


@njit(cache=True)
def place_of(  # noqa: PLR0915 - one loop, split would cost calls per place
    w: Routes, k: int, r: int, weights: Weights, span: float, blink: float, seed: NDArray[np.uint64]
) -> Place:  # pragma: no cover - compiled
    """Cheapest place of task ``k`` in the route of robot ``r`` that keeps all due times.

    Args:
        w: routes.
        k: task that nobody has.
        r: robot.
        weights: objective.
        span: last end of all routes [s], for the makespan.
        blink: probability to overlook a place.
        seed: (1,) state of the random numbers.
    """
    n = len(w.capacity)
    pick = n + 2 * k
    drop = pick + 1
    limit = w.capacity[r]
    room_p, room_d = w.room[pick], w.room[drop]
    ride = w.travel[room_p, room_d] + w.service[drop]
    old_end = end_of(w, r) if weights.travel > 0.0 or weights.makespan > 0.0 else 0.0
    best, best_a, best_b = np.inf, NONE, NONE
    a = r
    while a != NONE:
        begun = max(w.time[a], w.release[pick])
        t_pick = begun + w.travel[w.room[a], room_p] + w.service[pick]
        if t_pick + ride > w.due[drop]:
            break  # later places are later still
        c = w.after[a]
        if w.load[a] < limit and (blink == 0.0 or draw(seed) >= blink):
            t_drop = t_pick + ride
            if c == NONE:
                cost = _price(weights, t_drop, 0.0, old_end, t_drop, span)
                if cost < best:
                    best, best_a, best_b = cost, a, pick
            else:
                t_c = max(t_drop, w.release[c]) + w.travel[room_d, w.room[c]] + w.service[c]
                if t_c <= w.latest[c]:
                    shift = t_c - w.time[c]
                    cost = _price(
                        weights, t_drop, shift * w.drops[a], old_end, old_end + shift, span
                    )
                    if cost < best:
                        best, best_a, best_b = cost, a, pick
                t_x = max(t_pick, w.release[c]) + w.travel[room_p, w.room[c]] + w.service[c]
                shifts, x = 0.0, c
                while t_x <= w.latest[x] and w.load[x] < limit:
                    if (x - n) & 1:
                        shifts += t_x - w.time[x]
                    t_drop = t_x + w.travel[w.room[x], room_d] + w.service[drop]
                    if t_drop > w.due[drop]:
                        break
                    y = w.after[x]
                    if y == NONE:
                        cost = _price(weights, t_drop, shifts, old_end, t_drop, span)
                        if cost < best:
                            best, best_a, best_b = cost, a, x
                        break
                    t_y = max(t_drop, w.release[y]) + w.travel[room_d, w.room[y]] + w.service[y]
                    if t_y <= w.latest[y] and (blink == 0.0 or draw(seed) >= blink):
                        shift = t_y - w.time[y]
                        cost = _price(
                            weights, t_drop, shifts + shift * w.drops[x], old_end,
                            old_end + shift, span,
                        )  # fmt: skip
                        if cost < best:
                            best, best_a, best_b = cost, a, x
                    t_x = max(t_x, w.release[y]) + w.travel[w.room[x], w.room[y]] + w.service[y]
                    x = y
        a = c
    return Place(best, best_a, best_b)


@njit(cache=True)
def drop_place_of(
    w: Routes, k: int, r: int, weights: Weights
) -> Place:  # pragma: no cover - compiled
    """Cheapest place of the drop of task ``k``, which is on board of robot ``r``."""
    n = len(w.capacity)
    drop = n + 2 * k + 1
    room_d = w.room[drop]
    best, best_b = np.inf, NONE
    x = r
    while x != NONE:
        t_drop = w.time[x] + w.travel[w.room[x], room_d] + w.service[drop]
        if t_drop > w.due[drop]:
            break
        y = w.after[x]
        cost, fits = t_drop * (1.0 + weights.own), True
        if y != NONE:
            t_y = max(t_drop, w.release[y]) + w.travel[room_d, w.room[y]] + w.service[y]
            fits = t_y <= w.latest[y]
            cost += (t_y - w.time[y]) * w.drops[x]
        if fits and cost < best:
            best, best_b = cost, x
        # Loads count the task until it is dropped, so pickups before the drop must fit.
        x = y
        if x != NONE and w.load[x] > w.capacity[r]:
            break
    return Place(best, NONE, best_b)


@njit(cache=True)
def link(w: Routes, x: int, a: int) -> None:  # pragma: no cover - compiled
    """Put node ``x`` behind node ``a``."""
    c = w.after[a]
    w.after[a], w.before[x], w.after[x] = x, a, c
    if c != NONE:
        w.before[c] = x


@njit(cache=True)
def unlink(w: Routes, x: int) -> None:  # pragma: no cover - compiled
    """Take node ``x`` out of its route."""
    a, c = w.before[x], w.after[x]
    w.after[a] = c
    if c != NONE:
        w.before[c] = a
    w.after[x] = w.before[x] = NONE


@njit(cache=True)
def insert(w: Routes, k: int, r: int, place: Place) -> None:  # pragma: no cover - compiled
    """Give task ``k`` to robot ``r`` at ``place``."""
    n = len(w.capacity)
    if place.pick != NONE:
        link(w, n + 2 * k, place.pick)
    link(w, n + 2 * k + 1, place.drop)
    w.owner[k] = r
    refresh(w, r)


@njit(cache=True)
def remove(w: Routes, k: int) -> int:  # pragma: no cover - compiled
    """Take task ``k``, which is not on board, from its robot; gives the robot."""
    n = len(w.capacity)
    r = int(w.owner[k])
    unlink(w, n + 2 * k)
    unlink(w, n + 2 * k + 1)
    w.owner[k] = FREE
    refresh(w, r)
    return r


@njit(cache=True)
def draw(seed: NDArray[np.uint64]) -> float:  # pragma: no cover - compiled
    """Uniform number in [0, 1): xorshift64* of Vigna, 2016."""
    x = seed[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    seed[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True)
def last_end(w: Routes) -> float:  # pragma: no cover - compiled
    """Makespan [s]."""
    span = 0.0
    for r in range(len(w.capacity)):
        span = max(span, end_of(w, r))
    return span


@njit(cache=True)
def construct(
    w: Routes,
    pending: IntArray,
    weights: Weights,
    by_bid: bool,
    blink: float,
    seed: NDArray[np.uint64],
) -> IntArray:  # pragma: no cover - compiled
    """Insert pending tasks one by one; gives those that fit nowhere.

    Args:
        w: routes; changed.
        pending: (p,) tasks that nobody has.
        weights: objective.
        by_bid: False: the task that would suffer most from waiting first (regret);
            True: the task with the lowest bid of all first (a sequential auction).
        blink: probability to overlook a place.
        seed: (1,) state of the random numbers; changed.
    """
    n, p = len(w.capacity), len(pending)
    price = np.empty((p, n))
    first, best, second = np.empty(p, np.int64), np.empty(p), np.empty(p)
    waits = np.ones(p, np.bool_)
    span = last_end(w) if weights.makespan > 0.0 else 0.0
    for i in range(p):
        for r in range(n):
            price[i, r] = place_of(w, pending[i], r, weights, span, blink, seed).cost
        first[i], best[i], second[i] = _two_best(price[i])
    for _ in range(p):
        chosen, top, top_due = -1, -np.inf, np.inf
        for i in range(p):
            if not waits[i] or best[i] == np.inf:
                continue
            due = w.due[n + 2 * pending[i] + 1]
            rank = second[i] - best[i] if second[i] < np.inf else FAR
            rank = -best[i] if by_bid else rank
            if rank > top or (rank == top and due < top_due):
                chosen, top, top_due = i, rank, due
        if chosen < 0:
            break
        r = first[chosen]
        place = place_of(w, pending[chosen], r, weights, span, 0.0, seed)
        insert(w, pending[chosen], r, place)
        waits[chosen] = False
        if weights.makespan > 0.0:
            span = last_end(w)
        for i in range(p):
            if not waits[i] or (price[i, r] == np.inf and blink == 0.0):
                continue
            new = place_of(w, pending[i], r, weights, span, blink, seed).cost
            old = price[i, r]
            price[i, r] = new
            if r == first[i] and new < second[i]:
                best[i] = new
            elif r == first[i] or old == second[i] or new < best[i]:
                first[i], best[i], second[i] = _two_best(price[i])
            elif new < second[i]:
                second[i] = new
    return pending[waits]


@njit(cache=True)
def _two_best(price: Array) -> tuple[int, float, float]:  # pragma: no cover - compiled
    first, best, second = 0, np.inf, np.inf
    for r in range(len(price)):
        if price[r] < best:
            first, best, second = r, price[r], best
        elif price[r] < second:
            second = price[r]
    return first, best, second
