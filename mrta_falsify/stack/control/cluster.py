"""Local, centralised control: one barrier program per cluster, computed by its leader."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.dynamics import Wish
from mrta_falsify.stack.control.manoeuvres import (
    ASIDE,
    GO,
    PASS,
    SLOW,
    WAIT,
    Manoeuvres,
    choose_manoeuvres,
)
from mrta_falsify.stack.control.perception import Survey, survey_fleet
from mrta_falsify.stack.control.state import Memory
from mrta_falsify.stack.control.steering import Scene, Steering, without_later_humans

NO_PATHS = np.zeros((0, 2))


class ClusterCbf:
    """MRTA-Sim's scheme, with followers that keep going where they are in nobody's way.

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

    def __init__(self, options: Options) -> None:
        self._options = options
        self.steering = Steering(options)
        self._memory: Memory | None = None
        braking = options.followers == "brake" or "fixed_priority_starves" in options.defects
        self._followers_brake = braking
        self._patience = np.inf if braking else options.patience

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        view, survey, scene, memory = self._decide(view)
        answer, twist = self.steering.steer(view, scene)
        disobeys = "follower_zero_command" in self._options.defects and memory.tick % 2 == 0
        _fill_orders(
            twist, survey.hold, memory.last_twist, view.present, survey.leader, bool(disobeys)
        )
        memory.last_twist = twist
        self._memory = memory
        return ControlResult(
            command=Command(twist=twist),
            cluster=survey.cluster,
            leader=survey.leader,
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def scene(self, view: ControlView) -> Scene:
        """What :meth:`control` would steer at this tick; nothing is remembered of it."""
        return self._decide(view)[2]

    def _decide(self, view: ControlView) -> tuple[ControlView, Survey, Scene, Memory]:
        """What is seen, who is where, what is to be steered, what is to be remembered.

        The memory is that of the next tick, but for the command, which is still the last one.
        """
        options = self._options
        if "humans_unseen_beyond_two" in options.defects:
            view = without_later_humans(view)
        memory = self._memory
        if memory is None or len(memory.pose) != len(view.pose):
            memory = Memory.fresh(view.pose, view.time)
        survey = survey_fleet(
            view,
            memory,
            neighbour_distance=options.neighbour_distance,
            obstacle_memory=options.obstacle_memory,
            command_lifetime=options.command_lifetime,
        )
        moves = self._manoeuvres(view, survey)
        group, (target, anchor), figures = _follow_up(
            moves.kind,
            moves.target,
            moves.speed,
            survey.pose,
            survey.wants,
            survey.joint,
            survey.cluster,
            survey.leader,
            survey.halted,
            view.target,
            view.present,
            view.leader_link,
            view.max_speed,
            memory.anchor,
            memory.anchor_at,
            memory.demoted_until,
            memory.remote_at,
            view.time,
            self._patience,
            options.leader_weight,
        )
        speed, turn_first, weight, anchor_at, demoted_until, remote_at = figures
        scene = Scene(
            pose=survey.pose,
            points=survey.points,
            known=view.present,
            group=group,
            share=_equal_shares(len(group)),
            wish=Wish(target=target, speed=speed, reverse=moves.reverse, turn_first=turn_first),
            weight=weight,
        )
        after = Memory(
            point=survey.points,
            seen_at=survey.seen_at,
            pose=survey.pose,
            speed=survey.speed,
            anchor=anchor,
            anchor_at=anchor_at,
            demoted_until=demoted_until,
            remote_at=remote_at,
            last_twist=memory.last_twist,
            on_its_own=survey.on_its_own,
            tick=memory.tick + 1,
        )
        return view, survey, scene, after

    def _manoeuvres(self, view: ControlView, survey: Survey) -> Manoeuvres:
        options = self._options
        if self._followers_brake:
            n = len(view.pose)
            goes = survey.wants & (survey.leader == np.arange(n))
            return Manoeuvres(
                kind=np.where(goes, GO, WAIT),
                target=np.where(goes[:, None], view.target, np.nan),
                speed=view.max_speed,
                reverse=np.zeros(n, dtype=np.bool_),
            )
        first = np.array([0, *itertools.accumulate(map(len, view.path))], dtype=np.int64)
        kind, target, pace, reverse = choose_manoeuvres(
            survey.pose,
            survey.speed,
            view.target,
            np.concatenate(view.path) if first[-1] else NO_PATHS,
            first,
            survey.order,
            survey.joint,
            survey.wants,
            view.active,
            view.present,
            view.max_speed,
            view.max_acceleration,
            survey.points,
            view.human_position,
            view.human_velocity,
            view.human_radius,
            options.min_gap_human,
            0.75,
            options.min_gap_robot + options.yield_margin,
            options.min_gap_robot,
            options.min_gap_obstacle,
            3.5,
        )
        return Manoeuvres(kind=kind, target=target, speed=pace, reverse=reverse)


@functools.lru_cache(maxsize=16)
def _equal_shares(n: int) -> Array:
    """Shares ``(N, N)`` of demands between robots of different groups: each takes it all."""
    return np.ones((n, n))


@njit(cache=True)
def _follow_up(
    kind: IntArray,
    target: Array,
    pace: Array,
    pose: Array,
    wants: BoolArray,
    joint: BoolArray,
    cluster: IntArray,
    leader: IntArray,
    halted: BoolArray,
    own_target: Array,
    present: BoolArray,
    leader_link: BoolArray,
    max_speed: Array,
    anchor: Array,
    anchor_at: Array,
    demoted_until: Array,
    remote_at: Array,
    now: float,
    patience: float,
    leader_weight: float,
) -> tuple[IntArray, Array, Array]:
    """What follows from the manoeuvres: wishes, groups, prices, and what is to be remembered.

    Robots outside the joint decision go their own way.

    Returns:
        Group ``(N,)`` of the scene; target of the wishes and anchor ``(2, N, 2)``; speed and
        turn threshold of the wishes, weight of the scene, time of the anchor, suspended leads
        and time of the last remote command for the memory ``(6, N)``. Few arrays, because each
        that leaves compiled code costs as much as filling ten.
    """
    n = kind.shape[0]
    crew = np.zeros(n, dtype=np.int64)
    points, figures = np.empty((2, n, 2)), np.empty((6, n))
    wish, place = points
    speed, turn_first, weight, placed_at, suspended_until, commanded_at = figures
    group = np.empty(n, dtype=np.int64)
    tries = np.empty(n, dtype=np.bool_)
    for i in range(n):
        crew[cluster[i]] += 1
    for i in range(n):
        outside = wants[i] and not joint[i]
        does = GO if outside else kind[i]
        tries[i] = wants[i] and (does in (GO, PASS))
        for c in range(2):
            wish[i, c] = own_target[i, c] if outside else target[i, c]
            if halted[i]:
                wish[i, c] = np.nan
        speed[i] = min(pace[i], max_speed[i])
        turn_first[i] = _turn_threshold(does, crew[cluster[i]] < 2)
        group[i] = -1
        if present[i]:
            group[i] = cluster[i] if joint[i] else i
        weight[i] = leader_weight if leader[i] == i else 1.0
        commanded_at[i] = now
        if leader[i] == i:
            commanded_at[i] = -np.inf if leader_link[i] else remote_at[i]
    place[:], placed_at[:], suspended_until[:] = anchor, anchor_at, demoted_until
    _fill_progress(place, placed_at, suspended_until, pose, tries, now, patience)
    return group, points, figures


@njit(cache=True)
def _turn_threshold(kind: int, alone: bool) -> float:
    """Heading error above which a robot turns on the spot: MRTA-Sim's pi/4, pi/2 in clusters."""
    if kind in (ASIDE, PASS):
        return np.pi / 6
    return np.pi / 4 if alone or kind == SLOW else np.pi / 2


@njit(cache=True)
def _fill_progress(
    anchor: Array,
    anchor_at: Array,
    demoted_until: Array,
    pose: Array,
    trying: BoolArray,
    now: float,
    patience: float,
) -> None:
    """Who is stuck although nobody asked it to wait; after ``patience`` its lead is suspended."""
    for i in range(pose.shape[0]):
        dx, dy = pose[i, 0] - anchor[i, 0], pose[i, 1] - anchor[i, 1]
        if not trying[i] or dx * dx + dy * dy > 0.09:
            anchor[i, 0], anchor[i, 1] = pose[i, 0], pose[i, 1]
            anchor_at[i] = now
        elif now - anchor_at[i] >= patience:
            demoted_until[i] = now + patience
            anchor_at[i] = now


@njit(cache=True)
def _fill_orders(
    twist: Array,
    hold: BoolArray,
    last_twist: Array,
    present: BoolArray,
    leader: IntArray,
    disobeys: bool,
) -> None:
    """Repeated commands, and none for robots that are not there.

    ``disobeys``: planted defect, followers' own zero commands fight the leader's.
    """
    for i in range(twist.shape[0]):
        if hold[i]:
            twist[i, :] = last_twist[i, :]
        if not present[i] or (disobeys and leader[i] != i):
            twist[i, :] = 0.0
