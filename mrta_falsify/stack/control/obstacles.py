"""What stands around each robot: the things that it has to keep clear of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.stack.control.barrier import HUMAN, OBSTACLE, ROBOT, Movers, Things
from mrta_falsify.stack.control.barrier_options import CbfOptions

HUMAN_RADIUS = 0.25  # m, the person that `min_gap_human` is meant for
HUMAN_RANGE = 8.0  # m
ROBOT_RANGE = 8.0  # m


class People(NamedTuple):
    """People as the controller sees them."""

    position: Array  #: (H, 2) [m]
    velocity: Array  #: (H, 2) [m/s]
    radius: Array  #: (H,) [m]


class Clearances(NamedTuple):
    """Distances that the barrier rows keep from a robot's centre [m]."""

    obstacle: float  #: to a point
    human: float  #: to the centre of a person of HUMAN_RADIUS
    robot: float  #: to the centre of a robot


def clearances_of(options: CbfOptions) -> Clearances:
    """Take the distances from a controller's options."""
    return Clearances(
        obstacle=options.min_gap_obstacle,
        human=options.min_gap_human,
        robot=options.min_gap_robot,
    )


@njit(cache=True)
def list_things(
    movers: Movers, points: Array, people: People, share: Array, clearances: Clearances
) -> Things:
    """List what each robot must keep clear of by itself.

    Args:
        movers: all robots; those of one group are no things to each other.
        points: ``(N, S, 2)`` obstacle points [m], inf: none.
        people: who is about.
        share: ``(N, N)`` part of a demand that a robot (row) takes against one of another group.
        clearances: distances to keep.

    Returns:
        T = S + H + N entries per robot: points, people, robots.
    """
    n, sectors = points.shape[0], points.shape[1]
    h = people.radius.shape[0]
    t = sectors + h + n
    where, moving = np.zeros((n, t, 2)), np.zeros((n, t, 2))
    gap, part = np.zeros((n, t)), np.ones((n, t))
    kind = np.full((n, t), -1, dtype=np.int64)
    seen_from = np.empty((n, t), dtype=np.int64)
    pose, group = movers.pose, movers.group
    for i in range(n):
        seen_from[i] = i
        if group[i] < 0:
            continue
        for k in range(sectors):
            if np.isfinite(points[i, k, 0]):
                where[i, k] = points[i, k]
                gap[i, k] = clearances.obstacle
                kind[i, k] = OBSTACLE
        for k in range(h):
            dx, dy = people.position[k, 0] - pose[i, 0], people.position[k, 1] - pose[i, 1]
            if dx * dx + dy * dy < HUMAN_RANGE * HUMAN_RANGE:
                where[i, sectors + k] = people.position[k]
                moving[i, sectors + k] = people.velocity[k]
                gap[i, sectors + k] = clearances.human + people.radius[k] - HUMAN_RADIUS
                kind[i, sectors + k] = HUMAN
        for j in range(n):
            if j == i or not movers.known[j] or group[j] == group[i]:
                continue
            dx, dy = pose[j, 0] - pose[i, 0], pose[j, 1] - pose[i, 1]
            if dx * dx + dy * dy < ROBOT_RANGE * ROBOT_RANGE:
                where[i, sectors + h + j] = pose[j, :2]
                moving[i, sectors + h + j] = movers.velocity[j]
                gap[i, sectors + h + j] = clearances.robot
                kind[i, sectors + h + j] = ROBOT
                part[i, sectors + h + j] = share[i, j]
    return Things(where, moving, gap, kind, part, seen_from)


@njit(cache=True)
def _members_of(group: IntArray, head: int) -> IntArray:
    """List the robots of the group whose first is ``head``; none if it is not the first."""
    members = np.empty(group.shape[0], dtype=np.int64)
    count = 0
    for i in range(group.shape[0]):
        if group[i] == group[head] and group[i] >= 0:
            if i < head:
                return members[:0]
            members[count] = i
            count += 1
    return members[:count]


@njit(cache=True)
def seen_by_wrong_robot(seen_from: IntArray, kind: IntArray, group: IntArray) -> IntArray:
    """Planted defect: rows of a cluster use the state of the robot whose place equals the row.

    MRTA-Sim 1.3.1: the row number, clamped to the last robot, is taken for the robot's number.
    """
    wrong = seen_from.copy()
    n, t = kind.shape
    for head in range(n):
        members = _members_of(group, head)
        if len(members) < 2:
            continue
        row = 0
        for i in members:
            for k in range(t):
                if kind[i, k] in (OBSTACLE, HUMAN):
                    wrong[i, k] = members[min(row, len(members) - 1)]
                    row += 1
    return wrong
