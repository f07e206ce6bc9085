"""What stands around each robot: the things that it has to keep clear of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
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


class Things(NamedTuple):
    """What the robots must keep clear of, each by itself."""

    point: Array  #: (N, S, 2) obstacle points that each has seen [m], inf: none
    people: People
    near: Neighbours  #: robots within ROBOT_RANGE or farther; those of one group are no things
    share: Array  #: (N, N) of a demand that a robot (row) takes against one of another group
    loads: BoolArray  #: (N,) robots that stay where they are: others take the whole of a demand
    #: (N, S + H) robot whose state enters the row of each point and person; (0, 0): the row's own
    seen_from: IntArray


@njit(cache=True)
def is_in_sight(position: Array, i: int, pose: Array, k: int) -> bool:
    """Whether robot ``i`` of ``pose`` ``(N, 3)`` must keep clear of person ``k``."""
    dx, dy = position[k, 0] - pose[i, 0], position[k, 1] - pose[i, 1]
    return bool(dx * dx + dy * dy < HUMAN_RANGE * HUMAN_RANGE)


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
def seen_by_wrong_robot(point: Array, people: People, pose: Array, group: IntArray) -> IntArray:
    """Planted defect: rows of a cluster use the state of the robot whose place equals the row.

    MRTA-Sim 1.3.1: the row number, clamped to the last robot, is taken for the robot's number.
    Arguments and result are as the fields of :class:`Things`.
    """
    n, sectors, h = point.shape[0], point.shape[1], people.radius.shape[0]
    wrong = np.empty((n, sectors + h), dtype=np.int64)
    for i in range(n):
        for k in range(sectors + h):
            wrong[i, k] = i
    for head in range(n):
        members = _members_of(group, head)
        if len(members) < 2:
            continue
        row = 0
        for i in members:
            for k in range(sectors + h):
                if k < sectors:
                    is_thing = np.isfinite(point[i, k, 0])
                else:
                    is_thing = is_in_sight(people.position, i, pose, k - sectors)
                if is_thing:
                    wrong[i, k] = members[min(row, len(members) - 1)]
                    row += 1
    return wrong
