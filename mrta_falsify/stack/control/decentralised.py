"""Every robot for itself: barrier programs of one robot, the others as moving obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.neighbours import neighbours_within
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.stack.control.barrier_options import CbfOptions
from mrta_falsify.stack.control.dynamics import NominalInput
from mrta_falsify.stack.control.state import (
    MET,
    ControllerState,
    CrewView,
    crew_view,
    hear_robots,
    remember_points,
)
from mrta_falsify.stack.control.steering import Scene, Steering

TURN_FIRST = np.pi / 4  # rad, heading error above which a robot turns on the spot, MRTA-Sim's


class DecentralisedCbf:
    """No leaders and no commands: each robot avoids the others on its own.

    Two robots share the acceleration that keeps them apart, the better-ranked one taking the
    smaller part. No robot plans for two, so robots that meet head-on may wait for each other
    without end (a known weakness that the search is meant to find). A robot that lost the
    others' states stops.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options(CbfOptions):
        """Options beside those of all barrier controllers."""

        #: part of a demand between two robots that the better-ranked one takes; 0.5: no priority
        share: float = quantity(low=0.0, high=0.5, default=0.1)

    def __init__(self, options: Options) -> None:
        self._options = options
        self.steering = Steering(options)
        self._state: ControllerState | None = None

    def control(self, view: ControlView) -> ControlResult:
        """See :class:`~mrta_falsify.core.protocols.Controller`."""
        view, state, scene = self._decide(view)
        answer, twist = self.steering.steer(view, scene)
        twist[~view.present] = 0.0
        self._state = state
        n = len(view.pose)
        return ControlResult(
            command=Command(twist=twist),
            cluster=np.arange(n),
            leader=np.arange(n),
            slack=answer.slack,
            fallback=~answer.usable,
        )

    def scene(self, view: ControlView) -> Scene:
        """Give what :meth:`control` would steer at this tick; nothing of it is remembered."""
        return self._decide(view)[2]

    def _decide(self, view: ControlView) -> tuple[ControlView, ControllerState, Scene]:
        """Give what is seen, what is to be remembered, and what is to be steered."""
        options = self._options
        n = len(view.pose)
        last = self._state
        if last is None or len(last.crew) != n:
            last = ControllerState.fresh(view.pose, view.time)
        crew, sensed = last.crew.copy(), crew_view(view)
        all_heard = hear_robots(crew, CrewView(*sensed), last.tick == 0)
        pose = view.pose if all_heard else np.ascontiguousarray(crew["pose"])
        points, seen_at = remember_points(
            last.point,
            last.seen_at,
            view.obstacle_points,
            pose,
            view.present,
            view.time,
            options.obstacle_memory,
            neighbours_within(pose, MET),
        )
        heard = view.present & view.states_link
        better = view.rank[:, None] < view.rank[None, :]
        scene = Scene(
            sensed=sensed,
            pose=pose,
            points=points,
            known=view.present,
            group=np.where(view.present, np.arange(n), -1),
            share=np.where(better, options.share, 1.0 - options.share),
            nominal=NominalInput(
                target=np.where(heard[:, None], view.target, np.nan),
                speed=view.max_speed,
                reverse=np.zeros(n, dtype=np.bool_),
                turn_first=np.full(n, TURN_FIRST),
            ),
            weight=np.ones(n),
        )
        state = ControllerState(crew=crew, point=points, seen_at=seen_at, tick=1)
        return view, state, scene
