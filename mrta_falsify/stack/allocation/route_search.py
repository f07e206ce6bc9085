"""Compiled: can one robot serve a set of tasks in time? Exact, by depth-first search.

Two tests cut the search short:

- A state that was entered before, no later than now, is not entered again.
- A state is left as soon as a task cannot be in time even if the robot goes to it directly. The
  same holds if the tasks due first cannot be in time even with the shortest leg to each stop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.stack.allocation.route_kernels import entry, inner

FEASIBLE, INFEASIBLE, CUT_OFF = 1, 0, -1
MAX_TASKS = 30  # of one route: 3^30 x 64 fits into 64 bits
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


class _Stops(NamedTuple):
    """The 2 s stops of s tasks: ``2 i`` is the pickup of task i, ``2 i + 1`` its drop."""

    room: IntArray  #: (2 s,)
    service: Array  #: (2 s,) [s]
    release: Array  #: (2 s,) [s]
    least: Array  #: (2 s,) shortest leg to the stop, with its service [s]
    due: Array  #: (s,) of the tasks [s], inf: does not count
    by_due: IntArray  #: (s,) tasks, the first due first
    power: IntArray  #: (s,) weight of the task's state in the key of a search state


class _Seen(NamedTuple):
    """Search states that led nowhere: a hash table."""

    key: IntArray  #: (size,) -1: free
    time: Array  #: (size,) the earliest time at which the state was entered [s]


@entry()
def search_route(
    travel: Array,
    jobs: Jobs,
    starts: Starts,
    robot: int,
    chosen: IntArray,
    state: IntArray,
    soft: BoolArray,
    limit: int,
) -> tuple[int, int, IntArray]:  # pragma: no cover - compiled
    """Find an order of stops with which a robot keeps the due times of all chosen tasks.

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
    stops = _stops_of(travel, jobs, starts.room[robot], chosen, state, soft)
    now = state.copy()
    load, to_drop = int(now.sum()), s
    key = int((now * stops.power).sum())
    path = np.empty(2 * s, np.int64)
    time, here = np.full(2 * s + 1, starts.time[robot]), np.full(2 * s + 1, starts.room[robot])
    options, count = np.empty((2 * s + 1, 2 * s), np.int64), np.zeros(2 * s + 1, np.int64)
    tried, rank = count.copy(), np.empty(2 * s)
    seen, filled = _Seen(np.full(1, -1, np.int64), np.empty(1)), 0
    depth, nodes, entering = 0, 0, True
    while True:
        if entering:
            entering = False
            nodes += 1
            if to_drop == 0:
                return FEASIBLE, nodes, path[:depth]
            if nodes > limit:
                return CUT_OFF, nodes, path[:0]
            count[depth] = tried[depth] = 0
            is_open = _may_be_in_time(travel, stops, now, time[depth], here[depth])
            if is_open and nodes > _REMEMBER_FROM:
                seen = _with_room(seen, filled)
                last = path[depth - 1] if depth > 0 else 63
                is_open, new = _note_state(seen, key + last, time[depth])
                filled += new
            if is_open:
                may_load = load < starts.capacity[robot]
                count[depth] = _fill_options(
                    options[depth], rank, travel, stops, now, time[depth], here[depth], may_load
                )
        if tried[depth] < count[depth]:
            x = options[depth, tried[depth]]
            tried[depth] += 1
            t = _done_at(travel, stops, x, time[depth], here[depth])
            if x & 1 and t > stops.due[x >> 1]:
                continue
            path[depth] = x
            depth += 1
            time[depth], here[depth] = t, stops.room[x]
            step, entering = 1, True
        elif depth == 0:
            return INFEASIBLE, nodes, path[:0]
        else:
            depth -= 1
            x, step = path[depth], -1
        now[x >> 1] += step
        key += step * stops.power[x >> 1]
        load += step * (1 - 2 * (x & 1))
        to_drop -= step * (x & 1)


@inner()
def _stops_of(
    travel: Array, jobs: Jobs, room: int, chosen: IntArray, state: IntArray, soft: BoolArray
) -> _Stops:  # pragma: no cover - compiled
    """Stops of the chosen tasks for a robot that begins in ``room``."""
    s = len(chosen)
    at, service, release = np.empty(2 * s, np.int64), np.empty(2 * s), np.zeros(2 * s)
    due, power, value = np.empty(s), np.empty(s, np.int64), 64
    for i in range(s):
        k = chosen[i]
        due[i] = np.inf if soft[i] else jobs.due[k]
        at[2 * i], at[2 * i + 1] = jobs.start[k], jobs.end[k]
        service[2 * i], service[2 * i + 1] = jobs.load[k], jobs.unload[k]
        release[2 * i] = jobs.release[k]
        power[i] = value
        value *= 3
    least = np.empty(2 * s)
    for x in range(2 * s):
        least[x] = travel[room, at[x]]
        for y in range(2 * s):
            if y != x and (state[y >> 1] == 0 or y & 1):
                least[x] = min(least[x], travel[at[y], at[x]])
        least[x] += service[x]
    return _Stops(at, service, release, least, due, np.argsort(due, kind="mergesort"), power)


@inner()
def _done_at(
    travel: Array, stops: _Stops, x: int, time: float, here: int
) -> float:  # pragma: no cover - compiled
    """When stop ``x`` is done by a robot that is ready in room ``here`` at ``time`` [s]."""
    begun = max(time, stops.release[x])
    return float(begun + travel[here, stops.room[x]] + stops.service[x])


