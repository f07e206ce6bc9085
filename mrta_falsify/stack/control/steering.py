"""From nominal inputs to twists: the part that all barrier controllers share.

``Steering.steer`` is one tick of it: ``program`` (limits, rows, reference inputs), ``solve``,
then twists. The steps are public, so that a benchmark can time the program alone.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.config import Choice
from mrta_falsify.core.neighbours import neighbours_within
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.stack.control.barrier import (
    ROBOT,
    Kinds,
    Movers,
    Rows,
    fill_own_rows,
    fill_pair_rows,
    input_box,
    kind_table,
    reach_of_pairs,
    room_for_rows,
)
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.dynamics import Dynamics, Motion, NominalInput
from mrta_falsify.stack.control.obstacles import (
    ROBOT_RANGE,
    Clearances,
    Things,
    clearances_of,
    seen_by_wrong_robot,
)
from mrta_falsify.stack.control.qp import Demand, FleetInputs, solve_fleet
from mrta_falsify.stack.control.speed_limits import SpeedMargins, margins_of, speed_limits
from mrta_falsify.stack.control.state import CrewView, people_in

TIGHT = 0.01  # m beyond the body's half diagonal: nearer than that a turn on the spot may touch
TIGHT_RADIUS = 0.6  # m, turning radius that swings the rear corners out by 0.03 m at most
TIGHT_SPEED = 0.15  # m/s
TIGHT_TURN = 0.05  # rad/s, where there is no room to drive either
TURNING = 0.05  # rad/s, slower turns are none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What is to be steered, and among what."""

    sensed: tuple[Any, ...]  #: what the view says, the fields of a :class:`CrewView`
    pose: Array  #: (N, 3) as the fleet knows it; the view's own object if that is the same
    points: Array  #: (N, S, 2) obstacle points [m], inf: none
    known: BoolArray  #: (N,) robots that are there
    group: IntArray  #: (N,) robots of equal number decide together, < 0: not at all
    share: Array  #: (N, N) of a demand that a robot (row) takes against one of another group
    nominal: NominalInput
    weight: Array  #: (N,) price of moving a robot away from its nominal motion


class InputLimits(NamedTuple):
    """What each robot's inputs and speed must stay within, whatever the rows ask."""

    low: Array  #: (N, 2) smallest inputs
    high: Array  #: (N, 2) largest inputs
    low_speed: Array  #: (N,) along the direction of travel [m/s]
    high_speed: Array  #: (N,) [m/s]
    halt: BoolArray  #: (N,) must stop at once for a person
    tight: BoolArray  #: (N,) has no room to turn on the spot


#: what is kept clear of, and how: (3,) of KIND, the fields of Clearances and of SpeedMargins, and
#: whether rows are of the wrong robot (a fault that can be planted, see ``obstacles``)
Law = tuple[Kinds, tuple[Any, ...], tuple[Any, ...], bool]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BarrierProgram:
    """The barrier program of a tick: what the robots would like, and what they must obey."""

    view: ControlView  #: with poses as the fleet knows them
    nominal: NominalInput
    motion: Motion
    reference: Array  #: (N, 2) wanted inputs, within the limits
    weight: Array  #: (N,)
    limits: InputLimits
    rows: Rows

    def as_one(self) -> BarrierProgram:
        """Put all robots in one program, coupled or not (for measuring)."""
        together = np.zeros_like(self.rows.component)
        return dataclasses.replace(self, rows=self.rows._replace(component=together))


class Steering:
    """Dynamics, distances and solver of a controller; has no memory."""

    def __init__(self, options: CbfOptions, *, crosses_rows: bool = False) -> None:
        self._dynamics: Dynamics = registry.build(
            "dynamics",
            Choice(options.dynamics, dict(options.dynamics_options)),
            where="stack.controller",
        )
        self._law: Law = (
            kind_table(options),
            tuple(clearances_of(options)),
            tuple(margins_of(options)),
            crosses_rows,
        )
        self._solver = options.solver
        self._slack_weight = options.slack_weight

    def steer(self, view: ControlView, scene: Scene) -> tuple[FleetInputs, Array]:
        """Find the nearest inputs to the nominal ones that keep clear, and twists ``(N, 3)``."""
        program = self.program(view, scene)
        answer = self.solve(program)
        limits = program.limits
        twist = self._dynamics.twist(
            program.view, answer.inputs, limits.low_speed, limits.high_speed
        )
        _fill_restraint(twist, limits.tight, limits.halt, program.motion.drives_along)
        return answer, twist

    def program(self, view: ControlView, scene: Scene) -> BarrierProgram:
        """Assemble limits, rows and reference inputs of all robots."""
        if scene.pose is not view.pose:
            view = dataclasses.replace(view, pose=scene.pose)
        motion = self._dynamics.linearise(view)
        reference = np.array(self._dynamics.reference(view, scene.nominal), dtype=np.float64)
        n, sectors, _ = scene.points.shape
        low, high = np.empty((2, n, 2))
        low_speed, high_speed = np.empty((2, n))
        halt, tight = np.empty((2, n), dtype=np.bool_)
        limits = InputLimits(low, high, low_speed, high_speed, halt, tight)
        rows = room_for_rows(n, sectors + len(view.human_radius) + n)
        _fill_program(
            scene.sensed,
            tuple(motion),
            (scene.pose, scene.known, scene.group),
            (scene.points, scene.share),
            self._law,
            tuple(limits),
            tuple(rows),
            reference,
        )
        return BarrierProgram(
            view=view,
            nominal=scene.nominal,
            motion=motion,
            reference=reference,
            weight=scene.weight,
            limits=limits,
            rows=rows,
        )

    def solve(self, program: BarrierProgram, *, always: bool = False) -> FleetInputs:
        """Find the inputs nearest to the reference; ``always`` as in :func:`qp.solve_fleet`."""
        limits = program.limits

        def brake() -> Array:
            nowhere = program.nominal._replace(target=np.full_like(program.nominal.target, np.nan))
            reference = self._dynamics.reference(program.view, nowhere)
            return np.clip(reference, limits.low, limits.high)

        return solve_fleet(
            program.rows,
            Demand(program.reference, limits.low, limits.high, program.weight),
            brake,
            slack_weight=self._slack_weight,
            solver=self._solver,
            always=always,
        )


