"""Compiled parts of the insertion allocators: routes as linked lists with slack times.

Node ``r < n`` is the start of robot r. Nodes ``n + 2 k`` and ``n + 2 k + 1`` are pickup and
drop of task k. Every node knows its time and the latest time that spoils no deadline after it.
It also knows the load behind it and how many drops follow, so that trying a place costs
constant time. Travel times are closed under shortest paths: going elsewhere first is never quicker.

Reference: constant-time tests after Savelsbergh, "The vehicle routing problem with time
windows: minimizing route duration", 1992; regret after Potvin & Rousseau, EJOR 1993; ruin and
recreate after Shaw, 1998, and Christiaens & Vanden Berghe ("blinks"), 2020.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit

NONE = -1
FREE, GONE = -1, -2  #: owners of tasks that no robot has, and that are not in the table any more
FAR = 1e18

#: one record per node; a record is passed on as one pointer, which halves the time to compile
NODE = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("time", np.float64),  # end of service; of a robot's node: when it is free [s]
                ("latest", np.float64),  # largest time that keeps all due times from here on [s]
                ("release", np.float64),  # the leg toward the node starts no earlier [s]
                ("service", np.float64),  # [s]
                ("due", np.float64),  # time that must be kept [s], inf: none
                ("room", np.int64),  # where the node is
                ("after", np.int64),  # next node, -1: none
                ("before", np.int64),  # previous node, -1: none
                ("load", np.int64),  # on board behind the node; of a robot's node: at its start
                ("drops", np.int64),  # drops behind the node
            ],
            align=True,
        ),
    )
)
TASK = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("owner", np.int64),  # robot, FREE or GONE
                ("aboard", np.int64),  # 1: picked up already, only the drop is in the route
                ("only", np.int64),  # the robot that must serve it, FREE: any
            ],
            align=True,
        ),
    )
)
Records = NDArray[np.void]

#: functions that Python calls, and those that only compiled code calls (quicker to compile)
entry = partial(njit, cache=True, no_cfunc_wrapper=True)
inner = partial(njit, cache=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)


class Routes(NamedTuple):
    """Routes of n robots over m tasks; N = n + 2 m nodes, R rooms."""

    travel: Array  #: (R, R) [s]
    capacity: IntArray  #: (n,)
    node: Records  #: (N,) of NODE
    task: Records  #: (m,) of TASK


class Weights(NamedTuple):
    """What one second costs."""

    completion: float  #: of a task's completion time
    travel: float  #: of a route's end
    makespan: float  #: of the last route's end
    own: float  #: extra weight of the inserted task's own completion time


class Slot(NamedTuple):
    """Where a task goes in a route."""

    cost: float  #: increase of the objective, inf: nowhere
    pick: int  #: node before the pickup; NONE if it is on board
    drop: int  #: node before the drop; the pickup's own node if it comes directly behind


@entry()
def refresh(w: Routes, r: int) -> None:  # pragma: no cover - compiled
    """Work out times, loads and slacks of robot ``r``'s route from its order of nodes."""
    n = len(w.capacity)
    last, x = r, w.node[r].after
    while x != NONE:
        a, b = w.node[last], w.node[x]
        b.time = max(a.time, b.release) + w.travel[a.room, b.room] + b.service
        b.load = a.load + 1 - 2 * ((x - n) & 1)
        last, x = x, b.after
    w.node[last].latest = w.node[last].due
    w.node[last].drops = 0
    x = last
    while x != r:
        b = w.node[x]
        a = w.node[b.before]
        a.latest = min(a.due, b.latest - b.service - w.travel[a.room, b.room])
        a.drops = b.drops + ((x - n) & 1)
        x = b.before


@inner()
def end_of(w: Routes, r: int) -> float:  # pragma: no cover - compiled
    """Time [s] of the last node of a route."""
    x = r
    while w.node[x].after != NONE:
        x = w.node[x].after
    return float(w.node[x].time)


@inner()
def _price(
    weights: Weights, done: float, shifts: float, old_end: float, new_end: float, span: float
) -> float:  # pragma: no cover - compiled
    cost = weights.completion * (done * (1.0 + weights.own) + shifts)
    cost += weights.travel * (new_end - old_end)
    return cost + weights.makespan * max(0.0, new_end - span)


@inner()
def _reach(
    w: Routes, room: int, time: float, node: np.record
) -> float:  # pragma: no cover - compiled
    """When ``node`` is done by a robot that is ready in ``room`` at ``time`` [s]."""
    return float(max(time, node.release) + w.travel[room, node.room] + node.service)


