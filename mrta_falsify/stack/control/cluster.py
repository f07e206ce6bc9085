"""Local, centralised control: one barrier program per cluster, computed by its leader."""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.neighbours import neighbours_within
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.choosing import (
    Ways,
    choose_manoeuvres,
    let_leaders_go,
    reach_of_choices,
)
from mrta_falsify.stack.control.dynamics import NominalInput
from mrta_falsify.stack.control.nominal_motion import NominalInputs, fill_nominal
from mrta_falsify.stack.control.obstacles import Clearances, clearances_of
from mrta_falsify.stack.control.perception import survey_crew
from mrta_falsify.stack.control.recovery import back_up_where_stuck
from mrta_falsify.stack.control.state import (
    MET,
    ControllerState,
    Crew,
    CrewView,
    crew_view,
    hear_robots,
    people_in,
    remember_points,
)
from mrta_falsify.stack.control.steering import Scene, Steering


class Rules(NamedTuple):
    """Options of the joint decision."""

    neighbour_distance: float  #: [m]
    obstacle_memory: float  #: [s]
    command_lifetime: float  #: [s]
    patience: float  #: [s]
    leader_weight: float
    yield_margin: float  #: [m]
    followers_brake: bool
    backs_up: bool


class ClusterCbf:
    """MRTA-Sim's scheme, with followers that keep going unless they are in the way.

    Robots nearer than ``neighbour_distance`` form clusters; the best-ranked active robot of a
    cluster solves the barrier program of all its robots and sends the others their commands.
    Only robots that share their states and hear commands take part; a robot that lost its
    leader brakes, then controls itself alone; one that lost the others' states stops.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options(CbfOptions):
        """Options of clusters, beside those of all barrier controllers."""

        neighbour_distance: float = quantity(above=0.0, unit="m", default=4.0)
        #: what followers do: wait like MRTA-Sim's, or go on unless they are in the way
        followers: Literal["yield", "brake"] = "yield"
        leader_weight: float = quantity(above=0.0, default=4.0)  #: price of slowing the leader
        patience: float = quantity(above=0.0, unit="s", default=10.0)  #: before the lead passes on
        command_lifetime: float = quantity(low=0.0, unit="s", default=0.25)
        yield_margin: float = quantity(low=0.0, unit="m", default=0.12)  #: beyond min_gap_robot
        recovery: bool = True  #: back up where a solid holds a robot; never if it is holonomic

    def __init__(self, options: Options) -> None:
        self.steering = self._steering(options)
        self._state: ControllerState | None = None
        braking = options.followers == "brake"
        self._rules = Rules(
            neighbour_distance=options.neighbour_distance,
            obstacle_memory=options.obstacle_memory,
            command_lifetime=options.command_lifetime,
            patience=np.inf if braking else options.patience,
            leader_weight=options.leader_weight,
            yield_margin=options.yield_margin,
            followers_brake=braking,
            backs_up=options.recovery and options.dynamics != "holonomic",
        )
        self._clearances = clearances_of(options)

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        state = self._state
        if state is None or len(state.crew) != len(view.pose):
            state = self._state = ControllerState.fresh(view.pose, view.time)
        scene, nominal = self._decide(view, state)
        answer, twist = self.steering.steer(view, scene)
        state.tick += 1
        _fill_orders(twist, state.crew, not self._obeys(state))
        _, cluster, leader = nominal.numbers
        return ControlResult(
            command=Command(twist=twist),
            cluster=cluster,
            leader=leader,
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def _steering(self, options: ClusterCbf.Options) -> Steering:
        """Build what turns nominal inputs into twists."""
        return Steering(options)

    def _obeys(self, state: ControllerState) -> bool:
        """Whether followers carry out their leader's command at this tick."""
        del state
        return True

    def scene(self, view: ControlView) -> Scene:
        """Give what :meth:`control` would steer at this tick; nothing of it is remembered."""
        state = copy.deepcopy(self._state)
        if state is None or len(state.crew) != len(view.pose):
            state = ControllerState.fresh(view.pose, view.time)
        return self._decide(view, state)[0]

    def _decide(self, view: ControlView, state: ControllerState) -> tuple[Scene, NominalInputs]:
        """Bring ``state`` to this tick, but for the commands, which are still the last."""
        sensed, n, path = crew_view(view), len(view.pose), view.path
        if not isinstance(path, Polylines):
            path = Polylines.of(path)
        nominal = NominalInputs(
            np.empty((3, n), dtype=np.int64),
            np.empty((n, 2)),
            np.empty((3, n)),
            np.empty(n, dtype=np.bool_),
        )
        all_heard = _decide_crew(
            state.crew,
            sensed,
            (path.points, path.first),
            (tuple(self._rules), tuple(self._clearances), state.tick == 0),
            (state.point, state.seen_at),
            tuple(nominal),
        )
        speed, turn_first, weight = nominal.figures
        scene = Scene(
            sensed=sensed,
            pose=view.pose if all_heard else np.ascontiguousarray(state.crew["pose"]),
            points=state.point,
            known=view.present,
            group=nominal.numbers[0],
            share=_equal_shares(n),
            nominal=NominalInput(nominal.target, speed, nominal.reverse, turn_first),
            weight=weight,
        )
        return scene, nominal


