"""How fast the controller is."""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from mrta_falsify.commands.bench.timing_values import CallTimes, call_times, milliseconds, timed
from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.protocols import Controller, ControlView
from mrta_falsify.core.seeding import stream
from mrta_falsify.stack.control.steering import Scene, Steering

CALLS = 400  # ticks that the controller is timed over
WARM_UP = 20  # of them, left out


def time_controller(config: StackConfig, robots: int) -> tuple[CallTimes, CallTimes | None]:
    """Time one tick with all robots in one cluster: the whole controller, and its program alone.

    The program is assembly of all rows and one solve for all robots, without the shortcuts
    (no solver where the reference obeys every row, components one by one) that the
    controller takes; None for a controller that does not use ours.
    """
    controller = _controller(config)
    views = _control_views(robots)
    for view in views[:WARM_UP]:
        controller.control(view)
    spent = np.array([timed(functools.partial(controller.control, view)) for view in views])
    return call_times(spent), _time_program(_controller(config), views)


@runtime_checkable
class _BarrierController(Controller, Protocol):
    """A controller built on our barrier program, whose parts can be timed alone."""

    steering: Steering

    def scene(self, view: ControlView) -> Scene:
        """What is steered at this tick."""


def _time_program(controller: Controller, views: Sequence[ControlView]) -> CallTimes | None:
    """Time the assembly of limits and rows, and one solve for all robots."""
    if not isinstance(controller, _BarrierController):
        return None
    steering = controller.steering
    spent = []
    for view in views:
        scene = controller.scene(view)
        before = time.perf_counter()
        program = steering.program(view, scene)
        assembled = time.perf_counter() - before
        joint = program.as_one()
        before = time.perf_counter()
        steering.solve(joint, always=True)
        spent.append(assembled + time.perf_counter() - before)
        controller.control(view)
    return call_times(np.array(spent[WARM_UP:]))


def time_controller_init(config: StackConfig) -> float:
    """Time the first call of a fresh controller of a cluster of three [ms]; median of five."""
    view = _control_views(3)[0]
    spent = [timed(lambda: _controller(config).control(view)) for _ in range(5)]
    return milliseconds(np.array(spent), 50.0)


def _controller(config: StackConfig) -> Controller:
    built: Controller = registry.build("controller", config.controller, defects=config.defects)
    return built


def _control_views(robots: int) -> list[ControlView]:
    """Views of a tight group that drives through a corridor past two people, tick by tick."""
    random = stream(robots, "bench/control")
    angles = np.arange(12) * np.pi / 6.0
    rays = 1.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ahead = np.array([5.0, 0.0])
    views = []
    for tick in range(CALLS):
        columns, rows = np.divmod(np.arange(robots), 2)
        place = np.stack([1.3 * columns + 0.02 * tick, 1.3 * rows], axis=1)
        place = place + random.normal(scale=0.01, size=place.shape)
        pose = np.column_stack([place, random.normal(scale=0.05, size=robots)])
        target = place + np.array([0.5, 0.0])
        views.append(
            ControlView(
                time=0.05 * tick,
                dt=0.05,
                pose=pose,
                velocity=np.tile([0.6, 0.0, 0.0], (robots, 1)),
                target=target,
                goal=place + ahead,
                path=tuple(np.array([p, p + ahead]) for p in place),
                active=np.ones(robots, dtype=bool),
                present=np.ones(robots, dtype=bool),
                rank=np.arange(robots),
                obstacle_points=place[:, None] + rays,
                human_position=place[0] + np.array([[1.5, -0.9], [2.5, 1.0]]),
                human_velocity=np.array([[-1.0, 0.0], [-0.8, 0.0]]),
                human_radius=np.array([0.25, 0.25]),
                states_link=np.ones(robots, dtype=bool),
                leader_link=np.ones(robots, dtype=bool),
                max_speed=np.full(robots, 1.5),
                max_acceleration=np.ones(robots),
                max_turn_rate=np.full(robots, 2.0),
            )
        )
    return views
