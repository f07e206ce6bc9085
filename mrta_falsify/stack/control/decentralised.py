"""Every robot for itself: barrier programs of one robot, the others as moving obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.dynamics import Wish
from mrta_falsify.stack.control.state import Memory, remember_points, track_robots
from mrta_falsify.stack.control.steering import Scene, Steering, without_later_humans


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
        self.steering = Steering(options)
        self._memory: Memory | None = None

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        view, memory, scene = self._decide(view)
        answer, twist = self.steering.steer(view, scene)
        twist[~view.present] = 0.0
        memory.last_twist = twist
        self._memory = memory
        n = len(view.pose)
        return ControlResult(
            command=Command(twist=twist),
            cluster=np.arange(n),
            leader=np.arange(n),
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def scene(self, view: ControlView) -> Scene:
        """What :meth:`control` would steer at this tick; nothing is remembered of it."""
        return self._decide(view)[2]

    def _decide(self, view: ControlView) -> tuple[ControlView, Memory, Scene]:
        """What is seen, what is to be remembered, what is to be steered."""
        options = self._options
        if "humans_unseen_beyond_two" in options.defects:
            view = without_later_humans(view)
        n = len(view.pose)
        last = self._memory
        if last is None or len(last.pose) != n:
            last = Memory.fresh(view.pose, view.time)
        heard = view.present & view.states_link
        pose, speed = track_robots(
            view.pose,
            view.velocity[:, 0].copy(),
            last.pose,
            last.speed,
            heard | (last.tick == 0),
            view.max_acceleration,
            view.dt,
        )
        points, seen_at = remember_points(
            last.point,
            last.seen_at,
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
        memory = Memory.fresh(pose, view.time)
        memory.point, memory.seen_at, memory.speed, memory.tick = points, seen_at, speed, 1
        return view, memory, scene
