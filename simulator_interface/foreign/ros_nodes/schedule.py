"""What a real system leaves to chance, taken from the seed or from the search.

When processes start, how long messages take, in which order callbacks run that are due at the same
time: a stack may fail under one schedule and pass under another.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

WIDEST_PHASE = 0.05  # s, a period of the usual control loop
PHASE = "phase"  # dial of a program's start: `phase.NAME` [s]


class UnknownDial(ValueError):  # noqa: N818 - says what is wrong with a dial
    """A dial of the schedule that there is not."""


@dataclass(frozen=True)
class Dials:
    """How chance is set.

    Args:
        seed: of what is drawn.
        latency: least and most time that a message takes [s].
        shuffles: callbacks that are due at the same time run in random order.
        phases: when programs start [s], by name; those that are not named: by the seed.
        widest_phase: latest start that is drawn [s].
    """

    seed: int = 0
    latency: tuple[float, float] = (0.0, 0.0)
    shuffles: bool = False
    phases: Mapping[str, float] | None = None
    widest_phase: float = WIDEST_PHASE


class Schedule:
    """Draws what is left to chance.

    Args:
        dials: how.
    """

    def __init__(self, dials: Dials) -> None:
        self._dials = dials
        self._latencies = random.Random(f"latency {dials.seed}")
        self.order = random.Random(f"order {dials.seed}") if dials.shuffles else None

    def latency(self) -> float:
        """Draw how long one message takes [s]."""
        least, most = self._dials.latency
        return self._latencies.uniform(least, most) if most > least else least

    def phases(self, programs: Sequence[str]) -> dict[str, float]:
        """Give when each program starts [s]."""
        draw = random.Random(f"phases {self._dials.seed}")
        drawn = {name: draw.uniform(0.0, self._dials.widest_phase) for name in sorted(programs)}
        return {**drawn, **(self._dials.phases or {})}


def read_dials(params: Mapping[str, Any], seed: int, programs: Sequence[str]) -> Dials:
    """Read dials from the parameters of a stack.

    Args:
        params: ``latency_least``, ``latency_most`` [s], ``order`` (0: first come first served,
            1: shuffled), ``phases`` (widest [s]), ``schedule`` (a seed), ``phase.PROGRAM`` [s].
        seed: of the world, used where no ``schedule`` is given.
        programs: names of all.

    Raises:
        UnknownDial: there is no such dial, or no such program.
    """
    phases = {}
    for name, value in params.items():
        if name.startswith(f"{PHASE}."):
            program = name.removeprefix(f"{PHASE}.")
            if program not in programs:
                raise UnknownDial(
                    f"{name}: no program is called {program!r}; there are {', '.join(programs)}"
                )
            phases[program] = float(value)
    least = float(params.get("latency_least", 0.0))
    return Dials(
        seed=int(params.get("schedule", seed)),
        latency=(least, max(least, float(params.get("latency_most", least)))),
        shuffles=bool(params.get("order", 0)),
        phases=phases,
        widest_phase=float(params.get("phases", WIDEST_PHASE)),
    )
