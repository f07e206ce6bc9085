"""Run a world, and read off its trace what happened when."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig, apply_setting
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.trial import Job, run_job
from simulator_interface.simulate import Outcome

AT_REST = 0.05  # m/s


_outcomes: dict[tuple[str, ...], Outcome] = {}


def watch(
    world: World, *settings: str, engine: str = "kinematic", specifications: Sequence[str] = ()
) -> Outcome:
    """Run ``world`` under the default stack with ``settings``; equal runs of a process run once.

    Args:
        world: to run.
        settings: as ``--set`` takes them: ``planner=my_module:MyPlanner``.
        engine: that moves the robots.
        specifications: that judge the run beside the default ones, by name or ``module:Class``.
    """
    settings = (f"engine={engine}", *settings)
    judges = tuple(dict.fromkeys((*default_specifications(), *specifications)))
    key = (world.digest(), *settings, "", *judges)
    if key not in _outcomes:
        config = functools.reduce(apply_setting, settings, StackConfig())
        _outcomes[key] = run_job(Job(world=world, config=config, specifications=judges))
    return _outcomes[key]


def violations(outcome: Outcome) -> dict[str, float]:
    """Robustness of the specifications that are violated."""
    return {v.spec: v.robustness for v in outcome.verdicts if v.violated}


def went_well(outcome: Outcome) -> bool:
    """Whether all tasks were delivered and nobody touched anything."""
    done = outcome.tasks.completed == outcome.tasks.total
    return done and not violations(outcome) and not any(outcome.contacts.values())


def events(trace: Trace, kind: str, robot: int | None = None, **fields: object) -> list[StackEvent]:
    """Events of a kind, of one robot or of all, whose other fields are as given."""
    return [
        event
        for event in trace.events
        if event.kind == kind
        and (robot is None or event.robot == robot)
        and all(getattr(event, name) == value for name, value in fields.items())
    ]


def when(trace: Trace, kind: str, robot: int | None = None, **fields: object) -> float:
    """Time [s] of the first such event.

    Raises:
        AssertionError: there is none.
    """
    found = events(trace, kind, robot, **fields)
    assert found, f"no event {kind!r} of robot {robot} with {fields}"
    return found[0].time


def tick_of(trace: Trace, time: float) -> int:
    """Tick at ``time`` [s]."""
    return int(np.clip(round(time / trace.dt), 0, len(trace) - 1))


def first_time(trace: Trace, flags: Array, after: float = 0.0) -> float:
    """Time [s] of the first true value of ``flags`` ``(K,)`` from ``after`` on; inf: none."""
    is_due = trace.columns["time"] >= after - 1e-9
    later = np.flatnonzero(np.logical_and(flags, is_due))
    return float(trace.columns["time"][later[0]]) if len(later) else np.inf


def span(trace: Trace, start: float, end: float) -> slice:
    """Ticks from ``start`` [s] up to, and without, ``end`` [s]."""
    return slice(tick_of(trace, start), tick_of(trace, end))


def speed(trace: Trace, robot: int) -> Array:
    """Absolute forward speed ``(K,)`` [m/s] of a robot."""
    forward: Array = np.abs(trace.columns["velocity"][:, robot, 0])
    return forward


def goal_is(trace: Trace, robot: int, place: Array) -> Array:
    """Flags ``(K,)``: the robot finally heads for ``place`` ``(2,)`` [m]."""
    goal = trace.columns["goal"][:, robot]
    return np.asarray(np.hypot(*(np.nan_to_num(goal, nan=1e9) - place).T) < 0.05)


def path_at(trace: Trace, robot: int, tick: int) -> Array:
    """The path ``(L, 2)`` [m] that a robot follows at ``tick``; empty if none."""
    return trace.path_at(robot, tick)


def separation(trace: Trace, one: int, other: int) -> Array:
    """Distance ``(K,)`` [m] between the centres of two robots."""
    pose = trace.columns["pose"]
    distance: Array = np.hypot(*(pose[:, one, :2] - pose[:, other, :2]).T)
    return distance


def longest(flags: Array, dt: float) -> float:
    """Duration [s] of the longest run of true values in ``flags`` ``(K,)``."""
    best = run = 0
    for flag in np.asarray(flags).tolist():
        run = run + 1 if flag else 0
        best = max(best, run)
    return best * dt
