"""Compiled: what happens to routes as time goes by, robots run late and tasks do not fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.stack.allocation.route_kernels import (
    FREE,
    GONE,
    NONE,
    Routes,
    Slot,
    Weights,
    cheapest_slot,
    construct,
    drop_place_of,
    entry,
    inner,
    insert,
    last_end,
    link,
    refresh,
    remove,
    uniform,
    unlink,
)


@entry()
def commit_until(
    w: Routes, now: float, log_node: IntArray, log_robot: IntArray, log_time: Array, used: int
) -> int:  # pragma: no cover - compiled
    """Take every stop whose leg began before ``now`` off the routes, the leg in progress too.

    Args:
        w: routes; changed. Robots without work become free at ``now``.
        now: [s].
        log_node: node of each committed stop; entries from ``used`` on are written.
        log_robot: its robot.
        log_time: its time [s].
        used: entries written so far.

    Returns:
        Entries written now and before.
    """
    n = len(w.capacity)
    for r in range(n):
        robot, moved = w.node[r], False
        x = robot.after
        while x != NONE and max(robot.time, w.node[x].release) < now:
            stop, task = w.node[x], w.task[(x - n) >> 1]
            log_node[used], log_robot[used], log_time[used] = x, r, stop.time
            used += 1
            if (x - n) & 1:
                task.owner = GONE
                robot.load -= 1
            else:
                task.aboard = 1
                robot.load += 1
            robot.room = stop.room
            robot.time = stop.time
            unlink(w, x)
            moved = True
            x = robot.after
        if robot.time < now:
            robot.time = now
            moved = True
        if moved:
            refresh(w, r)
    return used


@inner()
def _place_aboard(w: Routes, k: int, r: int, weights: Weights) -> None:  # pragma: no cover
    """Place the drop of a task on board; where it cannot be in time its due time is given up."""
    n = len(w.capacity)
    place = drop_place_of(w, k, r, weights)
    if place.cost == np.inf:
        w.node[n + 2 * k + 1].due = np.inf
        place = drop_place_of(w, k, r, weights)
    if place.cost == np.inf:  # no place spares the others: directly, they are looked at after it
        place = Slot(0.0, NONE, r)
    insert(w, k, r, place)


@entry()
def board(w: Routes, k: int, r: int, weights: Weights) -> None:  # pragma: no cover - compiled
    """Give robot ``r`` the drop of a task that it carries."""
    _place_aboard(w, k, r, weights)


@entry()
def relieve(w: Routes, r: int, weights: Weights) -> IntArray:  # pragma: no cover - compiled
    """Free a route of what is too late; gives the tasks that were taken off it.

    A late task that is not on board is taken off. One that is on board is dropped earlier if
    that saves it, else its due time is given up: it is late, and nothing else fails for it.
    """
    n = len(w.capacity)
    off = np.empty(len(w.task), np.int64)
    count = 0
    while w.node[r].time > w.node[r].latest:
        x = w.node[r].after
        while w.node[x].time <= w.node[x].due:
            x = w.node[x].after
        k = (x - n) >> 1
        if w.task[k].aboard == 0:
            remove(w, k)
            off[count] = k
            count += 1
            continue
        # Others that are late may be the reason: take those off first that can be taken off.
        y, other = x, NONE
        while y != r:
            j = (y - n) >> 1
            if w.task[j].aboard == 0 and w.node[n + 2 * j + 1].due == np.inf:
                other = j
                break
            y = w.node[y].before
        if other != NONE:
            remove(w, other)
            off[count] = other
            count += 1
            continue
        unlink(w, x)
        refresh(w, r)
        _place_aboard(w, k, r, weights)
    return off[:count]


@entry()
def place_late(w: Routes, k: int, weights: Weights) -> None:  # pragma: no cover - compiled
    """Place a task whose deadline is lost where it spoils no other deadline; needs a robot."""
    n = len(w.capacity)
    w.node[n + 2 * k + 1].due = np.inf
    seed = np.ones(1, np.uint64)
    span = last_end(w)
    best, robot = Slot(np.inf, NONE, NONE), NONE
    for r in range(n):
        place = cheapest_slot(w, k, r, weights, span, 0.0, seed)
        if place.cost < best.cost:
            best, robot = place, r
    insert(w, k, robot, best)


@inner()
def total_cost(w: Routes, weights: Weights) -> float:  # pragma: no cover - compiled
    """Objective of the routes as they are."""
    n = len(w.capacity)
    cost, span = 0.0, 0.0
    for r in range(n):
        x = r
        while w.node[x].after != NONE:
            x = w.node[x].after
            if (x - n) & 1:
                cost += weights.completion * w.node[x].time
        cost += weights.travel * w.node[x].time
        span = max(span, w.node[x].time)
    return cost + weights.makespan * span


@inner()
def copy_routes(source: Routes, target: Routes) -> None:  # pragma: no cover - compiled
    """Copy what changes when tasks move."""
    for x in range(len(source.node)):
        a, b = source.node[x], target.node[x]
        b.time, b.latest = a.time, a.latest
        b.after, b.before = a.after, a.before
        b.load, b.drops = a.load, a.drops
    for k in range(len(source.task)):
        target.task[k].owner = source.task[k].owner


@entry()
def ruin_and_recreate(
    w: Routes,
    spare: Routes,
    best: Routes,
    left: IntArray,
    weights: Weights,
    steps: int,
    only_until_served: bool,
    seed: NDArray[np.uint64],
) -> IntArray:  # pragma: no cover - compiled
    """Take related tasks out and insert them anew, and keep what is better.

    Fewer tasks left over is better than any cost. A step that is worse by less than a
    threshold, which falls to 0, is kept too (threshold accepting).

    Args:
        w: routes; changed to the best found.
        spare: as large, overwritten.
        best: as large, overwritten.
        left: tasks that fit nowhere.
        weights: objective.
        steps: number of ruins.
        only_until_served: stop as soon as nothing is left over.
        seed: (1,) state of the random numbers; changed.

    Returns:
        The tasks left over.
    """
    movable = _movable(w, left)
    count = len(movable)
    cost = total_cost(w, weights)
    copy_routes(w, best)
    best_left, best_cost, now_left, now_cost = left, cost, left, cost
    warmth = 0.02 * (cost / max(1, count))
    for step in range(steps):
        if count == 0 or (only_until_served and len(best_left) == 0):
            break
        copy_routes(w, spare)
        wanted = 2 + int(uniform(seed) * min(count, 10))
        if len(now_left) > 0 and uniform(seed) < 0.7:
            centre = now_left[int(uniform(seed) * len(now_left))]
        else:
            centre = movable[int(uniform(seed) * count)]
        out = _take_out(w, _by_nearness(w, centre, movable, seed), now_left, wanted)
        still = construct(w, out, weights, uniform(seed) < 0.3, 0.05, seed)
        new_cost = total_cost(w, weights)
        allowed = warmth * (1.0 - step / steps) if len(still) == len(now_left) else 0.0
        if len(still) < len(now_left) or (
            len(still) == len(now_left) and new_cost <= now_cost + allowed
        ):
            now_left, now_cost = still, new_cost
            if len(still) < len(best_left) or (
                len(still) == len(best_left) and new_cost < best_cost
            ):
                best_left, best_cost = still, new_cost
                copy_routes(w, best)
        else:
            copy_routes(spare, w)
    copy_routes(best, w)
    return best_left


@inner()
def _movable(w: Routes, left: IntArray) -> IntArray:  # pragma: no cover - compiled
    """Tasks that are in a route without being on board, then those left over."""
    m = len(w.task)
    movable = np.empty(m, np.int64)
    count = 0
    for k in range(m):
        if w.task[k].owner >= 0 and w.task[k].aboard == 0:
            movable[count] = k
            count += 1
    for k in left:
        movable[count] = k
        count += 1
    return movable[:count]


@inner()
def _by_nearness(
    w: Routes, centre: int, movable: IntArray, seed: NDArray[np.uint64]
) -> IntArray:  # pragma: no cover - compiled
    """Tasks in a random order that prefers those near task ``centre``."""
    n = len(w.capacity)
    nearness = np.empty(len(movable))
    pick, drop = w.node[n + 2 * centre], w.node[n + 2 * centre + 1]
    for i in range(len(movable)):
        p, d = w.node[n + 2 * movable[i]], w.node[n + 2 * movable[i] + 1]
        near = w.travel[pick.room, p.room] + w.travel[drop.room, d.room]
        near += w.travel[p.room, pick.room]
        nearness[i] = (near + 1.0) * uniform(seed)
    return movable[np.argsort(nearness, kind="mergesort")]


@inner()
def _take_out(
    w: Routes, tasks: IntArray, left: IntArray, wanted: int
) -> IntArray:  # pragma: no cover - compiled
    """Take the first ``wanted`` of ``tasks`` off their routes; return them behind ``left``."""
    out = np.empty(len(tasks), np.int64)
    out[: len(left)] = left
    filled = len(left)
    for k in tasks:
        if filled == len(left) + wanted:
            break
        if w.task[k].owner >= 0:
            remove(w, k)
            out[filled] = k
            filled += 1
    return out[:filled]


@entry()
def link_last(w: Routes, x: int, r: int) -> None:  # pragma: no cover - compiled
    """Put node ``x`` at the end of a route, without new times."""
    a = r
    while w.node[a].after != NONE:
        a = w.node[a].after
    link(w, x, a)


@entry()
def strip_route(w: Routes, r: int) -> IntArray:  # pragma: no cover - compiled
    """Take every task that is not on board off a route, and return these tasks."""
    n = len(w.capacity)
    off = np.empty(len(w.task), np.int64)
    count = 0
    x = w.node[r].after
    while x != NONE:
        y = w.node[x].after
        k = (x - n) >> 1
        if w.task[k].aboard == 0:
            unlink(w, x)
            if (x - n) & 1:
                off[count] = k
                count += 1
                w.task[k].owner = FREE
        x = y
    refresh(w, r)
    return off[:count]