@inner()
def cheapest_slot(  # noqa: PLR0915 - one loop, split would cost calls per place
    w: Routes, k: int, r: int, weights: Weights, span: float, blink: float, seed: NDArray[np.uint64]
) -> Slot:  # pragma: no cover - compiled
    """Find the cheapest place of task ``k`` in the route of robot ``r`` that keeps all due times.

    Args:
        w: routes.
        k: task that no robot has.
        r: robot.
        weights: objective.
        span: last end of all routes [s], for the makespan.
        blink: probability to overlook a place.
        seed: (1,) state of the random numbers.
    """
    if w.task[k].only not in (FREE, r):
        return Slot(np.inf, NONE, NONE)
    n = len(w.capacity)
    pick, drop = w.node[n + 2 * k], w.node[n + 2 * k + 1]
    limit = w.capacity[r]
    ride = w.travel[pick.room, drop.room] + drop.service
    old_end = end_of(w, r) if weights.travel > 0.0 or weights.makespan > 0.0 else 0.0
    best, best_a, best_b = np.inf, NONE, NONE
    a = r
    while a != NONE:
        ahead = w.node[a]
        begun = max(ahead.time, pick.release)
        t_pick = begun + w.travel[ahead.room, pick.room] + pick.service
        if t_pick + ride > drop.due:
            break  # later places are later still
        c = ahead.after
        if ahead.load < limit and (blink == 0.0 or uniform(seed) >= blink):
            t_drop = t_pick + ride
            if c == NONE:
                cost = _price(weights, t_drop, 0.0, old_end, t_drop, span)
                if cost < best:
                    best, best_a, best_b = cost, a, n + 2 * k
            else:
                x, here = c, w.node[c]
                t_c = _reach(w, drop.room, t_drop, here)
                if t_c <= here.latest:
                    shift = t_c - here.time
                    moved = shift * ahead.drops
                    cost = _price(weights, t_drop, moved, old_end, old_end + shift, span)
                    if cost < best:
                        best, best_a, best_b = cost, a, n + 2 * k
                t_x = _reach(w, pick.room, t_pick, here)
                shifts = 0.0
                while t_x <= here.latest and here.load < limit:
                    if (x - n) & 1:
                        shifts += t_x - here.time
                    t_drop = t_x + w.travel[here.room, drop.room] + drop.service
                    if t_drop > drop.due:
                        break
                    y = here.after
                    if y == NONE:
                        cost = _price(weights, t_drop, shifts, old_end, t_drop, span)
                        if cost < best:
                            best, best_a, best_b = cost, a, x
                        break
                    follows = w.node[y]
                    t_y = _reach(w, drop.room, t_drop, follows)
                    if t_y <= follows.latest and (blink == 0.0 or uniform(seed) >= blink):
                        shift = t_y - follows.time
                        moved = shifts + shift * here.drops
                        cost = _price(weights, t_drop, moved, old_end, old_end + shift, span)
                        if cost < best:
                            best, best_a, best_b = cost, a, x
                    t_x = _reach(w, here.room, t_x, follows)
                    x, here = y, follows
        a = c
    return Slot(best, best_a, best_b)


@inner()
def drop_place_of(
    w: Routes, k: int, r: int, weights: Weights
) -> Slot:  # pragma: no cover - compiled
    """Cheapest place of the drop of task ``k``, which is on board of robot ``r``."""
    n = len(w.capacity)
    drop = w.node[n + 2 * k + 1]
    best, best_b = np.inf, NONE
    x = r
    while x != NONE:
        here = w.node[x]
        t_drop = here.time + w.travel[here.room, drop.room] + drop.service
        if t_drop > drop.due:
            break
        y = here.after
        cost, fits = t_drop * (1.0 + weights.own), True
        if y != NONE:
            follows = w.node[y]
            t_y = _reach(w, drop.room, t_drop, follows)
            fits = t_y <= follows.latest
            cost += (t_y - follows.time) * here.drops
        if fits and cost < best:
            best, best_b = cost, x
        # Loads count the task until it is dropped, so pickups before the drop must fit.
        x = y
        if x != NONE and w.node[x].load > w.capacity[r]:
            break
    return Slot(best, NONE, best_b)


@inner()
def link(w: Routes, x: int, a: int) -> None:  # pragma: no cover - compiled
    """Put node ``x`` behind node ``a``."""
    c = w.node[a].after
    w.node[a].after = x
    w.node[x].before = a
    w.node[x].after = c
    if c != NONE:
        w.node[c].before = x


