"""The one road: from a job to the record of its trial.

Module-level and free of closures, so that a spawned worker can run it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.world import World
from simulator_interface.simulate import Outcome, simulate

#: judged when the user names none
DEFAULT_SPECIFICATIONS = (
    "no_robot_robot_contact",
    "no_robot_human_contact",
    "no_robot_static_contact",
    "human_clearance",
    "all_tasks_done",
    "deadlines",
    "no_deadlock",
    "no_livelock",
    "no_starvation",
    "progress",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """One world under one stack, judged by named specifications."""

    world: World
    config: StackConfig
    specifications: tuple[str, ...] = DEFAULT_SPECIFICATIONS


def build_specifications(names: Sequence[str]) -> tuple[Specification, ...]:
    """Specifications by name; ``stl:FORMULA`` is a formula of the user's.

    Raises:
        UnknownNameError: no such specification.
        ConfigError: a formula that cannot be parsed.
    """
    return tuple(_build_specification(name) for name in names)


def _build_specification(name: str) -> Specification:
    prefix, separator, formula = name.partition(":")
    is_formula = bool(separator) and prefix == "stl"
    choice = Choice("stl", {"formula": formula}) if is_formula else Choice(name)
    built: Specification = registry.build("specification", choice, where="--spec")
    return built


def run_job(
    job: Job,
    *,
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
) -> Outcome:
    """Simulate and judge one job (see :func:`simulator_interface.simulate.simulate`)."""
    return simulate(
        job.world,
        job.config,
        specifications=build_specifications(job.specifications),
        keep_trace=keep_trace,
        on_progress=on_progress,
    )
