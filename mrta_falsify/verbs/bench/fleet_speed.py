"""How fast a whole run with all layers is."""

from __future__ import annotations

import time

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.verbs.bench.bench_worlds import fleet_world
from mrta_falsify.verbs.bench.timing_values import FleetSpeed, milliseconds
from simulator_interface.episode import Episode

WINDOW = 10.0  # s, "minimum over any 10 s"


def time_fleet(world: World, config: StackConfig, robots: int, seconds: float) -> FleetSpeed:
    """Measure the speed of a whole run: mean, worst window, worst busy window."""
    ticks = round(seconds * config.control_rate)
    spent, busy = np.empty(ticks), np.empty(ticks, dtype=bool)
    frames = Episode(fleet_world(world, config, robots), config).frames()
    next(frames)
    for tick in range(ticks):
        before = time.perf_counter()
        frame = next(frames)
        spent[tick] = time.perf_counter() - before
        busy[tick] = _is_busy(frame)
    frames.close()
    dt = 1.0 / config.control_rate
    return FleetSpeed(
        mean=round(ticks * dt / float(spent.sum()), 2),
        min=_worst_factor(spent, dt),
        busy_min=_worst_factor(spent[busy], dt) if busy.sum() * dt >= 1.0 else None,
        tick_p50_ms=milliseconds(spent, 50.0),
        tick_p99_ms=milliseconds(spent, 99.0),
    )


def _worst_factor(spent: Array, dt: float) -> float:
    """Find the smallest real-time factor over any ``WINDOW`` of consecutive times [s]."""
    width = min(round(WINDOW / dt), len(spent))
    sums = np.convolve(spent, np.ones(width), mode="valid")
    return round(width * dt / float(sums.max()), 2)


def _is_busy(frame: Frame) -> bool:
    """Whether all robots have work, and at least three form one cluster."""
    _, sizes = np.unique(frame.intent.cluster, return_counts=True)
    return bool((frame.intent.tasks_left > 0).all() and sizes.max(initial=0) >= 3)