@inner()
def unlink(w: Routes, x: int) -> None:  # pragma: no cover - compiled
    """Take node ``x`` out of its route."""
    a, c = w.node[x].before, w.node[x].after
    w.node[a].after = c
    if c != NONE:
        w.node[c].before = a
    w.node[x].after = NONE
    w.node[x].before = NONE


@inner()
def insert(w: Routes, k: int, r: int, place: Slot) -> None:  # pragma: no cover - compiled
    """Give task ``k`` to robot ``r`` at ``place``."""
    n = len(w.capacity)
    if place.pick != NONE:
        link(w, n + 2 * k, place.pick)
    link(w, n + 2 * k + 1, place.drop)
    w.task[k].owner = r
    refresh(w, r)


@inner()
def remove(w: Routes, k: int) -> int:  # pragma: no cover - compiled
    """Take task ``k``, which is not on board, from its robot, and return the robot."""
    n = len(w.capacity)
    r = int(w.task[k].owner)
    unlink(w, n + 2 * k)
    unlink(w, n + 2 * k + 1)
    w.task[k].owner = FREE
    refresh(w, r)
    return r


@inner()
def uniform(seed: NDArray[np.uint64]) -> float:  # pragma: no cover - compiled
    """Draw a uniform number in [0, 1): xorshift64* of Vigna, 2016."""
    x = seed[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    seed[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@inner()
def _span(w: Routes, weights: Weights) -> float:  # pragma: no cover - compiled
    """Makespan [s] if it counts, else 0."""
    return last_end(w) if weights.makespan > 0.0 else 0.0


@inner()
def last_end(w: Routes) -> float:  # pragma: no cover - compiled
    """Makespan [s]."""
    span = 0.0
    for r in range(len(w.capacity)):
        span = max(span, end_of(w, r))
    return span


@entry()
def construct(
    w: Routes,
    pending: IntArray,
    weights: Weights,
    by_bid: bool,
    blink: float,
    seed: NDArray[np.uint64],
) -> IntArray:  # pragma: no cover - compiled
    """Insert pending tasks one by one, and return those that fit nowhere.

    Args:
        w: routes; changed.
        pending: (p,) tasks that no robot has.
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
    span = _span(w, weights)
    for i in range(p):
        for r in range(n):
            price[i, r] = cheapest_slot(w, pending[i], r, weights, span, blink, seed).cost
        first[i], best[i], second[i] = _two_best(price, i)
    for _ in range(p):
        chosen = _next_task(w, pending, waits, best, second, by_bid)
        if chosen < 0:
            break
        r = first[chosen]
        place = cheapest_slot(w, pending[chosen], r, weights, span, 0.0, seed)
        insert(w, pending[chosen], r, place)
        waits[chosen] = False
        span = _span(w, weights)
        for i in range(p):
            if not waits[i] or (price[i, r] == np.inf and blink == 0.0):
                continue
            new = cheapest_slot(w, pending[i], r, weights, span, blink, seed).cost
            old = price[i, r]
            price[i, r] = new
            if r == first[i] and new < second[i]:
                best[i] = new
            elif r == first[i] or old == second[i] or new < best[i]:
                first[i], best[i], second[i] = _two_best(price, i)
            elif new < second[i]:
                second[i] = new
    return pending[waits]


@inner()
def _next_task(
    w: Routes, pending: IntArray, waits: BoolArray, best: Array, second: Array, by_bid: bool
) -> int:  # pragma: no cover - compiled
    """Which of the pending tasks that wait is inserted next, -1: none fits anywhere."""
    n = len(w.capacity)
    chosen, top, top_due = -1, -np.inf, np.inf
    for i in range(len(pending)):
        if not waits[i] or best[i] == np.inf:
            continue
        due = w.node[n + 2 * pending[i] + 1].due
        rank = second[i] - best[i] if second[i] < np.inf else FAR
        rank = -best[i] if by_bid else rank
        if rank > top or (rank == top and due < top_due):
            chosen, top, top_due = i, rank, due
    return chosen


@inner()
def _two_best(price: Array, i: int) -> tuple[int, float, float]:  # pragma: no cover - compiled
    first, best, second = 0, np.inf, np.inf
    for r in range(price.shape[1]):
        cost = price[i, r]
        if cost < best:
            first, best, second = r, cost, best
        elif cost < second:
            second = cost
    return first, best, second