@njit(cache=True)
def _fill_program(
    view: tuple[Any, ...],
    moves: tuple[Any, ...],
    crew: tuple[Array, BoolArray, IntArray],
    around: tuple[Array, Array],
    law: Law,
    range_: tuple[Any, ...],
    lines: tuple[Any, ...],
    inputs: Array,
) -> None:
    """Find what limits the robots; one entry, because each call from Python costs.

    Args:
        view: fields of :class:`CrewView`.
        moves: fields of :class:`Motion`.
        crew: ``pose``, ``known`` and ``group`` of :class:`Scene`.
        around: ``points`` and ``share`` of :class:`Scene`.
        law: what is kept clear of.
        range_: fields of :class:`InputLimits`, filled.
        lines: fields of :class:`Rows`, filled.
        inputs: ``(N, 2)`` wanted ones; brought within their limits.
    """
    sensed, motion = CrewView(*view), Motion(*moves)
    limits, rows = InputLimits(*range_), Rows(*lines)
    kinds, clearances, margins = law[0], Clearances(*law[1]), SpeedMargins(*law[2])
    pose, known, group = crew
    points, share = around
    movers = Movers(
        pose,
        motion.velocity,
        motion.direction,
        motion.speed,
        motion.effect,
        motion.limit,
        sensed.max_speed,
        sensed.max_acceleration,
        known,
        group,
    )
    people, dt, drives_along = people_in(sensed), sensed.dt, motion.drives_along
    loads = sensed.active & np.isnan(sensed.target[:, 0])
    kind, gap = kinds[ROBOT], clearances.robot
    near = neighbours_within(pose, max(ROBOT_RANGE, reach_of_pairs(movers, kind, gap)))
    seen_from = np.empty((0, 0), dtype=np.int64)
    if law[3]:
        seen_from = seen_by_wrong_robot(points, people, pose, group)
    things = Things(points, people, near, share, loads, seen_from)
    speeds = speed_limits(movers, things, clearances, margins, dt)
    low, high = input_box(movers.limit, movers.speed, speeds.low, speeds.high, dt, drives_along)
    for i in range(points.shape[0]):
        limits.low_speed[i], limits.high_speed[i] = speeds.low[i], speeds.high[i]
        limits.halt[i] = speeds.halt[i]
        limits.tight[i] = speeds.nearest[i] < margins.body_radius + TIGHT
        for c in range(2):
            limits.low[i, c], limits.high[i, c] = low[i, c], high[i, c]
    fill_own_rows(movers, low, high, things, clearances, kinds, rows)
    fill_pair_rows(movers, low, high, kind, gap, near, rows)
    _bring_within_reach(inputs, limits, motion.speed, dt, drives_along)
    for i in range(points.shape[0]):
        if loads[i]:
            for c in range(2):
                limits.low[i, c] = limits.high[i, c] = inputs[i, c]


@njit(cache=True)
def _bring_within_reach(
    inputs: Array, limits: InputLimits, speed: Array, dt: float, drives_along: bool
) -> None:
    """Bring wanted inputs ``(N, 2)`` within their limits.

    Robots that have no room to turn on the spot turn while they drive.
    """
    low, high = limits.low, limits.high
    for i in range(inputs.shape[0]):
        first, second = inputs[i, 0], inputs[i, 1]
        turns = drives_along and limits.tight[i]
        turns = turns and abs(second) > TURNING and abs(speed[i]) < TIGHT_SPEED
        if turns and limits.high_speed[i] > 0.5 * TIGHT_SPEED:
            first = (TIGHT_SPEED - speed[i]) / dt
        elif turns and limits.low_speed[i] < -0.5 * TIGHT_SPEED:
            first = (-TIGHT_SPEED - speed[i]) / dt
        inputs[i, 0] = min(max(first, low[i, 0]), high[i, 0])
        inputs[i, 1] = min(max(second, low[i, 1]), high[i, 1])


@njit(cache=True)
def _fill_restraint(twist: Array, tight: BoolArray, halt: BoolArray, drives_along: bool) -> None:
    """Turn only while driving where there is no room, and stop at once for people."""
    for i in range(twist.shape[0]):
        if drives_along and tight[i]:
            turn = max(abs(twist[i, 0]) / TIGHT_RADIUS, TIGHT_TURN)
            twist[i, 2] = min(max(twist[i, 2], -turn), turn)
        if halt[i]:
            twist[i, :] = 0.0
