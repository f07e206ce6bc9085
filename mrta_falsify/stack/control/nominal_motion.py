"""From manoeuvres to nominal inputs; robots that are stuck although nothing makes them wait."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.stack.control.manoeuvres import ASIDE, BACK, GO, PASS, SLOW, Choices
from mrta_falsify.stack.control.state import Crew, CrewView

PROGRESS = 0.3  # m, a robot that tries to move and stays within this is stuck
TURN_FOR_MANOEUVRE = np.pi / 6  # rad, straight legs are driven with little error in heading
TURN_ALONE = np.pi / 4  # rad, MRTA-Sim's
TURN_IN_CLUSTER = np.pi / 2  # rad, MRTA-Sim's


class NominalInputs(NamedTuple):
    """What robots would do, and who decides with whom; few arrays, since each costs."""

    numbers: IntArray  #: (3, N) group, cluster and leader
    target: Array  #: (N, 2) [m], nan: brake
    figures: Array  #: (3, N) speed, turn threshold, price of moving a robot from its nominal motion
    reverse: BoolArray  #: (N,) who drives backwards


@njit(cache=True)
def fill_nominal(
    crew: Crew,
    choices: Choices,
    sensed: CrewView,
    patience: float,
    leader_weight: float,
    nominal: NominalInputs,
) -> None:
    """Turn choices to nominal inputs, groups and prices; robots outside go their own way.

    Args:
        crew: robots, surveyed; anchors, suspended leads and times of commands are written.
        choices: ``(N,)`` manoeuvres.
        sensed: what the view says.
        patience: a lead without progress is suspended for so long after so long [s].
        leader_weight: price of slowing a leader; others cost 1.
        nominal: filled.
    """
    n = crew.shape[0]
    size = np.zeros(n, dtype=np.int64)
    group, cluster, leader = nominal.numbers
    speed, turn_first, weight = nominal.figures
    target, reverse = nominal.target, nominal.reverse
    for i in range(n):
        size[crew[i].cluster] += 1
    for i in range(n):
        robot, choice = crew[i], choices[i]
        outside = robot.wants and not robot.joint
        does = GO if outside else choice.kind
        for c in range(2):
            target[i, c] = robot.target[c] if outside else choice.point[c]
            if robot.halted:
                target[i, c] = np.nan
        speed[i] = min(choice.speed, robot.max_speed)
        reverse[i] = choice.reverse
        turn_first[i] = _turn_threshold(does, size[robot.cluster] < 2)
        cluster[i], leader[i] = robot.cluster, robot.leader
        group[i] = -1
        if robot.present:
            group[i] = robot.cluster if robot.joint else i
        leads = robot.leader == i
        weight[i] = leader_weight if leads else 1.0
        if not leads:
            robot.remote_at = sensed.time
        elif sensed.leader_link[i]:
            robot.remote_at = -np.inf
        _fill_progress(robot, robot.wants and does in (GO, PASS, BACK), sensed.time, patience)


@njit(cache=True)
def _turn_threshold(kind: int, alone: bool) -> float:
    """Give the heading error above which a robot turns on the spot [rad]."""
    if kind in (ASIDE, PASS, BACK):
        return TURN_FOR_MANOEUVRE
    return TURN_ALONE if alone or kind == SLOW else TURN_IN_CLUSTER


@njit(cache=True)
def _fill_progress(robot: np.record, tries: bool, now: float, patience: float) -> None:
    """Move the anchor of a robot that makes progress; suspend a lead that makes none."""
    dx, dy = robot.pose[0] - robot.anchor[0], robot.pose[1] - robot.anchor[1]
    if not tries or dx * dx + dy * dy > PROGRESS * PROGRESS:
        robot.anchor[0], robot.anchor[1] = robot.pose[0], robot.pose[1]
        robot.anchor_at = now
    elif now - robot.anchor_at >= patience:
        robot.demoted_until = now + patience
        robot.anchor_at = now
