"""What is computed for Bullet before and after each of its steps, in one compiled call each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Motors, move_set_points
from simulator_interface.engines.bullet_frames import Inertial, floor_poses, motor_targets
from simulator_interface.engines.gaps import PackedObstructions
from simulator_interface.engines.pedestrians import move_people

NEAR_PERSON = 1.0  # m between surfaces, below which a person stands in Bullet's world


class SubStep(NamedTuple):
    """One step of Bullet."""

    time: float  #: when it begins [s]
    length: float  #: [s]
    before: int  #: sub-steps before it, since the start


class Bases(NamedTuple):
    """What turns set points into speeds of joints."""

    motors: Motors
    loss: Array  #: (N, 2) shares of speed that slip takes
    wheels: Array  #: (N, 2) radius and separation [m]
    holonomic: IntArray  #: (N,) 1: three joints along the map's axes


class Prepared(NamedTuple):
    """What Bullet is told before a step."""

    targets: Array  #: (N, 3) speeds of joints; only two count for two wheels
    near: BoolArray  #: (H,) people who are to stand in Bullet's world
    was_in: BoolArray  #: (H,) people who do


def nothing_prepared(robots: int, humans: int) -> Prepared:
    """Make what is filled before the first step."""
    return Prepared(
        targets=np.zeros((robots, 3)),
        near=np.zeros(humans, dtype=np.bool_),
        was_in=np.zeros(humans, dtype=np.bool_),
    )


@njit(cache=True)
def fill_prepared(
    step: SubStep,
    command: Array,
    human_velocity: Array,
    pose: Array,
    bases: Bases,
    around: PackedObstructions,
    prepared: Prepared,
    touched: BoolArray,
) -> bool:
    """Move the set points, walk the people, and write what Bullet is to be told.

    Args:
        step: that comes.
        command: ``(N, 3)`` body twists.
        human_velocity: ``(H, 2)`` [m/s], map frame.
        pose: ``(N, 3)`` of the robots.
        bases: their set points are brought up to date.
        around: robots, solids and people; the people walk.
        prepared: receives the result.
        touched: ``(N,)`` set for robots that held up a person.

    Returns:
        Whether the body of any person moves.
    """
    motors, (prints, solids, people) = bases.motors, gaps.unpacked(around)
    move_set_points(command, step.time, motors, step.before)
    set_point, loss = motors.set_point, bases.loss
    prepared.targets[:] = motor_targets(set_point, loss, pose, bases.wheels, bases.holonomic)
    move_people(people, human_velocity, step.length, pose, prints, solids, touched)
    return _fill_near(people, pose, prints.reach, prepared.was_in, prepared.near)


@njit(cache=True)
def _fill_near(
    people: gaps.Pedestrians, pose: Array, reach: Array, was_in: BoolArray, near: BoolArray
) -> bool:
    """Write whether people ``(H,)`` are present and near a robot; say whether any body moves."""
    news = False
    position = people.position
    for h in range(len(position)):
        near[h] = False
        for i in range(len(pose)):
            apart = math.hypot(position[h, 0] - pose[i, 0], position[h, 1] - pose[i, 1])
            near[h] = near[h] or apart < people.radius[h] + NEAR_PERSON + reach[i]
        near[h] = near[h] and people.present[h]
        news = news or near[h] or was_in[h]
    return news


@njit(cache=True)
def fill_observed(
    raw: Array,
    inertial: Inertial,
    pose: Array,
    around: PackedObstructions,
    gap: Array,
    nearest: IntArray,
) -> float:
    """Write where the robots are, and lower the gaps of the tick.

    Args:
        raw: ``(N, 7)`` as for :func:`~.bullet_frames.floor_poses`.
        inertial: of the robots.
        pose: ``(N, 3)`` receives the poses.
        around: robots, solids and people.
        gap: ``(N, 3)`` as for :func:`~.gaps.fill_gaps`; lowered.
        nearest: ``(N, 2)`` of these gaps; updated.

    Returns:
        The least entry of ``gap`` [m].
    """
    pose[:] = floor_poses(raw, inertial)
    prints, solids, people = gaps.unpacked(around)
    return gaps.fill_gaps(pose, prints, solids, people, gap, nearest)
