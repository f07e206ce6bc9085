"""Local, centralised control: one barrier program per cluster, computed by its leader."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.polyline import packed
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.choosing import Ways, choose_manoeuvres, let_leaders_go
from mrta_falsify.stack.control.dynamics import Wish
from mrta_falsify.stack.control.obstacles import Clearances, People, clearances_of, people_in
from mrta_falsify.stack.control.perception import survey_crew
from mrta_falsify.stack.control.recovery import back_up_where_stuck
from mrta_falsify.stack.control.state import (
    ControllerState,
    Crew,
    CrewView,
    crew_view,
    hear_robots,
    remember_points,
)
from mrta_falsify.stack.control.steering import Scene, Steering, without_later_humans
from mrta_falsify.stack.control.wishes import Wishes, fill_wishes


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
    clearances: Clearances


class Seen(NamedTuple):
    """Obstacle points before this tick, and what the rays hit at it."""

    point: Array  #: (N, SECTORS, 2) [m]
    seen_at: Array  #: (N, SECTORS) [s]
    hits: Array  #: (N, A, 2) [m]


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
        self.steering = Steering(options)
        self._state: ControllerState | None = None
        braking = options.followers == "brake" or "fixed_priority_starves" in options.defects
        self._rules = Rules(
            neighbour_distance=options.neighbour_distance,
            obstacle_memory=options.obstacle_memory,
            command_lifetime=options.command_lifetime,
            patience=np.inf if braking else options.patience,
            leader_weight=options.leader_weight,
            yield_margin=options.yield_margin,
            followers_brake=braking,
            backs_up=options.recovery and options.dynamics != "holonomic",
            clearances=clearances_of(options),
        )
        self._sees_two_people = "humans_unseen_beyond_two" in options.defects
        self._followers_disobey = "follower_zero_command" in options.defects

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        decision = self._decide(view)
        answer, twist = self.steering.steer(decision.view, decision.scene)
        state = decision.state
        disobeys = self._followers_disobey and state.tick % 2 == 0
        _fill_orders(twist, state.crew, disobeys)
        self._state = state
        return ControlResult(
            command=Command(twist=twist),
            cluster=decision.cluster,
            leader=decision.leader,
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def scene(self, view: ControlView) -> Scene:
        """Give what :meth:`control` would steer at this tick; nothing of it is remembered."""
        return self._decide(view).scene

    def _decide(self, view: ControlView) -> _Decision:
        if self._sees_two_people:
            view = without_later_humans(view)
        last = self._state
        if last is None or len(last.crew) != len(view.pose):
            last = ControllerState.fresh(view.pose, view.time)
        crew, wishes = last.crew.copy(), Wishes.room_for(len(view.pose))
        point, seen_at = np.empty_like(last.point), np.empty_like(last.seen_at)
        all_told = _decide_crew(
            crew,
            crew_view(view),
            Seen(last.point, last.seen_at, view.obstacle_points),
            Ways(*packed(view.path)),
            people_in(view),
            (self._rules, last.tick == 0),
            (point, seen_at),
            wishes,
        )
        group, cluster, leader = wishes.numbers
        speed, turn_first, weight = wishes.figures
        scene = Scene(
            pose=view.pose if all_told else np.ascontiguousarray(crew["pose"]),
            points=point,
            known=view.present,
            group=group,
            share=_equal_shares(len(group)),
            wish=Wish(wishes.target, speed, wishes.reverse, turn_first),
            weight=weight,
        )
        state = ControllerState(crew=crew, point=point, seen_at=seen_at, tick=last.tick + 1)
        return _Decision(view, scene, cluster, leader, state)


class _Decision(NamedTuple):
    view: ControlView  #: what is seen
    scene: Scene  #: what is to be steered
    cluster: IntArray  #: (N,)
    leader: IntArray  #: (N,)
    state: ControllerState  #: of the next tick, but for the commands, which are still the last


@functools.lru_cache(maxsize=16)
def _equal_shares(n: int) -> Array:
    """Let each robot take the whole of a demand between groups: ``(N, N)`` of 1."""
    return np.ones((n, n))


@njit(cache=True)
def _decide_crew(
    crew: Crew,
    told: CrewView,
    seen: Seen,
    ways: Ways,
    people: People,
    law: tuple[Rules, bool],
    memory: tuple[Array, Array],
    wishes: Wishes,
) -> bool:
    """Bring the crew to this tick: perception, manoeuvres, wishes.

    Args:
        crew: of the last tick; written.
        told: what the view says.
        seen: obstacle points.
        ways: paths ahead.
        people: who is about.
        law: options, and whether this is the first tick.
        memory: obstacle points and their times, filled.
        wishes: filled.

    Returns:
        Whether all poses are those told.
    """
    rules, is_first = law
    all_told = hear_robots(crew, told, is_first)
    order = survey_crew(crew, told, rules.neighbour_distance, rules.command_lifetime)
    position = np.empty((crew.shape[0], 2))
    for i in range(crew.shape[0]):
        position[i, 0], position[i, 1] = crew[i].pose[0], crew[i].pose[1]
    points, seen_at = memory
    points[:], seen_at[:] = remember_points(
        seen.point,
        seen.seen_at,
        seen.hits,
        position,
        told.present,
        told.time,
        rules.obstacle_memory,
    )
    if rules.followers_brake:
        choices = let_leaders_go(crew)
    else:
        choices = choose_manoeuvres(
            crew, order, ways, points, people, rules.clearances, rules.yield_margin
        )
    if rules.backs_up:
        gap = rules.clearances.obstacle
        back_up_where_stuck(choices, crew, points, people, gap, told.time)
    fill_wishes(crew, choices, told, rules.patience, rules.leader_weight, wishes)
    return all_told


@njit(cache=True)
def _fill_orders(twist: Array, crew: Crew, disobeys: bool) -> None:
    """Repeat commands, stop robots that are not there, and remember what was sent.

    ``disobeys``: planted defect, followers' own zero commands fight the leader's.
    """
    for i in range(twist.shape[0]):
        robot = crew[i]
        for c in range(3):
            if robot.hold:
                twist[i, c] = robot.twist[c]
            if not robot.present or (disobeys and robot.leader != i):
                twist[i, c] = 0.0
            robot.twist[c] = twist[i, c]
