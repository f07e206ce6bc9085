"""Every robot for itself: barrier programs of one robot, the others as moving obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier import kind_table
from mrta_falsify.stack.control.dynamics import Dynamics, Wish
from mrta_falsify.stack.control.memory import Memory, remember_points, track_robots
from mrta_falsify.stack.control.options import CbfOptions
from mrta_falsify.stack.control.steering import Scene, steer, without_later_humans


class DecentralisedCbf:
    """No leaders and no commands: each robot avoids the others on its own.

    Two robots share the acceleration that keeps them apart, the better-ranked one taking the
    smaller part. Nobody plans for two, so robots that meet head-on may wait for each other for
    ever (a known weakness that the search is meant to find). A robot that lost the others'
    states stops.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options(CbfOptions):
        """Options beside those of all barrier controllers."""

        #: part of a demand between two robots that the better-ranked one takes; 0.5: no priority
        share: float = quantity(low=0.0, high=0.5, default=0.1)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._dynamics: Dynamics = registry.build(
            "dynamics",
            Choice(options.dynamics, dict(options.dynamics_options)),
            where="stack.controller",
        )
        self._kinds = kind_table(options)
        self._memory: Memory | None = None

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        options = self._options
        if "humans_unseen_beyond_two" in options.defects:
            view = without_later_humans(view)
        n = len(view.pose)
        memory = self._memory
        if memory is None or len(memory.pose) != n:
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
        better = view.rank[:, None] < view.rank[None, :]
        scene = Scene(
            pose=pose,
            points=points,
            known=view.present,
            group=np.where(view.present, np.arange(n), -1),
            share=np.where(better, options.share, 1.0 - options.share),
            wish=Wish(
                target=np.where(heard[:, None], view.target, np.nan),
                speed=view.max_speed,
                reverse=np.zeros(n, dtype=np.bool_),
                turn_first=np.full(n, np.pi / 4),
            ),
            weight=np.ones(n),
        )
        answer, twist = steer(self._dynamics, view, scene, options, self._kinds)
        twist[~view.present] = 0.0
        memory = Memory.fresh(pose, view.time)
        memory.point, memory.seen_at = points, seen_at
        memory.speed, memory.last_twist = speed, twist
        memory.tick = 1
        self._memory = memory
        return ControlResult(
            command=Command(twist=twist),
            cluster=np.arange(n),
            leader=np.arange(n),
            slack=answer.slack,
            fallback=~answer.usable,
        )
