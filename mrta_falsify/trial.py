"""The one road: from a job to the record of its trial.

Module-level and free of closures, so that a spawned worker can run it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications, default_specifications
from simulator_interface.simulate import Outcome, simulate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """One world under one stack, judged by named specifications."""

    world: World
    config: StackConfig
    specifications: tuple[str, ...] = default_specifications()


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
