"""What one run of one stack in one world came to, as a mutant's process tells it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

CRASH, HANG = "crash", "hang"
STACK_RUNS = "stack_runs"  # specification that crashes violate where it is registered
#: how many times as much as the sound stack's run in the same world a run may cost
COSTLY = {"way": 1.5, "time": 1.5, "calls": 2.0}
#: the least that the sound stack's run counts as; below it, a multiple says nothing
LEAST = {
    "way": 10.0,  # m of the whole fleet, a trip across two rooms
    "time": 30.0,  # s, one short errand
    "calls": 5.0,  # of the allocator, two for each of two tasks and one more
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One world under one stack, judged."""

    fate: Literal["judged", "crash", "hang"]
    violated: tuple[str, ...] = ()  #: specifications
    error: str = ""  #: of a crash: its last line
    signature: str = ""
    guess: str = ""  #: layer that the trace alone points to
    score: float = 0.0
    objectives: dict[str, float] = field(default_factory=dict)
    descriptors: dict[str, float] = field(default_factory=dict)
    situations: tuple[str, ...] = ()
    blamed: tuple[str, ...] = ()  #: objects that took part
    costs: dict[str, float] = field(default_factory=dict)  #: way [m], time [s], calls
    digest: str = ""  #: of the trace
    sim_s: float = 0.0  #: simulated
    cpu_s: float = 0.0  #: measured, without compiling
    compile_s: float = 0.0  #: of CPU
    lines: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Lines of the stack that ran, by path; only if asked for."""


def reasons(run: Run, sound: Run | None = None) -> tuple[str, ...]:
    """List why a run is a failure, none if it is not.

    Args:
        run: of the stack under test.
        sound: of the sound stack in the same world; with it, needless costs count too.
    """
    if run.fate != "judged":
        return (run.fate,)
    if run.violated or sound is None or reasons(sound):
        return run.violated
    return tuple(
        f"costly_{name}"
        for name, cost in sorted(run.costs.items())
        if name in sound.costs and cost > COSTLY[name] * max(sound.costs[name], LEAST[name])
    )


def kind_of(why: tuple[str, ...]) -> str:
    """Name the kind of a failure: crash, hang, or behaviour."""
    if CRASH in why or HANG in why:
        return why[0]
    return CRASH if STACK_RUNS in why else "behaviour"
