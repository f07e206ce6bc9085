"""Who waits, who moves aside, who goes on: manoeuvres of the robots of a cluster.

In order of precedence each robot picks the first of these that keeps clear of what the
better-placed robots are about to do in the next seconds: go on; go on slowly; pass beside a
standing body; wait; move aside. Robots without a way of their own stay where they are, or
move aside. If nothing keeps clear, the manoeuvre whose conflict is farthest away is taken;
the barrier rows of the joint program take care of the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.polyline import point_ahead, project_on_path

STEP = 0.25  # s, between samples of a predicted motion
SAMPLES = 29  # 7 s ahead
SLACK_SAMPLES = 2  # a motion may come 0.5 s early or late
LOOK = 0.5  # m, look-ahead of the pursuit, as the stack's
TURN_RATE = 1.0  # rad/s, a cautious mean of a turn on the spot
ASIDE_SPEED = 0.4  # m/s
SLOW_SHARE = 0.4  # of the cruising speed
SOON = 4.5  # s, a robot on its way does not care about conflicts later than this
COMPANY = 6.0  # m
STANDING = 0.15  # m/s, slower people are passed like furniture
HEADINGS = 12  #: directions tried when moving aside
GO, SLOW, PASS, WAIT, ASIDE, STAY = 0, 1, 2, 3, 4, 5  #: kinds of manoeuvres


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manoeuvres:
    """What each robot does; kinds GO, SLOW, PASS, WAIT, ASIDE, STAY."""

    kind: IntArray  #: (N,)
    target: Array  #: (N, 2) point to drive to [m], nan: brake
    speed: Array  #: (N,) [m/s]
    reverse: BoolArray  #: (N,)


@njit(cache=True)
def _fill_pursuit(
    path: Array,
    segment: int,
    share: float,
    x: float,
    y: float,
    yaw: float,
    speed: float,
    cruise: float,
    acceleration: float,
    motion: Array,
) -> None:
    """Fill ``motion`` (SAMPLES, 2) with the way along ``path`` at up to ``cruise``.

    The robot begins beside (segment, share) of the path.
    """
    motion[0, 0], motion[0, 1] = x, y
    tx, ty = point_ahead(path, segment, share, x, y, LOOK)
    error = abs((np.arctan2(ty - y, tx - x) - yaw + np.pi) % (2.0 * np.pi) - np.pi)
    delay = max(0.0, error - 0.25 * np.pi) / TURN_RATE
    v = max(speed, 0.0)
    last = path.shape[0] - 1
    for k in range(1, SAMPLES):
        if k * STEP <= delay:
            v = max(0.0, v - acceleration * STEP)
        else:
            v = min(cruise, v + acceleration * STEP)
        # The segment can only move on; look a little ahead for a closer one.
        best, since = np.inf, 0
        at = segment
        for i in range(segment, last):
            ax, ay = path[i, 0], path[i, 1]
            dx, dy = path[i + 1, 0] - ax, path[i + 1, 1] - ay
            square = dx * dx + dy * dy
            t = 0.0
            if square > 0.0:
                t = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / square))
            gap = (ax + t * dx - x) ** 2 + (ay + t * dy - y) ** 2
            if gap < best:
                best, at, share, since = gap, i, t, 0
            else:
                since += 1
                if since > 4:
                    break
        segment = at
        tx, ty = point_ahead(path, segment, share, x, y, LOOK)
        dx, dy = tx - x, ty - y
        distance = np.sqrt(dx * dx + dy * dy)
        move = min(v * STEP, distance)
        if distance > 1e-9:
            x, y = x + move * dx / distance, y + move * dy / distance
        motion[k, 0], motion[k, 1] = x, y


@njit(cache=True)
def _fill_straight(
    x: float,
    y: float,
    ux: float,
    uy: float,
    turn: float,
    pace: float,
    length: float,
    motion: Array,
) -> None:
    """Fill ``motion``: turn by ``turn`` [rad] on the spot, drive ``length`` along (ux, uy)."""
    delay = max(0.0, turn - 0.5) / TURN_RATE
    for k in range(SAMPLES):
        way = min(length, max(0.0, (k * STEP - delay) * pace))
        motion[k, 0], motion[k, 1] = x + way * ux, y + way * uy


@njit(cache=True)
def _fill_stop(state: Array, deceleration: float, motion: Array) -> None:
    """Fill ``motion``: brake along the heading and stay; ``state`` is x, y, yaw, speed."""
    x, y, yaw, speed = state
    ux, uy = np.cos(yaw), np.sin(yaw)
    for k in range(SAMPLES):
        t = min(k * STEP, abs(speed) / deceleration)
        way = speed * t - 0.5 * deceleration * t * t * np.sign(speed)
        motion[k, 0], motion[k, 1] = x + way * ux, y + way * uy


@njit(cache=True)
def _fill_box(motion: Array, box: Array) -> None:
    """Fill ``box`` (4,) with the least x, y and the largest x, y of ``motion`` (SAMPLES, 2)."""
    box[0], box[1] = motion[0]
    box[2], box[3] = motion[0]
    for k in range(1, SAMPLES):
        x, y = motion[k]
        box[0], box[1] = min(box[0], x), min(box[1], y)
        box[2], box[3] = max(box[2], x), max(box[3], y)


@njit(cache=True)
def _are_apart(box: Array, other: Array, gap: float) -> bool:
    """Whether nothing in one box is nearer than ``gap`` to anything in the other."""
    return bool(
        other[0] - box[2] >= gap
        or box[0] - other[2] >= gap
        or other[1] - box[3] >= gap
        or box[1] - other[3] >= gap
    )


@njit(cache=True)
def _conflict(motion: Array, other: Array, gap: float) -> float:
    """When two motions first come nearer than ``gap`` [s], inf: never.

    A gap larger than the present distance shrinks to it: what counts is coming nearer.
    """
    now = (motion[0, 0] - other[0, 0]) ** 2 + (motion[0, 1] - other[0, 1]) ** 2
    held = min(gap, 0.97 * np.sqrt(now))
    square = held * held
    for k in range(SAMPLES):
        for m in range(max(0, k - SLACK_SAMPLES), min(SAMPLES, k + SLACK_SAMPLES + 1)):
            dx, dy = motion[k, 0] - other[m, 0], motion[k, 1] - other[m, 1]
            if dx * dx + dy * dy < square:
                return k * STEP
    return np.inf


@njit(cache=True)
def _way_is_clear(
    x: float, y: float, ux: float, uy: float, length: float, points: Array, gap: float
) -> bool:
    """Whether a straight way keeps ``gap`` from all points, or comes no nearer than it is."""
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - x, points[k, 1] - y
        if not np.isfinite(dx):
            continue
        t = min(length, max(0.0, dx * ux + dy * uy))
        square = (dx - t * ux) ** 2 + (dy - t * uy) ** 2
        held = min(gap, 0.97 * np.sqrt(dx * dx + dy * dy))
        if square < held * held:
            return False
    return True


@njit(cache=True)
def _is_followed(motion: Array, other: Array) -> bool:
    """Whether ``other`` comes from behind in the same direction: then it is the one to wait."""
    last = SAMPLES - 1
    mx, my = motion[last, 0] - motion[0, 0], motion[last, 1] - motion[0, 1]
    ox, oy = other[last, 0] - other[0, 0], other[last, 1] - other[0, 1]
    dx, dy = motion[0, 0] - other[0, 0], motion[0, 1] - other[0, 1]
    m, o = np.sqrt(mx * mx + my * my), np.sqrt(ox * ox + oy * oy)
    d = np.sqrt(dx * dx + dy * dy)
    if m < 0.3 or o < 0.3:
        return False
    return bool(mx * ox + my * oy > 0.7 * m * o and dx * ox + dy * oy > 0.7 * d * o)


@njit(cache=True)
def _first_conflict(
    i: int,
    motion: Array,
    motions: Array,
    boxes: Array,
    considered: BoolArray,
    gap: float,
    discs: Array,
    disc_gap: Array,
    scratch: Array,
) -> tuple[float, bool]:
    """Time of the first conflict with considered robots or standing people, and if it stands."""
    first, stands = np.inf, False
    box, place = np.empty(4), np.empty(4)
    _fill_box(motion, box)
    for j in range(motions.shape[0]):
        if j == i or not considered[j] or _are_apart(box, boxes[j], gap):
            continue
        t = _conflict(motion, motions[j], gap)
        if t < first and not _is_followed(motion, motions[j]):
            first = t
            moved = (motions[j, -1, 0] - motions[j, 0, 0]) ** 2
            moved += (motions[j, -1, 1] - motions[j, 0, 1]) ** 2
            stands = moved < 0.01
    for k in range(discs.shape[0]):
        place[:2], place[2:] = discs[k], discs[k]
        if _are_apart(box, place, disc_gap[k]):
            continue
        scratch[:, 0], scratch[:, 1] = discs[k, 0], discs[k, 1]
        t = _conflict(motion, scratch, disc_gap[k])
        if t < first:
            first, stands = t, True
    return first, stands


# A choice is (kind, target x, target y, speed, reverse, conflict); the functions below replace
# the choice so far, and its predicted motion, by a better one.


@njit(cache=True)
def _fill_way(
    choice: Array,
    chosen: Array,
    i: int,
    state: Array,
    target: Array,
    path: Array,
    cruise: float,
    top: float,
    acceleration: float,
    motions: Array,
    boxes: Array,
    considered: BoolArray,
    gap: float,
    discs: Array,
    disc_gap: Array,
) -> bool:
    """Go on, or go on slowly; whether something that stands is in the way of going on."""
    trial, scratch = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    stands = False
    x, y, yaw, speed = state
    segment, share = project_on_path(path, x, y, 0)
    for kind in (GO, SLOW):
        pace = cruise if kind == GO else SLOW_SHARE * cruise
        _fill_pursuit(path, segment, share, x, y, yaw, speed, pace, acceleration, trial)
        t, fixed = _first_conflict(
            i, trial, motions, boxes, considered, gap, discs, disc_gap, scratch
        )
        if kind == GO and t >= SOON:
            t = np.inf
        if kind == GO:
            stands = fixed and t < np.inf
        if t > choice[5] + 1e-9:
            choice[0], choice[1], choice[2] = kind, target[0], target[1]
            choice[3] = top if kind == GO else pace
            choice[4], choice[5] = 0.0, t
            chosen[:] = trial
        if t == np.inf:
            break
    return stands


@njit(cache=True)
def _fill_pass(
    choice: Array,
    chosen: Array,
    i: int,
    state: Array,
    tangent: float,
    cruise: float,
    points: Array,
    obstacle_gap: float,
    motions: Array,
    boxes: Array,
    considered: BoolArray,
    gap: float,
    discs: Array,
    disc_gap: Array,
) -> None:
    """Pass beside something that stands, on the side that is the smaller detour."""
    trial, scratch = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    x, y, yaw = state[0], state[1], state[2]
    cheapest = np.inf
    for k in range(18):
        step = k // 2 - 4
        length = 0.9 if k % 2 == 0 else 0.4
        angle = tangent + step * np.pi / 8.0
        ux, uy = np.cos(angle), np.sin(angle)
        turn = abs((angle - yaw + np.pi) % (2.0 * np.pi) - np.pi)
        # Nearly equal: to the right.
        cost = abs(step) * np.pi / 8.0 + 0.5 * turn + 0.1 * (k % 2) + (0.02 if step > 0 else 0.0)
        if cost >= cheapest:
            continue
        if not _way_is_clear(x, y, ux, uy, length, points, obstacle_gap + 0.03):
            continue
        _fill_straight(x, y, ux, uy, turn, 0.5 * cruise, length, trial)
        t, _ = _first_conflict(i, trial, motions, boxes, considered, gap, discs, disc_gap, scratch)
        if t < np.inf:
            continue
        cheapest = cost
        choice[0], choice[1], choice[2] = PASS, x + length * ux, y + length * uy
        choice[3], choice[4], choice[5] = 0.6 * cruise, 0.0, np.inf
        chosen[:] = trial


@njit(cache=True)
def _fill_wait(
    choice: Array,
    chosen: Array,
    i: int,
    state: Array,
    wants: bool,
    acceleration: float,
    motions: Array,
    boxes: Array,
    considered: BoolArray,
    gap: float,
    discs: Array,
    disc_gap: Array,
) -> None:
    """Stop and stay."""
    trial, scratch = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    _fill_stop(state, acceleration, trial)
    t, _ = _first_conflict(i, trial, motions, boxes, considered, gap, discs, disc_gap, scratch)
    if t > choice[5] + 1e-9:
        choice[0] = WAIT if wants else STAY
        choice[1], choice[2] = np.nan, np.nan
        choice[4], choice[5] = 0.0, t
        chosen[:] = trial


@njit(cache=True)
def _bodies_clear(
    i: int,
    x: float,
    y: float,
    ux: float,
    uy: float,
    length: float,
    pose: Array,
    others: BoolArray,
    gap: float,
) -> bool:
    """Whether a straight way keeps clear of where other robots are now."""
    for j in range(pose.shape[0]):
        if j == i or not others[j]:
            continue
        dx, dy = pose[j, 0] - x, pose[j, 1] - y
        s = min(length, max(0.0, dx * ux + dy * uy))
        held = min(gap, 0.97 * np.sqrt(dx * dx + dy * dy))
        if (dx - s * ux) ** 2 + (dy - s * uy) ** 2 < held * held:
            return False
    return True


@njit(cache=True)
def _fill_aside(
    choice: Array,
    chosen: Array,
    i: int,
    state: Array,
    pose: Array,
    others: BoolArray,
    min_gap_robot: float,
    points: Array,
    obstacle_gap: float,
    motions: Array,
    boxes: Array,
    considered: BoolArray,
    gap: float,
    discs: Array,
    disc_gap: Array,
) -> None:
    """Move aside: backwards, or in one of twelve directions, by little turning if possible."""
    trial, scratch = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    x, y, yaw = state[0], state[1], state[2]
    cheapest = np.inf
    for k in range((HEADINGS + 1) * 3):
        length = 0.5 + 0.45 * (k % 3)
        back = k // 3 == HEADINGS
        turn = np.pi if back else (k // 3) * 2.0 * np.pi / HEADINGS
        ux, uy = np.cos(yaw + turn), np.sin(yaw + turn)
        turn = 0.0 if back else min(turn, 2.0 * np.pi - turn)
        cost = 0.4 * turn + 0.5 * length + (0.2 if back else 0.0)
        if choice[5] == np.inf and cost >= cheapest:
            continue
        if not _way_is_clear(x, y, ux, uy, length, points, obstacle_gap + 0.02):
            continue
        if not _bodies_clear(i, x, y, ux, uy, length, pose, others, min_gap_robot):
            continue
        _fill_straight(x, y, ux, uy, turn, ASIDE_SPEED, length, trial)
        t, _ = _first_conflict(i, trial, motions, boxes, considered, gap, discs, disc_gap, scratch)
        if t > choice[5] + 0.3 or (t == choice[5] and cost < cheapest):
            cheapest = cost
            choice[0], choice[1], choice[2] = ASIDE, x + length * ux, y + length * uy
            choice[3], choice[4], choice[5] = ASIDE_SPEED, 1.0 if back else 0.0, t
            chosen[:] = trial


@njit(cache=True)
def _fill_standing(
    x: float,
    y: float,
    human: Array,
    human_velocity: Array,
    human_gap: Array,
    near: float,
    discs: Array,
    disc_gap: Array,
) -> int:
    """Collect the people who stand near (x, y); how many."""
    count = 0
    for k in range(human.shape[0]):
        dx, dy = human[k, 0] - x, human[k, 1] - y
        pace = human_velocity[k, 0] ** 2 + human_velocity[k, 1] ** 2
        if pace < STANDING * STANDING and dx * dx + dy * dy < near * near:
            discs[count, 0], discs[count, 1] = human[k]
            disc_gap[count] = human_gap[k]
            count += 1
    return count


@njit(cache=True)
def _path_of(
    i: int, state: Array, target: Array, points_on_path: Array, path_first: IntArray
) -> Array:
    """Path of a robot that wants to move; the straight way to its target if it has none."""
    path = points_on_path[path_first[i] : path_first[i + 1]]
    if path.shape[0] >= 2:
        return path
    direct = np.empty((2, 2))
    direct[0] = state[:2]
    direct[1] = target
    return direct


@njit(cache=True)
def _fill_fixed(
    states: Array,
    fixed: BoolArray,
    eligible: BoolArray,
    max_acceleration: Array,
    motions: Array,
    boxes: Array,
) -> None:
    """Predict robots that nobody can ask to move, and those that decide for themselves."""
    for i in range(states.shape[0]):
        if not fixed[i]:
            continue
        _fill_stop(states[i], max_acceleration[i], motions[i])
        x, y, yaw, v = states[i]
        if not eligible[i] and abs(v) > 0.05:
            for k in range(SAMPLES):
                motions[i, k, 0] = x + k * STEP * v * np.cos(yaw)
                motions[i, k, 1] = y + k * STEP * v * np.sin(yaw)
        _fill_box(motions[i], boxes[i])


@njit(cache=True)
def _has_company(i: int, pose: Array, known: BoolArray) -> bool:
    """Whether another robot is near enough to matter within the predicted time."""
    for j in range(pose.shape[0]):
        if j != i and known[j]:
            dx, dy = pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1]
            if dx * dx + dy * dy < COMPANY * COMPANY:
                return True
    return False


@njit(cache=True)
def choose_manoeuvres(
    pose: Array,
    speed: Array,
    target: Array,
    points_on_path: Array,
    path_first: IntArray,
    order: IntArray,
    eligible: BoolArray,
    wants: BoolArray,
    active: BoolArray,
    known: BoolArray,
    max_speed: Array,
    max_acceleration: Array,
    obstacle: Array,
    human: Array,
    human_velocity: Array,
    human_radius: Array,
    min_gap_human: float,
    cruise_limit: float,
    gap: float,
    min_gap_robot: float,
    obstacle_gap: float,
    near: float,
) -> tuple[IntArray, Array, Array, BoolArray]:
    """Fields of :class:`Manoeuvres`.

    Args:
        pose: ``(N, 3)``.
        speed: ``(N,)`` forward [m/s].
        target: ``(N, 2)`` look-ahead points [m], nan: no way of its own.
        points_on_path: ``(sum L, 2)`` all paths one after the other [m].
        path_first: ``(N + 1,)`` where each path begins.
        order: ``(N,)`` robot numbers, the one that goes first in front.
        eligible: ``(N,)`` robots that this decides for; others are only kept clear of.
        wants: ``(N,)`` robots with a way of their own.
        active: ``(N,)`` has a task; robots that neither want to move nor have a task may be
            asked to move aside.
        known: ``(N,)`` robots that are there.
        max_speed: ``(N,)`` [m/s].
        max_acceleration: ``(N,)`` [m/s^2].
        obstacle: ``(N, S, 2)`` obstacle points [m], inf: none.
        human: ``(H, 2)`` [m].
        human_velocity: ``(H, 2)`` [m/s].
        human_radius: ``(H,)`` [m].
        min_gap_human: distance to keep from a person of 0.25 m radius [m].
        cruise_limit: speed that the nominal law reaches [m/s].
        gap: distance between robots that counts as a conflict [m].
        min_gap_robot: barrier distance [m].
        obstacle_gap: barrier distance [m].
        near: people farther from a robot than this do not matter to it [m].
    """
    n = pose.shape[0]
    choice = np.empty((n, 6))
    states = np.empty((n, 4))
    states[:, :3] = pose
    states[:, 3] = speed
    motions, boxes = np.empty((n, SAMPLES, 2)), np.empty((n, 4))
    discs, disc_gap = np.empty((human.shape[0], 2)), np.empty(human.shape[0])
    human_gap = np.empty(human.shape[0])
    for k in range(human.shape[0]):
        human_gap[k] = human_radius[k] - 0.25 + min_gap_human + 0.1
    stuck = np.zeros(n, dtype=np.bool_)
    for _ in range(2):
        decides = known & eligible & ~stuck & (wants | ~active)
        considered = known & ~decides
        _fill_fixed(states, considered, eligible, max_acceleration, motions, boxes)
        stuck_before = stuck.sum()
        for i in order:
            choice[i] = np.array([STAY, np.nan, np.nan, max_speed[i], 0.0, np.inf])
            if not decides[i]:
                continue
            count = _fill_standing(
                pose[i, 0], pose[i, 1], human, human_velocity, human_gap, near, discs, disc_gap
            )
            people, people_gap = discs[:count], disc_gap[:count]
            if count == 0 and not _has_company(i, pose, known):
                if wants[i]:
                    choice[i, 0], choice[i, 1], choice[i, 2] = GO, target[i, 0], target[i, 1]
                _fill_stop(states[i], max_acceleration[i], motions[i])
                _fill_box(motions[i], boxes[i])
                considered[i] = True
                continue
            choice[i, 5] = -1.0
            cruise = min(max_speed[i], cruise_limit)
            if wants[i]:
                path = _path_of(i, states[i], target[i], points_on_path, path_first)
                stands = _fill_way(
                    choice[i], motions[i], i, states[i], target[i], path, cruise, max_speed[i],
                    max_acceleration[i], motions, boxes, considered, gap, people, people_gap,
                )  # fmt: skip
                if stands and choice[i, 5] < np.inf:
                    segment, _share = project_on_path(path, pose[i, 0], pose[i, 1], 0)
                    ahead = path[segment + 1] - path[segment]
                    _fill_pass(
                        choice[i], motions[i], i, states[i], np.arctan2(ahead[1], ahead[0]),
                        cruise, obstacle[i], obstacle_gap, motions, boxes, considered, gap,
                        people, people_gap,
                    )  # fmt: skip
            if choice[i, 5] < np.inf:
                _fill_wait(
                    choice[i], motions[i], i, states[i], wants[i], max_acceleration[i], motions,
                    boxes, considered, gap, people, people_gap,
                )  # fmt: skip
            if choice[i, 5] < np.inf:
                _fill_aside(
                    choice[i], motions[i], i, states[i], pose, known & ~considered, min_gap_robot,
                    obstacle[i], obstacle_gap, motions, boxes, considered, gap, people,
                    people_gap,
                )  # fmt: skip
            _fill_box(motions[i], boxes[i])
            considered[i] = True
            # Nowhere to go: in a second round the others have to find a way round it.
            stuck[i] = choice[i, 5] < np.inf and choice[i, 0] == STAY
        if stuck.sum() == stuck_before:
            break
    kind = choice[:, 0].astype(np.int64)
    return kind, choice[:, 1:3].copy(), choice[:, 3].copy(), choice[:, 4] > 0.5
