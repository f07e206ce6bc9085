"""From wishes to twists: the part that all barrier controllers share."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.stack.control.barrier import Rows, Things, assemble_rows, input_box
from mrta_falsify.stack.control.dynamics import Dynamics, Motion, Wish
from mrta_falsify.stack.control.options import CbfOptions
from mrta_falsify.stack.control.qp import Answer, solve_fleet
from mrta_falsify.stack.control.surroundings import (
    list_things,
    seen_by_wrong_robot,
    speed_limits,
)

TIGHT = 0.01  # m beyond the body's half diagonal: nearer than that a turn on the spot may touch
TIGHT_RADIUS = 0.6  # m, turning radius that swings the rear corners out by 0.03 m at most
TIGHT_SPEED = 0.15  # m/s
HUMANS_OF_THE_DEFECT = 2  # people whom `humans_unseen_beyond_two` leaves in view
TIGHT_TURN = 0.05  # rad/s, where there is no room to drive either


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What is to be steered, and among what."""

    pose: Array  #: (N, 3) as the fleet knows it
    points: Array  #: (N, S, 2) obstacle points [m], inf: none
    known: BoolArray  #: (N,) robots that are there
    group: IntArray  #: (N,) robots of equal number decide together, < 0: not at all
    share: Array  #: (N, N) of a demand that a robot (row) takes against one of another group
    wish: Wish
    weight: Array  #: (N,) price of moving a robot away from its wish


def steer(
    dynamics: Dynamics,
    view: ControlView,
    scene: Scene,
    options: CbfOptions,
    kinds: Array,
) -> tuple[Answer, Array]:
    """Inputs and body twists ``(N, 3)`` nearest to the wishes that keep everyone clear."""
    view = dataclasses.replace(view, pose=scene.pose)
    position = np.ascontiguousarray(scene.pose[:, :2])
    motion = dynamics.linearise(view)
    things = list_things(
        scene.points,
        view.human_position,
        view.human_velocity,
        view.human_radius,
        position,
        motion.velocity,
        scene.known,
        scene.group,
        scene.share,
        options,
    )
    if "cluster_rows_wrong_robot" in options.defects:
        wrong = seen_by_wrong_robot(things.seen_from, things.kind, scene.group)
        things = dataclasses.replace(things, seen_from=wrong)
    low_speed, high_speed, halt, nearest = speed_limits(
        position,
        motion.velocity,
        motion.direction,
        scene.known,
        view.max_speed,
        view.max_acceleration,
        things.position,
        things.velocity,
        things.gap,
        things.kind,
        things.seen_from,
        view.human_radius,
        options.min_gap_robot,
        (
            options.body_radius,
            options.human_clearance,
            options.human_stop,
            options.reaction_time,
            options.braking_share,
            options.reverse_speed,
        ),
        view.dt,
    )
    low, high = input_box(
        motion.limit, motion.speed, low_speed, high_speed, view.dt, motion.drives_along
    )
    rows = _rows(position, motion, low, high, scene, things, options, kinds)
    reference = dynamics.reference(view, scene.wish)
    tight = nearest < options.body_radius + TIGHT
    if motion.drives_along and tight.any():
        _fill_drive_off(reference, tight, motion.speed, low_speed, high_speed, view.dt)
    reference = np.clip(reference, low, high)
    nowhere = np.full_like(scene.wish.target, np.nan)
    brake = np.clip(
        dynamics.reference(view, dataclasses.replace(scene.wish, target=nowhere)), low, high
    )
    answer = solve_fleet(
        rows,
        reference,
        brake,
        low,
        high,
        scene.weight,
        slack_weight=options.slack_weight,
        solver=options.solver,
    )
    twist = dynamics.twist(view, answer.inputs, low_speed, high_speed)
    if motion.drives_along and tight.any():
        turn = np.maximum(np.abs(twist[:, 0]) / TIGHT_RADIUS, TIGHT_TURN)
        twist[tight, 2] = np.clip(twist[:, 2], -turn, turn)[tight]
    twist[halt] = 0.0
    return answer, twist


def _fill_drive_off(
    reference: Array, tight: BoolArray, speed: Array, low: Array, high: Array, dt: float
) -> None:
    """Let robots that have no room to turn on the spot turn while they drive."""
    turning = tight & (np.abs(reference[:, 1]) > 0.05) & (np.abs(speed) < TIGHT_SPEED)
    forward = turning & (high > 0.5 * TIGHT_SPEED)
    backward = turning & ~forward & (low < -0.5 * TIGHT_SPEED)
    reference[forward, 0] = (TIGHT_SPEED - speed[forward]) / dt
    reference[backward, 0] = (-TIGHT_SPEED - speed[backward]) / dt


def _rows(
    position: Array,
    motion: Motion,
    low: Array,
    high: Array,
    scene: Scene,
    things: Things,
    options: CbfOptions,
    kinds: Array,
) -> Rows:
    own, own_bound, own_coupling, own_count, pair, pair_row, pair_bound, component = assemble_rows(
        position,
        motion.velocity,
        motion.effect,
        low,
        high,
        scene.group,
        things.position,
        things.velocity,
        things.gap,
        things.kind,
        things.share,
        things.seen_from,
        kinds,
        options.min_gap_robot,
    )
    return Rows(
        own=own,
        own_bound=own_bound,
        own_coupling=own_coupling,
        own_count=own_count,
        pair=pair,
        pair_row=pair_row,
        pair_bound=pair_bound,
        component=component,
    )


def without_later_humans(view: ControlView) -> ControlView:
    """Planted defect: MRTA-Sim has room for two people."""
    n = HUMANS_OF_THE_DEFECT
    return dataclasses.replace(
        view,
        human_position=view.human_position[:n],
        human_velocity=view.human_velocity[:n],
        human_radius=view.human_radius[:n],
    )
