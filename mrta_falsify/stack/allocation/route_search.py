"""Compiled: can one robot serve a set of tasks in time? Exact, by depth-first search.

States already seen without success no later than now are not entered again, and a state is
left as soon as a task cannot be in time even if the robot goes to it directly, or the tasks
due first cannot be in time even if every leg were the shortest one to its end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.stack.allocation.route_kernels import entry, inner

FEASIBLE, INFEASIBLE, CUT_OFF = 1, 0, -1
MOST_TASKS = 30  # of one route: 3^30 x 64 fits into 64 bits
_REMEMBER_FROM = 200  # nodes; shorter searches need no memory


class Jobs(NamedTuple):
    """m tasks."""

    start: IntArray  #: (m,) room of the pickup
    end: IntArray  #: (m,) room of the drop
    load: Array  #: (m,) service of the pickup [s]
    unload: Array  #: (m,) service of the drop [s]
    release: Array  #: (m,) [s]
    due: Array  #: (m,) [s]


class Starts(NamedTuple):
    """n robots."""

    room: IntArray  #: (n,)
    time: Array  #: (n,) when it is free [s]
    capacity: IntArray  #: (n,)


@entry()
def search_route(  # noqa: PLR0915 - one search
    travel: Array,
    jobs: Jobs,
    starts: Starts,
    robot: int,
    chosen: IntArray,
    state: IntArray,
    soft: BoolArray,
    limit: int,
) -> tuple[int, int, IntArray]:  # pragma: no cover - compiled
    """Order of stops with which a robot keeps the due times of all chosen tasks.

    Args:
        travel: ``(R, R)`` [s], closed under shortest paths.
        jobs: all tasks.
        starts: all robots.
        robot: which one.
        chosen: (s,) tasks, s <= 30.
        state: (s,) 0: to be picked up, 1: on board.
        soft: (s,) its due time does not count.
        limit: nodes that may be searched.

    Returns:
        FEASIBLE, INFEASIBLE or CUT_OFF; nodes searched; and the order, ``2 i`` for the pickup
        and ``2 i + 1`` for the drop of ``chosen[i]``.
    """
    s = len(chosen)
    due = np.empty(s)
    for i in range(s):
        due[i] = np.inf if soft[i] else jobs.due[chosen[i]]
    by_due = np.argsort(due, kind="mergesort")
    room = np.empty(2 * s, np.int64)
    service = np.empty(2 * s)
    release = np.zeros(2 * s)
    for i in range(s):
        k = chosen[i]
        room[2 * i], room[2 * i + 1] = jobs.start[k], jobs.end[k]
        service[2 * i], service[2 * i + 1] = jobs.load[k], jobs.unload[k]
        release[2 * i] = jobs.release[k]
    least = np.empty(2 * s)  # shortest leg to each stop, with its service
    for x in range(2 * s):
        least[x] = travel[starts.room[robot], room[x]]
        for y in range(2 * s):
            if y != x and (state[y >> 1] == 0 or y & 1):
                least[x] = min(least[x], travel[room[y], room[x]])
        least[x] += service[x]
    power = np.empty(s, np.int64)
    value = 64
    for i in range(s):
        power[i] = value
        value *= 3
    now = state.copy()
    load, key, to_drop = 0, 0, s
    for i in range(s):
        load += now[i]
        key += now[i] * power[i]
    depth = 0
    time = np.empty(2 * s + 1)
    here = np.empty(2 * s + 1, np.int64)
    path = np.empty(2 * s, np.int64)
    options = np.empty((2 * s + 1, 2 * s), np.int64)
    count = np.zeros(2 * s + 1, np.int64)
    tried = np.zeros(2 * s + 1, np.int64)
    rank = np.empty(2 * s)
    time[0], here[0] = starts.time[robot], starts.room[robot]
    seen_key = np.empty(1, np.int64)
    seen_time = np.empty(1)
    size, filled, nodes, entering = 0, 0, 0, True
    while True:
        if entering:
            entering = False
            nodes += 1
            if to_drop == 0:
                return FEASIBLE, nodes, path[:depth]
            if nodes > limit:
                return CUT_OFF, nodes, path[:0]
            count[depth] = tried[depth] = 0
            open_state = _may_be_in_time(
                travel, room, service, release, due, by_due, least, now, time[depth], here[depth]
            )
            if open_state and nodes > _REMEMBER_FROM:
                if size == 0 or 2 * filled > size:
                    size, seen_key, seen_time = _larger(size, seen_key, seen_time)
                last = path[depth - 1] if depth > 0 else 63
                slot = _slot(seen_key, key + last)
                if seen_key[slot] == -1:
                    seen_key[slot] = key + last
                    seen_time[slot] = time[depth]
                    filled += 1
                elif seen_time[slot] <= time[depth]:
                    open_state = False
                else:
                    seen_time[slot] = time[depth]
            if open_state:
                c = 0
                for i in range(s):
                    if now[i] == 2 or (now[i] == 0 and load >= starts.capacity[robot]):
                        continue
                    x = 2 * i + now[i]
                    arrives = max(time[depth], release[x]) + travel[here[depth], room[x]]
                    r = arrives + min(due[i], 1e9)
                    j = c
                    while j > 0 and rank[j - 1] > r:
                        rank[j] = rank[j - 1]
                        options[depth, j] = options[depth, j - 1]
                        j -= 1
                    rank[j] = r
                    options[depth, j] = x
                    c += 1
                count[depth] = c
        if tried[depth] < count[depth]:
            x = options[depth, tried[depth]]
            tried[depth] += 1
            t = max(time[depth], release[x]) + travel[here[depth], room[x]] + service[x]
            i = x >> 1
            if x & 1:
                if t > due[i]:
                    continue
                load -= 1
                to_drop -= 1
            else:
                load += 1
            now[i] += 1
            key += power[i]
            path[depth] = x
            depth += 1
            time[depth], here[depth] = t, room[x]
            entering = True
            continue
        if depth == 0:
            return INFEASIBLE, nodes, path[:0]
        depth -= 1
        x = path[depth]
        now[x >> 1] -= 1
        key -= power[x >> 1]
        if x & 1:
            load += 1
            to_drop += 1
        else:
            load -= 1


@inner()
def _may_be_in_time(
    travel: Array,
    room: IntArray,
    service: Array,
    release: Array,
    due: Array,
    by_due: IntArray,
    least: Array,
    now: IntArray,
    time: float,
    here: int,
) -> bool:  # pragma: no cover - compiled
    work = time
    for i in by_due:
        if now[i] == 2 or due[i] == np.inf:
            continue
        p, d = 2 * i, 2 * i + 1
        if now[i] == 0:
            t = max(time, release[p]) + travel[here, room[p]] + service[p]
            t += travel[room[p], room[d]] + service[d]
            work += least[p]
        else:
            t = time + travel[here, room[d]] + service[d]
        work += least[d]
        if t > due[i] or work > due[i]:
            return False
    return True


@inner()
def _slot(keys: IntArray, key: int) -> int:  # pragma: no cover - compiled
    mask = len(keys) - 1
    slot = (key ^ (key >> 17) ^ (key >> 33)) * 40503 & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@inner()
def _larger(
    size: int, keys: IntArray, times: Array
) -> tuple[int, IntArray, Array]:  # pragma: no cover - compiled
    new_size = max(1024, 4 * size)
    new_keys = np.full(new_size, -1, np.int64)
    new_times = np.empty(new_size)
    for i in range(size):
        if keys[i] != -1:
            slot = _slot(new_keys, keys[i])
            new_keys[slot], new_times[slot] = keys[i], times[i]
    return new_size, new_keys, new_times


@entry()
def clashing_pairs(
    travel: Array, jobs: Jobs, starts: Starts, alone: BoolArray
) -> BoolArray:  # pragma: no cover - compiled
    """Which pairs of tasks a robot without load cannot both serve in time.

    Args:
        travel: ``(R, R)`` [s].
        jobs: m tasks.
        starts: n robots.
        alone: (n, m) the robot can serve the task alone.

    Returns:
        ``(n, m, m)``, symmetric; False where one of the two is not possible alone.
    """
    n, m = alone.shape
    clash = np.zeros((n, m, m), np.bool_)
    both, fresh, hard = np.empty(2, np.int64), np.zeros(2, np.int64), np.zeros(2, np.bool_)
    for r in range(n):
        for k in range(m):
            for j in range(k):
                if alone[r, k] and alone[r, j]:
                    both[0], both[1] = j, k
                    answer, _, _ = search_route(travel, jobs, starts, r, both, fresh, hard, 1000)
                    clash[r, k, j] = clash[r, j, k] = answer == INFEASIBLE
    return clash


@entry()
def feasible_sets(
    travel: Array,
    jobs: Jobs,
    starts: Starts,
    robot: int,
    carried: IntArray,
    allowed: IntArray,
    most: int,
) -> tuple[bool, IntArray, int]:  # pragma: no cover - compiled
    """All largest sets of tasks that one robot can serve in time.

    Args:
        travel: ``(R, R)`` [s].
        jobs: m <= 62 tasks.
        starts: n robots.
        robot: which one.
        carried: tasks on board.
        allowed: tasks that it can serve alone, sorted; with those on board.
        most: sets that may be looked at.

    Returns:
        Whether the list is complete, the sets as bits, and the nodes searched.
    """
    one = np.int64(1)
    level = np.zeros(1, np.int64)
    found = np.empty(0, np.int64)
    looked, total = 0, 0
    is_carried = np.zeros(len(jobs.due), np.bool_)
    for k in carried:
        is_carried[k] = True
    chosen = np.empty(len(jobs.due), np.int64)
    state = np.zeros(len(jobs.due), np.int64)
    soft = np.zeros(len(jobs.due), np.bool_)
    while len(level) > 0:
        largest = np.ones(len(level), np.bool_)
        following = np.empty(1024, np.int64)
        count = 0
        for base in level:
            for k in allowed:
                if base >> k != 0:
                    continue  # sets grow by tasks of larger number only
                tasks = base | (one << k)
                s = 0
                for j in range(len(jobs.due)):
                    chosen_here = (tasks >> j) & 1 == 1
                    if chosen_here or is_carried[j]:
                        chosen[s] = j
                        state[s] = 1 if is_carried[j] else 0
                        soft[s] = not chosen_here
                        s += 1
                looked += 1
                if looked > most or s > MOST_TASKS:
                    return False, found, total
                answer, nodes, _ = search_route(
                    travel, jobs, starts, robot, chosen[:s], state[:s], soft[:s], 1_000_000
                )
                total += nodes
                if answer == CUT_OFF:
                    return False, found, total
                if answer == FEASIBLE:
                    if count == len(following):
                        longer = np.empty(2 * count, np.int64)
                        longer[:count] = following
                        following = longer
                    following[count] = tasks
                    count += 1
        following = np.sort(following[:count])
        for tasks in following:
            for k in allowed:
                if (tasks >> k) & 1:
                    i = np.searchsorted(level, tasks ^ (one << k))
                    if i < len(level) and level[i] == tasks ^ (one << k):
                        largest[i] = False
        found = np.concatenate((found, level[largest]))
        level = following
    return True, found, total