@inner()
def _fill_options(
    options: IntArray,
    rank: Array,
    travel: Array,
    stops: _Stops,
    now: IntArray,
    time: float,
    here: int,
    may_load: bool,
) -> int:  # pragma: no cover - compiled
    """List the stops that may come next, the most urgent first, with ranks; return how many."""
    count = 0
    for i in range(len(now)):
        if now[i] == 2 or (now[i] == 0 and not may_load):
            continue
        x = 2 * i + now[i]
        arrives = max(time, stops.release[x]) + travel[here, stops.room[x]]
        r = arrives + min(stops.due[i], 1e9)
        j = count
        while j > 0 and rank[j - 1] > r:
            rank[j] = rank[j - 1]
            options[j] = options[j - 1]
            j -= 1
        rank[j] = r
        options[j] = x
        count += 1
    return count


@inner()
def _may_be_in_time(
    travel: Array, stops: _Stops, now: IntArray, time: float, here: int
) -> bool:  # pragma: no cover - compiled
    """Whether each open task alone, and the tasks due first together, can still be in time."""
    work = time
    for i in stops.by_due:
        if now[i] == 2 or stops.due[i] == np.inf:
            continue
        p, d = 2 * i, 2 * i + 1
        if now[i] == 0:
            t = _done_at(travel, stops, p, time, here)
            t += travel[stops.room[p], stops.room[d]] + stops.service[d]
            work += stops.least[p]
        else:
            t = time + travel[here, stops.room[d]] + stops.service[d]
        work += stops.least[d]
        if t > stops.due[i] or work > stops.due[i]:
            return False
    return True


@inner()
def _note_state(
    seen: _Seen, key: int, time: float
) -> tuple[bool, int]:  # pragma: no cover - compiled
    """Whether a state is worth entering at ``time`` [s], and how many entries that adds."""
    slot = _slot(seen.key, key)
    if seen.key[slot] == -1:
        seen.key[slot] = key
        seen.time[slot] = time
        return True, 1
    if seen.time[slot] <= time:
        return False, 0
    seen.time[slot] = time
    return True, 0


@inner()
def _slot(keys: IntArray, key: int) -> int:  # pragma: no cover - compiled
    mask = len(keys) - 1
    slot = (key ^ (key >> 17) ^ (key >> 33)) * 40503 & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@inner()
def _with_room(seen: _Seen, filled: int) -> _Seen:  # pragma: no cover - compiled
    """Table that is at most half full: the same one, or one of four times the size."""
    if len(seen.key) > 1 and 2 * filled <= len(seen.key):
        return seen
    size = max(1024, 4 * len(seen.key))
    larger = _Seen(np.full(size, -1, np.int64), np.empty(size))
    for i in range(len(seen.key)):
        if seen.key[i] != -1:
            slot = _slot(larger.key, seen.key[i])
            larger.key[slot], larger.time[slot] = seen.key[i], seen.time[i]
    return larger


@entry()
def clashing_pairs(
    travel: Array, jobs: Jobs, starts: Starts, alone: BoolArray
) -> BoolArray:  # pragma: no cover - compiled
    """Find the pairs of tasks that a robot without load cannot both serve in time.

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
    """List all largest sets of tasks that one robot can serve in time.

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
    level, found = np.zeros(1, np.int64), np.empty(0, np.int64)
    looked, total = 0, 0
    m = len(jobs.due)
    chosen, state, soft = np.empty(m, np.int64), np.zeros(m, np.int64), np.zeros(m, np.bool_)
    is_carried = np.zeros(m, np.bool_)
    for k in carried:
        is_carried[k] = True
    while len(level) > 0:
        following, count = np.empty(1024, np.int64), 0
        for base in level:
            for k in allowed:
                if base >> k != 0:
                    continue  # sets grow by tasks of larger number only
                tasks = base | (one << k)
                s = _fill_members(tasks, is_carried, chosen, state, soft)
                looked += 1
                if looked > most or s > MAX_TASKS:
                    return False, found, total
                answer, nodes, _ = search_route(
                    travel, jobs, starts, robot, chosen[:s], state[:s], soft[:s], 1_000_000
                )
                total += nodes
                if answer == CUT_OFF:
                    return False, found, total
                if answer == FEASIBLE:
                    if count == len(following):
                        following = np.concatenate((following, np.empty_like(following)))
                    following[count] = tasks
                    count += 1
        following = np.sort(following[:count])
        found = np.concatenate((found, level[_largest(level, following, allowed)]))
        level = following
    return True, found, total


@inner()
def _fill_members(
    tasks: int, is_carried: BoolArray, chosen: IntArray, state: IntArray, soft: BoolArray
) -> int:  # pragma: no cover - compiled
    """List the tasks of a set and those on board, as ``search_route`` asks for; how many."""
    s = 0
    for j in range(len(is_carried)):
        in_set = (tasks >> j) & 1 == 1
        if in_set or is_carried[j]:
            chosen[s] = j
            state[s] = 1 if is_carried[j] else 0
            soft[s] = not in_set
            s += 1
    return s


@inner()
def _largest(
    level: IntArray, following: IntArray, allowed: IntArray
) -> BoolArray:  # pragma: no cover - compiled
    """Which sets of a sorted ``level`` are in no set that is larger by one task."""
    one = np.int64(1)
    largest = np.ones(len(level), np.bool_)
    for tasks in following:
        for k in allowed:
            if (tasks >> k) & 1:
                i = np.searchsorted(level, tasks ^ (one << k))
                if i < len(level) and level[i] == tasks ^ (one << k):
                    largest[i] = False
    return largest
