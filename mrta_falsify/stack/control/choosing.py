"""Who waits, who moves aside, who goes on: each robot chooses a manoeuvre.

In order of precedence each robot picks the first of these that keeps clear of what the
better-placed robots are about to do in the next seconds: go on; go on slowly; pass beside a
standing body; wait; move aside. Robots without a way of their own stay where they are, or
move aside. If nothing keeps clear, the manoeuvre whose conflict is farthest away is taken;
the barrier rows of the joint program take care of the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
from mrta_falsify.core.world import CRUISE
from mrta_falsify.stack.control.conflicts import SharedPlaces, Traffic, fill_box
from mrta_falsify.stack.control.manoeuvres import (
    CHOICE,
    GO,
    LONGEST_LEG,
    SLOW_SHARE,
    STAY,
    WAIT,
    Choices,
    fill_initial,
    try_continuing,
    try_moving_aside,
    try_passing,
    try_waiting,
)
from mrta_falsify.stack.control.obstacles import HUMAN_RADIUS, Clearances, People
from mrta_falsify.stack.control.predicted_motions import SAMPLES, STEP, fill_drift, fill_stop
from mrta_falsify.stack.control.state import Crew, CrewView, people_in

COMPANY = 6.0  # m, robots that drive at CRUISE and are farther apart cannot meet in time
NEAR = 3.5  # m, people farther from a robot than this do not matter to its choice
STANDING = 0.15  # m/s, slower people are passed like furniture
ROUNDING = 1e-6  # m
PEOPLE_MARGIN = 0.1  # m, beyond the gap to people, so that no barrier row stops a pass halfway


class Ways(NamedTuple):
    """Paths of all robots, one after the other."""

    points: Array  #: (sum L, 2) [m]
    first: IntArray  #: (N + 1,) where each path begins


@njit(cache=True)
def _company_within(robot: np.record, other: np.record) -> float:
    """Say how near two robots must be to matter to each other within the predicted time [m]."""
    return float(COMPANY * max(1.0, max(robot.cruise, other.cruise) / CRUISE))


@njit(cache=True)
def _reach_of(robot: np.record) -> float:
    """Say how far from its place any motion that is predicted for a robot can lead [m].

    None is faster than the robot is now, or wants to be, but for a leg to pass or to move aside.
    """
    pace = abs(robot.speed)
    if robot.wants:
        pace = max(pace, robot.cruise, SLOW_SHARE * CRUISE)
    return float(max(LONGEST_LEG, pace * (SAMPLES - 1) * STEP) + ROUNDING)


@njit(cache=True)
def reach_of_choices(crew: Crew, gap: float) -> float:
    """Say how near two robots must be for a choice to depend on both [m].

    Args:
        crew: robots as they are heard; who wants to move need not be known yet.
        gap: distance between robots that counts as a conflict [m].
    """
    fastest, widest = 0.0, COMPANY
    for i in range(crew.shape[0]):
        fastest = max(fastest, abs(crew[i].speed), crew[i].cruise, SLOW_SHARE * CRUISE)
        widest = max(widest, _company_within(crew[i], crew[i]))
    reach = max(LONGEST_LEG, fastest * (SAMPLES - 1) * STEP) + ROUNDING
    return float(max(widest, 2.0 * reach + gap))


class _Around(NamedTuple):
    """Room for the robots around one that chooses: as long as the fleet."""

    others: IntArray
    undecided: IntArray


@njit(cache=True)
def _look_around(
    i: int, crew: Crew, settled: BoolArray, gap: float, near: Neighbours, around: _Around
) -> tuple[int, int, bool]:
    """List whom robot ``i`` may meet: settled robots, and robots yet to decide.

    Returns:
        How many they are, and whether a robot is near enough to matter at all.
    """
    x, y, reach = crew[i].pose[0], crew[i].pose[1], _reach_of(crew[i])
    others, undecided, has_company = 0, 0, False
    for m in range(near.first[i], near.first[i + 1]):
        j = near.number[m]
        if not crew[j].present:
            continue
        dx, dy = crew[j].pose[0] - x, crew[j].pose[1] - y
        square, company = dx * dx + dy * dy, _company_within(crew[i], crew[j])
        has_company = has_company or square < company * company
        within = reach + _reach_of(crew[j]) + gap
        if square < within * within:
            if settled[j]:
                around.others[others] = j
                others += 1
            else:
                around.undecided[undecided] = j
                undecided += 1
    return others, undecided, has_company


@njit(cache=True)
def _standing_near(robot: np.record, people: People, min_gap_human: float) -> tuple[Array, Array]:
    """Find who stands near a robot: places ``(P, 2)``, and gaps ``(P,)`` to keep [m]."""
    h = people.radius.shape[0]
    place, gap = np.empty((h, 2)), np.empty(h)
    count = 0
    for k in range(h):
        dx, dy = people.position[k, 0] - robot.pose[0], people.position[k, 1] - robot.pose[1]
        pace = people.velocity[k, 0] ** 2 + people.velocity[k, 1] ** 2
        if pace < STANDING * STANDING and dx * dx + dy * dy < NEAR * NEAR:
            place[count, 0], place[count, 1] = people.position[k, 0], people.position[k, 1]
            gap[count] = people.radius[k] - HUMAN_RADIUS + min_gap_human + PEOPLE_MARGIN
            count += 1
    return place[:count], gap[:count]


@njit(cache=True)
def _path_of(i: int, robot: np.record, ways: Ways) -> Array:
    """Give the path of a robot that wants to move, or the straight way to its target."""
    path = ways.points[ways.first[i] : ways.first[i + 1]]
    if path.shape[0] >= 2:
        return path
    direct = np.empty((2, 2))
    direct[0, 0], direct[0, 1] = robot.pose[0], robot.pose[1]
    direct[1, 0], direct[1, 1] = robot.target[0], robot.target[1]
    return direct


@njit(cache=True)
def _fill_idle(robot: np.record, motion: Array) -> None:
    """Predict a robot that cannot move now, or one that decides for itself."""
    if robot.joint:
        fill_stop(robot, motion)
    else:
        fill_drift(robot, motion)


@njit(cache=True)
def _fill_alone(choice: np.record, robot: np.record) -> None:
    """Go on if the robot has somewhere to go."""
    if robot.wants:
        choice.kind = GO
        choice.point[0], choice.point[1] = robot.target[0], robot.target[1]


@njit(cache=True)
def _fill_choice(
    choice: np.record,
    i: int,
    crew: Crew,
    ways: Ways,
    points: Array,
    clearances: Clearances,
    places: SharedPlaces,
    traffic: Traffic,
) -> None:
    """Choose for robot ``i``, which has company or people beside it."""
    robot = crew[i]
    choice.conflict_at = -1.0
    if robot.wants:
        path = _path_of(i, robot, ways)
        stands = try_continuing(choice, i, robot, path, traffic)
        if stands and choice.conflict_at < np.inf:
            try_passing(choice, i, robot, path, points, clearances.obstacle, places, traffic)
    if choice.conflict_at < np.inf:
        try_waiting(choice, i, robot, traffic)
    if choice.conflict_at < np.inf:
        try_moving_aside(
            choice, i, crew, clearances.robot, points, clearances.obstacle, places, traffic
        )


@njit(cache=True)
def choose_manoeuvres(
    crew: Crew,
    order: IntArray,
    ways: Ways,
    points: Array,
    sensed: CrewView,
    clearances: Clearances,
    gap: float,
    near: Neighbours,
) -> Choices:
    """Choose a manoeuvre for each robot, better-placed robots first.

    Robots that neither want to move nor have a task may be asked to move aside. The others
    outside the joint decision are only kept clear of. Nobody moves aside into a place that is
    closed to it.

    Args:
        crew: robots, surveyed.
        order: ``(N,)`` robot numbers, the one that goes first in front.
        ways: paths; a robot that wants to move and has none goes straight to its target.
        points: ``(N, S, 2)`` obstacle points [m], inf: none.
        sensed: people, and places that robots must ask for.
        clearances: distances that the barrier rows keep.
        gap: robots nearer than this conflict [m].
        near: within :func:`reach_of_choices` or farther.

    Returns:
        ``(N,)`` of CHOICE; STAY for robots that this does not decide for.
    """
    n = crew.shape[0]
    choices = np.empty(n, dtype=CHOICE)
    motion, box = np.empty((n, SAMPLES, 2)), np.empty((n, 4))
    stuck, decides = np.zeros(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    settled = np.empty(n, dtype=np.bool_)
    people = people_in(sensed)
    around = _Around(np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64))
    for _ in range(2):
        for i in range(n):
            robot = crew[i]
            may_move = robot.wants or not robot.active
            decides[i] = robot.present and robot.joint and not stuck[i] and may_move
            settled[i] = robot.present and not decides[i]
            if settled[i]:
                _fill_idle(robot, motion[i])
                fill_box(motion[i], box[i])
        stuck_before = stuck.sum()
        for i in order:
            fill_initial(choices[i], crew[i])
            if not decides[i]:
                continue
            place, people_gap = _standing_near(crew[i], people, clearances.human)
            met, waited, has_company = _look_around(i, crew, settled, gap, near, around)
            if len(place) == 0 and not has_company:
                _fill_alone(choices[i], crew[i])
                fill_stop(crew[i], motion[i])
            else:
                others, undecided = around.others[:met], around.undecided[:waited]
                traffic = Traffic(motion, box, gap, place, people_gap, others, undecided)
                places = SharedPlaces(sensed.shared_corner, sensed.shared_first, sensed.closed[i])
                _fill_choice(choices[i], i, crew, ways, points[i], clearances, places, traffic)
                # Nowhere to go: in a second round the others have to find a way round it.
                stuck[i] = choices[i].conflict_at < np.inf and choices[i].kind == STAY
            fill_box(motion[i], box[i])
            settled[i] = True
        if stuck.sum() == stuck_before:
            break
    return choices


@njit(cache=True)
def let_leaders_go(crew: Crew) -> Choices:
    """Choose as MRTA-Sim does: leaders go on, the others wait."""
    choices = np.empty(crew.shape[0], dtype=CHOICE)
    for i in range(crew.shape[0]):
        fill_initial(choices[i], crew[i])
        choices[i].kind = WAIT
        if crew[i].leader == i:
            _fill_alone(choices[i], crew[i])
    return choices