@functools.lru_cache(maxsize=16)
def _equal_shares(n: int) -> Array:
    """Let each robot take the whole of a demand between groups: ``(N, N)`` of 1."""
    return np.ones((n, n))


@njit(cache=True)
def _decide_crew(
    crew: Crew,
    view: tuple[Any, ...],
    paths: tuple[Array, IntArray],
    law: tuple[tuple[Any, ...], tuple[Any, ...], bool],
    memory: tuple[Array, Array],
    result: tuple[Any, ...],
) -> bool:
    """Bring the crew to this tick: perception, manoeuvres, nominal inputs.

    Args:
        crew: of the last tick; written.
        view: fields of :class:`CrewView`.
        paths: ahead, the fields of :class:`Ways`.
        law: fields of :class:`Rules` and :class:`Clearances`, and whether this is the first tick.
        memory: obstacle points and their times; brought up to date.
        result: fields of :class:`NominalInputs`, filled.

    Returns:
        Whether all poses are those told.
    """
    rules, clearances, is_first = Rules(*law[0]), Clearances(*law[1]), law[2]
    sensed, ways, nominal = CrewView(*view), Ways(*paths), NominalInputs(*result)
    people = people_in(sensed)
    all_heard = hear_robots(crew, sensed, is_first)
    position = np.empty((crew.shape[0], 2))
    for i in range(crew.shape[0]):
        position[i, 0], position[i, 1] = crew[i].pose[0], crew[i].pose[1]
    gap = clearances.robot + rules.yield_margin
    near = neighbours_within(
        position, max(rules.neighbour_distance, MET, reach_of_choices(crew, gap))
    )
    order = survey_crew(
        crew, sensed, rules.neighbour_distance, rules.command_lifetime, position, near
    )
    points, seen_at = memory
    points[:], seen_at[:] = remember_points(
        points,
        seen_at,
        sensed.obstacle_points,
        position,
        sensed.present,
        sensed.time,
        rules.obstacle_memory,
        near,
    )
    if rules.followers_brake:
        choices = let_leaders_go(crew)
    else:
        choices = choose_manoeuvres(crew, order, ways, points, sensed, clearances, gap, near)
    if rules.backs_up:
        back_up_where_stuck(choices, crew, points, people, clearances.obstacle, sensed.time)
    fill_nominal(crew, choices, sensed, rules.patience, rules.leader_weight, nominal)
    return all_heard


@njit(cache=True)
def _fill_orders(twist: Array, crew: Crew, disobeys: bool) -> None:
    """Repeat commands, stop robots that are not there, and remember what was sent.

    ``disobeys``: followers stop instead of what their leader commands.
    """
    for i in range(twist.shape[0]):
        robot = crew[i]
        for c in range(3):
            if robot.hold:
                twist[i, c] = robot.twist[c]
            if not robot.present or (disobeys and robot.leader != i):
                twist[i, c] = 0.0
            robot.twist[c] = twist[i, c]
