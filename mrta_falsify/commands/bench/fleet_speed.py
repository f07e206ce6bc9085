"""How fast a whole run is, with all layers and all default specifications."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.bench.timing_values import Factor, FleetSpeed, milliseconds
from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.trace import TraceRecorder
from mrta_falsify.core.world import World
from mrta_falsify.process.usage import cpu_of_tree
from mrta_falsify.specs.books import Books
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.specs.stops_served import StopsServed
from mrta_falsify.stack.driving import Driving
from mrta_falsify.stack.pipeline import Stack
from mrta_falsify.stack.replanning import Replanning
from simulator_interface.episode import Episode
from simulator_interface.guard import Guard
from simulator_interface.people.crowd import Crowd
from simulator_interface.simulate import EpisodeRun


@dataclass(slots=True)
class Stopwatch:
    """Adds up the time that stages take, without that of the stages they call."""

    clock: Callable[[], float] = time.perf_counter  #: gives seconds
    seconds: dict[str, float] = field(default_factory=dict)
    calls: Counter[str] = field(default_factory=Counter)
    _inner: float = 0.0  #: spent in stages that the present one called [s]

    @contextlib.contextmanager
    def watching(self, owner: type, method: str, name: str) -> Iterator[None]:
        """Time a method of a class meanwhile, as (a part of) stage ``name``."""
        own = vars(owner).get(method)
        setattr(owner, method, self._timed(getattr(owner, method), name))
        self.seconds.setdefault(name, 0.0)
        try:
            yield
        finally:
            if own is None:
                delattr(owner, method)
            else:
                setattr(owner, method, own)

    def _timed(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timed(*args: Any, **named: Any) -> Any:
            outer, self._inner = self._inner, 0.0
            before = self.clock()
            try:
                return method(*args, **named)
            finally:
                spent = self.clock() - before
                self.seconds[name] += spent - self._inner
                self.calls[name] += 1
                self._inner = outer + spent

        return timed


WINDOW = 10.0  # s, "minimum over any 10 s"
SAMPLE = 1.0  # s between two looks at CPU time, which is counted in hundredths
NO_LIMITS = StackLimits(tick=3600.0, memory=1024.0)
#: robots; larger fleets run without copies, each of which may take minutes where they jam
COPIED_UP_TO = 24
SHARE_FOR_STAGES = 1 / 3  # of the ticks that are timed: so many more are split into stages
COUNTED = 100  # ticks whose calls are counted, after these
#: methods that are stages of a tick; the engine's and the specifications' are added
STAGES: tuple[tuple[type, str, str], ...] = (
    (Crowd, "velocities", "people"),
    (Stack, "step", "missions and rooms"),
    (Replanning, "step", "planning"),
    (Driving, "views", "look-ahead"),
    (Driving, "control", "control"),
    (Books, "update", "books"),
    (StopsServed, "update", "books"),
    (BlockedByTracker, "update", "blocked-by"),
    (TraceRecorder, "add", "trace"),
    (Episode, "_ask_again", "asking again"),
)


def time_fleet(world: World, config: StackConfig, robots: int, seconds: float) -> FleetSpeed:
    """Measure the speed of a whole run: mean, worst window, worst busy window.

    It runs in a copy of this process, as episodes of commands do. CPU time is that of all processes
    that the copy starts, too. Fleets of more than ``COPIED_UP_TO`` robots run without copies.

    Args:
        world: with people, who stay; a fleet that is too large for it drives elsewhere, without.
        config: the stack.
        robots: of the fleet, all with tasks.
        seconds: simulated time [s].
    """
    call = functools.partial(_time_fleet, world, config, robots, seconds)
    guard = Guard()
    try:
        return guard.run(call, config=config, limits=NO_LIMITS, portable=True)
    finally:
        guard.close()


def _time_fleet(world: World, config: StackConfig, robots: int, seconds: float) -> FleetSpeed:
    ticks, dt = round(seconds * config.control_rate), 1.0 / config.control_rate
    wall, busy = np.empty(ticks), np.empty(ticks, dtype=bool)
    specifications = build_specifications()
    run = EpisodeRun(
        fleet_world(world, config, robots),
        config,
        specifications=specifications,
        keep_trace=False,
        copies=robots <= COPIED_UP_TO,
        speculates=True,
    )
    kinds = dict.fromkeys(type(specification) for specification in specifications)
    own = [(kind, "update", _spec_stage(kind)) for kind in kinds]
    own.append((type(registry.build("engine", config.engine)), "step", "engine"))
    root, per_sample = os.getpid(), max(1, round(SAMPLE / dt))
    with contextlib.closing(run):
        run.advance()
        cpu = [cpu_of_tree(root)]
        for tick in range(ticks):
            before = time.perf_counter()
            frame = run.advance()
            wall[tick] = time.perf_counter() - before
            busy[tick] = _is_busy(frame)
            if (tick + 1) % per_sample == 0:
                cpu.append(cpu_of_tree(root))
        stages_ms = _stages_of_next_ticks(run, own, max(1, round(ticks * SHARE_FOR_STAGES)))
        calls = _calls_of_a_quiet_tick(run)
    return FleetSpeed(
        mean=_mean_factor(wall, dt),
        min=_worst_factor(wall, dt),
        busy_min=_worst_factor(wall[busy], dt) if busy.sum() * dt >= 1.0 else None,
        tick_p50_ms=milliseconds(wall, 50.0),
        tick_p99_ms=milliseconds(wall, 99.0),
        copies=robots <= COPIED_UP_TO,
        cpu_factor=Factor(
            mean=_mean_factor(np.diff(cpu), per_sample * dt),
            min=_worst_factor(np.diff(cpu), per_sample * dt),
        ),
        calls=calls,
        stages_ms=stages_ms,
    )


def _stages_of_next_ticks(
    run: EpisodeRun, own: Iterable[tuple[type, str, str]], ticks: int
) -> dict[str, float]:
    """Time ``STAGES`` and those of its ``own`` [ms]; that costs about a tenth of a tick."""
    watch = Stopwatch()
    with contextlib.ExitStack() as watched:
        for owner, method, name in (*STAGES, *own):
            watched.enter_context(watch.watching(owner, method, name))
        began = time.perf_counter()
        for _ in range(ticks):
            run.advance()
        spent = time.perf_counter() - began
    stages = {**watch.seconds, "rest": spent - sum(watch.seconds.values())}
    return {name: round(1000.0 * seconds / ticks, 4) for name, seconds in stages.items()}


def _spec_stage(kind: type) -> str:
    return "oracle" if kind is NoDeadlock else "specifications"


def _mean_factor(spent: Array, dt: float) -> float:
    return round(len(spent) * dt / float(spent.sum()), 2)


def _worst_factor(spent: Array, dt: float) -> float:
    """Find the smallest real-time factor over any ``WINDOW`` of consecutive times [s]."""
    width = min(round(WINDOW / dt), len(spent))
    sums = np.convolve(spent, np.ones(width), mode="valid")
    return round(width * dt / float(sums.max()), 2)


def _is_busy(frame: Frame) -> bool:
    """Whether all robots have work, and at least three form one cluster."""
    _, sizes = np.unique(frame.intent.cluster, return_counts=True)
    return bool((frame.intent.tasks_left > 0).all() and sizes.max(initial=0) >= 3)


def _calls_of_a_quiet_tick(run: EpisodeRun) -> int | None:
    """Count the Python functions called in a tick without events: median; None: no such tick."""
    counts = []
    for _ in range(COUNTED):
        count = 0

        def note(frame: Any, event: str, arg: Any) -> None:
            nonlocal count
            count += event == "call"

        sys.setprofile(note)
        try:
            frame = run.advance()
        finally:
            sys.setprofile(None)
        if not frame.events:
            counts.append(count)
    return int(np.median(counts)) if counts else None
