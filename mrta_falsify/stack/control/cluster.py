"""Local, centralised control: one barrier program per cluster, computed by its leader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier import kind_table
from mrta_falsify.stack.control.clusters import connected_clusters, elect_leaders, precedence
from mrta_falsify.stack.control.dynamics import Dynamics, Wish
from mrta_falsify.stack.control.memory import Memory, remember_points, track_robots
from mrta_falsify.stack.control.options import CbfOptions
from mrta_falsify.stack.control.steering import Scene, steer, without_later_humans
from mrta_falsify.stack.control.yielding import (
    ASIDE,
    GO,
    PASS,
    SLOW,
    WAIT,
    Manoeuvres,
    choose_manoeuvres,
)


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
        self._dynamics: Dynamics = registry.build(
            "dynamics",
            Choice(options.dynamics, dict(options.dynamics_options)),
            where="stack.controller",
        )
        self._kinds = kind_table(options)
        self._memory: Memory | None = None
        braking = options.followers == "brake" or "fixed_priority_starves" in options.defects
        self._followers_brake = braking
        self._patience = np.inf if braking else options.patience

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        options = self._options
        if "humans_unseen_beyond_two" in options.defects:
            view = without_later_humans(view)
        memory = self._memory
        if memory is None or len(memory.pose) != len(view.pose):
            memory = Memory.fresh(view.pose, view.time)
        heard = view.present & view.states_link
        pose, speed = track_robots(
            view.pose,
            view.velocity[:, 0],
            memory.pose,
            memory.speed,
            heard | (memory.tick == 0),
            view.max_acceleration,
            view.dt,
        )
        points, seen_at = remember_points(
            memory.point,
            memory.seen_at,
            view.obstacle_points,
            np.ascontiguousarray(pose[:, :2]),
            view.present,
            view.time,
            options.obstacle_memory,
        )
        wants = view.present & np.isfinite(view.target[:, 0])
        demoted = memory.demoted_until > view.time
        key = precedence(view.active & view.present, wants, demoted, view.rank)
        label = connected_clusters(
            np.ascontiguousarray(pose[:, :2]), heard, options.neighbour_distance
        )
        commanded = heard & view.leader_link
        leader = elect_leaders(label, commanded, view.active, key)
        hold, stop, on_its_own = self._lost_robots(view, memory, leader)
        joint = commanded & ~on_its_own
        moves = self._manoeuvres(view, pose, speed, points, joint, wants, key, leader)
        goes = (moves.kind == GO) | (moves.kind == PASS)
        anchor, anchor_at, demoted_until = _track_progress(
            memory.anchor,
            memory.anchor_at,
            memory.demoted_until,
            pose,
            wants & goes,
            view.time,
            self._patience,
        )
        halted = stop | (view.present & ~view.states_link)
        target = np.where(halted[:, None], np.nan, moves.target)
        group = np.where(view.present, np.where(joint, label, np.arange(len(pose))), -1)
        alone = np.bincount(label, minlength=len(pose))[label] < 2
        scene = Scene(
            pose=pose,
            points=points,
            known=view.present,
            group=group,
            share=np.ones((len(pose), len(pose))),
            wish=Wish(
                target=target,
                speed=np.minimum(moves.speed, view.max_speed),
                reverse=moves.reverse,
                turn_first=_turn_threshold(moves.kind, alone),
            ),
            weight=np.where(leader == np.arange(len(pose)), options.leader_weight, 1.0),
        )
        answer, twist = steer(self._dynamics, view, scene, options, self._kinds)
        twist = np.where(hold[:, None], memory.last_twist, twist)
        twist[~view.present] = 0.0
        follows = leader != np.arange(len(pose))
        if "follower_zero_command" in options.defects and memory.tick % 2:
            twist = np.where(follows[:, None], 0.0, twist)
        self._memory = Memory(
            point=points,
            seen_at=seen_at,
            pose=pose,
            speed=speed,
            anchor=anchor,
            anchor_at=anchor_at,
            demoted_until=demoted_until,
            remote_at=np.where(
                follows, view.time, np.where(view.leader_link, -np.inf, memory.remote_at)
            ),
            last_twist=twist,
            on_its_own=on_its_own,
            tick=memory.tick + 1,
        )
        return ControlResult(
            command=Command(twist=twist),
            cluster=label,
            leader=leader,
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def _lost_robots(
        self, view: ControlView, memory: Memory, leader: IntArray
    ) -> tuple[BoolArray, BoolArray, BoolArray]:
        """Robots that repeat their last command, that brake, and that control themselves."""
        lost = view.present & ~view.leader_link
        age = view.time - memory.remote_at
        followed = np.isfinite(memory.remote_at)
        hold = lost & followed & (age <= self._options.command_lifetime + 1e-9)
        at_rest = np.abs(view.velocity[:, 0]) < 0.05
        on_its_own = lost & ~hold & (memory.on_its_own | ~followed | at_rest)
        return hold, lost & ~hold & ~on_its_own, on_its_own

    def _manoeuvres(
        self,
        view: ControlView,
        pose: Array,
        speed: Array,
        points: Array,
        joint: BoolArray,
        wants: BoolArray,
        key: IntArray,
        leader: IntArray,
    ) -> Manoeuvres:
        options = self._options
        if self._followers_brake:
            leads = leader == np.arange(len(pose))
            goes = wants & leads
            return Manoeuvres(
                kind=np.where(goes, GO, WAIT),
                target=np.where(goes[:, None], view.target, np.nan),
                speed=view.max_speed.copy(),
                reverse=np.zeros(len(pose), dtype=np.bool_),
                conflict=np.full(len(pose), np.inf),
            )
        first = np.zeros(len(pose) + 1, dtype=np.int64)
        first[1:] = np.cumsum([len(path) for path in view.path])
        kind, target, pace, reverse, conflict = choose_manoeuvres(
            pose,
            speed,
            view.target,
            np.concatenate([path.reshape(-1, 2) for path in view.path])
            if first[-1]
            else np.zeros((0, 2)),
            first,
            np.argsort(key, kind="stable"),
            joint,
            wants,
            ~view.active & ~wants,
            view.present,
            view.max_speed,
            view.max_acceleration,
            points,
            view.human_position,
            view.human_velocity,
            view.human_radius - 0.25 + options.min_gap_human + 0.1,
            0.75,
            options.min_gap_robot + options.yield_margin,
            options.min_gap_robot,
            options.min_gap_obstacle,
            3.5,
        )
        # Robots outside the joint decision go their own way.
        outside = ~joint & wants
        return Manoeuvres(
            kind=np.where(outside, GO, kind),
            target=np.where(outside[:, None], view.target, target),
            speed=pace,
            reverse=reverse,
            conflict=conflict,
        )


def _turn_threshold(kind: IntArray, alone: BoolArray) -> Array:
    """Heading error above which a robot turns on the spot: MRTA-Sim's pi/4, pi/2 in clusters."""
    threshold = np.where(alone, np.pi / 4, np.pi / 2)
    threshold[(kind == ASIDE) | (kind == PASS)] = np.pi / 6
    threshold[kind == SLOW] = np.pi / 4
    return threshold


@njit(cache=True)
def _track_progress(
    anchor: Array,
    anchor_at: Array,
    demoted_until: Array,
    pose: Array,
    trying: BoolArray,
    now: float,
    patience: float,
) -> tuple[Array, Array, Array]:
    """Who is stuck although nobody asked it to wait; after ``patience`` its lead is suspended."""
    anchor, anchor_at, demoted_until = anchor.copy(), anchor_at.copy(), demoted_until.copy()
    for i in range(pose.shape[0]):
        dx, dy = pose[i, 0] - anchor[i, 0], pose[i, 1] - anchor[i, 1]
        if not trying[i] or dx * dx + dy * dy > 0.09:
            anchor[i, 0], anchor[i, 1] = pose[i, 0], pose[i, 1]
            anchor_at[i] = now
        elif now - anchor_at[i] >= patience:
            demoted_until[i] = now + patience
            anchor_at[i] = now
    return anchor, anchor_at, demoted_until
