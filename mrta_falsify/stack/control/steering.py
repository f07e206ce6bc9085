"""From wishes to twists: the part that all barrier controllers share.

``Steering.steer`` is one tick of it: ``program`` (limits, rows, reference inputs), ``solve``,
then twists. The steps are public, so that a benchmark can time the program alone.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.stack.control.barrier import Rows, assemble_rows, input_box, kind_table
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.dynamics import Dynamics, Motion, Wish
from mrta_falsify.stack.control.obstacles import (
    list_things,
    seen_by_wrong_robot,
    speed_limits,
)
from mrta_falsify.stack.control.qp import Answer, solve_fleet

TIGHT = 0.01  # m beyond the body's half diagonal: nearer than that a turn on the spot may touch
TIGHT_RADIUS = 0.6  # m, turning radius that swings the rear corners out by 0.03 m at most
TIGHT_SPEED = 0.15  # m/s
TIGHT_TURN = 0.05  # rad/s, where there is no room to drive either
HUMANS_OF_THE_DEFECT = 2  # people whom `humans_unseen_beyond_two` leaves in view


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What is to be steered, and among what."""

    pose: Array  #: (N, 3) as the fleet knows it; the view's own object if that is the same
    points: Array  #: (N, S, 2) obstacle points [m], inf: none
    known: BoolArray  #: (N,) robots that are there
    group: IntArray  #: (N,) robots of equal number decide together, < 0: not at all
    share: Array  #: (N, N) of a demand that a robot (row) takes against one of another group
    wish: Wish
    weight: Array  #: (N,) price of moving a robot away from its wish


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Program:
    """The barrier program of a tick: what the robots would like, and what they must obey."""

    view: ControlView  #: with poses as the fleet knows them
    wish: Wish
    motion: Motion
    reference: Array  #: (N, 2) wanted inputs, within the limits
    weight: Array  #: (N,)
    low: Array  #: (N, 2) smallest inputs
    high: Array  #: (N, 2) largest inputs
    low_speed: Array  #: (N,) along the direction of travel [m/s]
    high_speed: Array  #: (N,) [m/s]
    halt: BoolArray  #: (N,) must stop at once for a person
    tight: BoolArray  #: (N,) has no room to turn on the spot
    rows: Rows

    def as_one(self) -> Program:
        """The same with all robots in one program, coupled or not (for measuring)."""
        together = np.zeros_like(self.rows.component)
        return dataclasses.replace(self, rows=dataclasses.replace(self.rows, component=together))


class Steering:
    """Dynamics, distances and solver of a controller; has no memory."""

    def __init__(self, options: CbfOptions) -> None:
        self._dynamics: Dynamics = registry.build(
            "dynamics",
            Choice(options.dynamics, dict(options.dynamics_options)),
            where="stack.controller",
        )
        self._kinds = kind_table(options)
        self._gaps = (options.min_gap_obstacle, options.min_gap_human, options.min_gap_robot)
        self._margins = (
            options.body_radius,
            options.human_clearance,
            options.human_stop,
            options.reaction_time,
            options.braking_share,
            options.reverse_speed,
        )
        self._solver = options.solver
        self._slack_weight = options.slack_weight
        self._rows_of_wrong_robot = "cluster_rows_wrong_robot" in options.defects

    def steer(self, view: ControlView, scene: Scene) -> tuple[Answer, Array]:
        """Inputs and body twists ``(N, 3)`` nearest to the wishes that keep everyone clear."""
        program = self.program(view, scene)
        answer = self.solve(program)
        twist = self._dynamics.twist(
            program.view, answer.inputs, program.low_speed, program.high_speed
        )
        _fill_restraint(twist, program.tight, program.halt, program.motion.drives_along)
        return answer, twist

    def program(self, view: ControlView, scene: Scene) -> Program:
        """Limits, rows and reference inputs of all robots."""
        if scene.pose is not view.pose:
            view = dataclasses.replace(view, pose=scene.pose)
        motion = self._dynamics.linearise(view)
        (low_speed, high_speed), (halt, tight), (low, high), fields = _constraints(
            scene.points,
            view.human_position,
            view.human_velocity,
            view.human_radius,
            scene.pose,
            motion.velocity,
            motion.direction,
            motion.speed,
            motion.effect,
            motion.limit,
            motion.drives_along,
            scene.known,
            scene.group,
            scene.share,
            view.max_speed,
            view.max_acceleration,
            self._kinds,
            self._gaps,
            self._margins,
            self._rows_of_wrong_robot,
            view.dt,
        )
        own, figures, numbers, pair, pair_row, pair_bound = fields
        (own_bound, own_coupling), (own_count, component) = figures, numbers
        reference = _within_reach(
            self._dynamics.reference(view, scene.wish),
            low,
            high,
            tight,
            motion.speed,
            low_speed,
            high_speed,
            view.dt,
            motion.drives_along,
        )
        return Program(
            view=view,
            wish=scene.wish,
            motion=motion,
            reference=reference,
            weight=scene.weight,
            low=low,
            high=high,
            low_speed=low_speed,
            high_speed=high_speed,
            halt=halt,
            tight=tight,
            rows=Rows(
                own=own,
                own_bound=own_bound,
                own_coupling=own_coupling,
                own_count=own_count,
                pair=pair,
                pair_row=pair_row,
                pair_bound=pair_bound,
                component=component,
            ),
        )

    def solve(self, program: Program, *, always: bool = False) -> Answer:
        """Inputs nearest to the reference; ``always`` as in :func:`qp.solve_fleet`."""

        def brake() -> Array:
            nowhere = np.full_like(program.wish.target, np.nan)
            wish = dataclasses.replace(program.wish, target=nowhere)
            reference = self._dynamics.reference(program.view, wish)
            return np.clip(reference, program.low, program.high)

        return solve_fleet(
            program.rows,
            program.reference,
            brake,
            program.low,
            program.high,
            program.weight,
            slack_weight=self._slack_weight,
            solver=self._solver,
            always=always,
        )


