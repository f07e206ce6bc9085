"""The figures of ``bench``, and how calls are timed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """Simulated time over time spent."""

    mean: float
    min: float  #: over any 10 s


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetSpeed:
    """Speed of a whole run: real-time factors, and time of a tick [ms]."""

    mean: float
    min: float  #: over any 10 s
    #: over any 10 s in which all robots have tasks and a cluster of three exists
    busy_min: float | None
    """The same over the ticks at which all robots have tasks and a cluster of three exists; None
    if they are less than 1 s."""
    tick_p50_ms: float
    tick_p99_ms: float
    copies: bool  #: whether the oracle ran copies; not with more than 24 robots
    cpu_factor: Factor  #: by CPU time, copies included: depends less on what else runs
    calls: int | None  #: Python functions called in a tick without events
    stages_ms: dict[str, float]  #: mean wall time of each stage of a tick, without inner ones


@dataclass(frozen=True, slots=True, kw_only=True)
class CallTimes:
    """Time of a call [ms]."""

    p50: float
    p99: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanTimes:
    """Time of a plan [ms]: the first one to a goal, and another one to a goal seen before."""

    cold_p95: float
    warm_p95: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """What the figures depend on."""

    cpu: str
    cores: int | None
    system: str
    python: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """What ``bench --format json`` prints; keys are numbers of robots."""

    real_time_factor: dict[str, FleetSpeed]  #: on the stack's engine
    engines: dict[str, dict[str, FleetSpeed]]  #: the same on each other engine, by its name
    #: one tick with that many robots in one cluster, assembled and solved without the controller's
    #: shortcuts; null for foreign controllers
    cbf_qp_ms: dict[str, CallTimes | None]
    control_ms: dict[str, CallTimes]  #: the whole controller, with its shortcuts
    qp_init_ms: float  #: first call of a fresh controller
    plan_ms: PlanTimes
    costmap_ms: float  #: costmap of a world never seen
    first_tick_ms: float  #: from a world with unseen furniture to the first tick
    engine_real_time_factor: dict[str, float]  #: the engine alone
    world: str
    machine: Machine


def timed(work: Callable[[], Any]) -> float:
    """Measure how long ``work`` takes [s]."""
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def milliseconds(seconds: Array, percentile: float) -> float:
    """Take a percentile of times [s], in milliseconds."""
    return round(1000.0 * float(np.percentile(seconds, percentile)), 3)


def call_times(seconds: Array) -> CallTimes:
    """Sum up the times of calls [s]."""
    return CallTimes(p50=milliseconds(seconds, 50.0), p99=milliseconds(seconds, 99.0))
