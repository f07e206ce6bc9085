"""What a run costs, compared with a reference stack in the same world.

A stack may deliver everything in time and still drive needlessly. These specifications are off by
default, since each trial needs a run of the reference as well; ``--spec costly_way`` asks for one.
Robustness is the factor minus the run's costs as a multiple of the reference's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import DISPATCHER
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Costs
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import Ledger
from mrta_falsify.specs.running_min import RunningMin

CALLS_SIGNAL = "allocator_calls"  # in ``Frame.signals``, counted by the harness
#: the least that a reference counts as; below it, a multiple says nothing
LEAST_WAY = 10.0  # m of the whole fleet, a trip across two rooms
LEAST_TIME = 30.0  # s, one short errand
LEAST_CALLS = 5.0  # calls, two for each of two tasks and one more


class CostMeter:
    """Adds up what a run costs."""

    def __init__(self, world: World) -> None:
        self._ledger = Ledger(world)
        self._way = np.zeros(len(world.robots))
        self._last: Array | None = None
        self._time = 0.0
        self._calls: int | None = None
        self.missing = ""  #: what the stack does not tell of deliveries

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        position = sensed.pose[:, :2]
        if self._last is not None:
            self._way += np.hypot(*(position - self._last).T)
        self._last = position.copy()
        self._ledger.enter(frame.confirmed, sensed.time)
        self._time, self.missing = sensed.time, frame.tells.lacking("deliveries")
        calls = frame.signals.get(CALLS_SIGNAL)
        self._calls = None if calls is None else int(calls)

    def costs(self) -> Costs:
        """Give the costs to date."""
        ledger = self._ledger
        last = max(ledger.delivered.values(), default=self._time)
        return Costs(
            way=tuple(self._way.tolist()),
            time=last if ledger.closed else self._time,
            calls=self._calls,
            undelivered=len(ledger.open),
        )


class _Costly:
    """One kind of costs, as a multiple of the reference's."""

    _spec: ClassVar[str]
    _least: ClassVar[float]
    _costs: Costs | None = None  #: of the reference

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much more, and than whom."""

        factor: float = quantity(above=1.0, default=1.5)
        reference: tuple[str, ...] = ()  #: changes of the default stack, as ``--set`` takes them

    def __init__(self, options: Options) -> None:
        self._factor = options.factor
        self.reference = options.reference

    def compare_with(self, costs: Costs) -> None:
        """See :class:`mrta_falsify.core.protocols.Comparing`."""
        self._costs = costs

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del dt
        self._meter = CostMeter(world)
        self._highest = RunningMin(self._spec, self._factor)
        self._dearest: dict[str, Any] = {}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._meter.update(frame)
        if self._costs is None:
            return
        own, known = self._kind_of(self._meter.costs()), self._kind_of(self._costs)
        if own is None or known is None:
            return
        margin = self._factor - own / max(known, self._least)
        if margin < self._highest.margin:
            now = frame.sensed.time
            self._dearest = {"run": own, "reference": known, "factor": self._factor, "time": now}
            self._highest.note(margin, now, (), {})

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        missing = self._missing()
        return unjudged(self._spec, missing) if missing else self._highest.verdict(**self._dearest)

    def _missing(self) -> str:
        """Say why the costs cannot be compared, empty: they can."""
        if self._costs is None:
            return "there is no run of a reference stack"
        if self._costs.undelivered:
            return f"the reference stack left {self._costs.undelivered} tasks undelivered"
        if self._meter.missing:
            return self._meter.missing
        if self._kind_of(self._costs) is None or self._kind_of(self._meter.costs()) is None:
            return "the allocator's calls were not counted"
        return ""

    def _kind_of(self, costs: Costs) -> float | None:
        """Pick the kind of costs that is compared, None: they were not counted."""
        raise NotImplementedError


class CostlyWay(_Costly):
    """The fleet drives at most 1.5 times as far as with the reference stack."""

    profile = SpecProfile(
        meaning="robots drove farther than the reference stack lets them", scale=0.5, role="outcome"
    )

    _spec = "costly_way"
    _least = LEAST_WAY

    def _kind_of(self, costs: Costs) -> float | None:
        return math.fsum(costs.way)


class CostlyTime(_Costly):
    """The last delivery comes at most 1.5 times as late as with the reference stack."""

    profile = SpecProfile(
        meaning="the work took longer than with the reference stack", scale=0.5, role="outcome"
    )

    _spec = "costly_time"
    _least = LEAST_TIME

    def _kind_of(self, costs: Costs) -> float | None:
        return costs.time


class CostlyCalls(_Costly):
    """The allocator is called at most twice as often as by the reference stack.

    The factor is larger than that of way and time: a robot that is late once may cost a call.
    """

    profile = SpecProfile(
        meaning="the allocator was called more often than by the reference stack",
        role="outcome",
        layer=DISPATCHER,
    )

    _spec = "costly_calls"
    _least = LEAST_CALLS

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options(_Costly.Options):
        """How much more often, and than by whom."""

        factor: float = quantity(above=1.0, default=2.0)

    def _kind_of(self, costs: Costs) -> float | None:
        return None if costs.calls is None else float(costs.calls)