@njit(cache=True)
def _constraints(
    points: Array,
    human_position: Array,
    human_velocity: Array,
    human_radius: Array,
    pose: Array,
    velocity: Array,
    direction: Array,
    speed: Array,
    effect: Array,
    limit: Array,
    drives_along: bool,
    known: BoolArray,
    group: IntArray,
    share: Array,
    max_speed: Array,
    max_acceleration: Array,
    kinds: Array,
    gaps: tuple[float, float, float],
    margins: tuple[float, float, float, float, float, float],
    rows_of_wrong_robot: bool,
    dt: float,
) -> tuple[Array, BoolArray, Array, tuple[Array, Array, IntArray, IntArray, Array, Array]]:
    """What limits the robots.

    Returns:
        Lowest and highest speeds ``(2, N)``; who must halt and who stands tight ``(2, N)``;
        smallest and largest inputs ``(2, N, 2)``; what :func:`assemble_rows` gives.
    """
    n = pose.shape[0]
    position = np.empty((n, 2))
    for i in range(n):
        position[i, 0], position[i, 1] = pose[i, 0], pose[i, 1]
    where, moving, gap, kind, part, seen_from = list_things(
        points,
        human_position,
        human_velocity,
        human_radius,
        position,
        velocity,
        known,
        group,
        share,
        gaps,
    )
    if rows_of_wrong_robot:
        seen_from = seen_by_wrong_robot(seen_from, kind, group)
    speeds, box = np.empty((2, n)), np.empty((2, n, 2))
    claims = np.empty((2, n), dtype=np.bool_)
    speeds[0], speeds[1], claims[0], nearest = speed_limits(
        position,
        velocity,
        direction,
        known,
        max_speed,
        max_acceleration,
        where,
        moving,
        gap,
        kind,
        seen_from,
        human_radius,
        gaps[2],
        margins,
        dt,
    )
    for i in range(n):
        claims[1, i] = nearest[i] < margins[0] + TIGHT
    box[0], box[1] = input_box(limit, speed, speeds[0], speeds[1], dt, drives_along)
    rows = assemble_rows(
        position,
        velocity,
        effect,
        box[0],
        box[1],
        group,
        where,
        moving,
        gap,
        kind,
        part,
        seen_from,
        kinds,
        gaps[2],
    )
    return speeds, claims, box, rows


@njit(cache=True)
def _within_reach(
    wanted: Array,
    low: Array,
    high: Array,
    tight: BoolArray,
    speed: Array,
    low_speed: Array,
    high_speed: Array,
    dt: float,
    drives_along: bool,
) -> Array:
    """Wanted inputs ``(N, 2)`` within their limits.

    Robots that have no room to turn on the spot turn while they drive.
    """
    inputs = np.empty_like(wanted)
    for i in range(wanted.shape[0]):
        first, second = wanted[i, 0], wanted[i, 1]
        turns = drives_along and tight[i] and abs(second) > 0.05 and abs(speed[i]) < TIGHT_SPEED
        if turns and high_speed[i] > 0.5 * TIGHT_SPEED:
            first = (TIGHT_SPEED - speed[i]) / dt
        elif turns and low_speed[i] < -0.5 * TIGHT_SPEED:
            first = (-TIGHT_SPEED - speed[i]) / dt
        inputs[i, 0] = min(max(first, low[i, 0]), high[i, 0])
        inputs[i, 1] = min(max(second, low[i, 1]), high[i, 1])
    return inputs


@njit(cache=True)
def _fill_restraint(twist: Array, tight: BoolArray, halt: BoolArray, drives_along: bool) -> None:
    """Turn only while driving where there is no room, and stop at once for people."""
    for i in range(twist.shape[0]):
        if drives_along and tight[i]:
            turn = max(abs(twist[i, 0]) / TIGHT_RADIUS, TIGHT_TURN)
            twist[i, 2] = min(max(twist[i, 2], -turn), turn)
        if halt[i]:
            twist[i, :] = 0.0


def without_later_humans(view: ControlView) -> ControlView:
    """Planted defect: MRTA-Sim has room for two people."""
    n = HUMANS_OF_THE_DEFECT
    return dataclasses.replace(
        view,
        human_position=view.human_position[:n],
        human_velocity=view.human_velocity[:n],
        human_radius=view.human_radius[:n],
    )
