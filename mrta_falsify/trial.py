"""One world under one stack: simulate it and judge it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.descriptors import Descriptors
from mrta_falsify.specs.library import build_specifications, default_specifications
from mrta_falsify.specs.objectives import objectives
from simulator_interface.guard import Guard, current_guard
from simulator_interface.simulate import Outcome, simulate

T = TypeVar("T")

SETTLE = 3.0  # s of simulation kept after the violation that decides a run
LOOK_EVERY = 0.5  # s between two looks at whether a run is decided
UNBOUNDED = 1e9  # stands for an infinite robustness in records


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """One world under one stack, judged by named specifications."""

    world: World
    config: StackConfig
    specifications: tuple[str, ...] = default_specifications()
    early_stop: bool = False  #: end soon after the first violation
    scene: Any = None  #: Scenic's, for a world that cannot do without its program
    limits: StackLimits = StackLimits()  #: kept only where runs are guarded


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """A finished job with all that a record needs."""

    outcome: Outcome
    verdicts: tuple[Verdict, ...]  #: that the executed part decides
    margins: dict[str, float]  #: see :mod:`mrta_falsify.specs.objectives`
    descriptors: dict[str, float]  #: see :mod:`mrta_falsify.specs.descriptors`

    @property
    def failed(self) -> bool:
        """Whether a specification is violated."""
        return any(verdict.violated for verdict in self.verdicts)


def run_job(
    job: Job,
    *,
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
) -> Outcome:
    """Simulate and judge one job (see :func:`simulator_interface.simulate.simulate`).

    Within :func:`simulator_interface.guard.guarded` it runs in a copy of this process.
    """
    guard = current_guard()
    if guard is None or _has_window(job):
        return _run_job(job, keep_trace=keep_trace, on_progress=on_progress)
    run = functools.partial(_run_job, _portable(job), keep_trace=keep_trace)
    return _in_copy(guard, job, run, on_time=on_progress or (lambda time: None))


def _run_job(
    job: Job, *, keep_trace: bool, on_progress: Callable[[float], None] | None = None
) -> Outcome:
    return _run_episode(
        job,
        build_specifications(job.specifications),
        keep_trace=keep_trace,
        on_progress=on_progress,
    )


def _in_copy(
    guard: Guard,
    job: Job,
    run: Callable[[], T],
    *,
    on_time: Callable[[float], None] = lambda time: None,
) -> T:
    return guard.run(
        run,
        config=job.config,
        limits=job.limits,
        portable=not _needs_scene(job),
        on_time=on_time,
    )


def _has_window(job: Job) -> bool:
    return bool(job.config.engine.options.get("gui", False))


def _needs_scene(job: Job) -> bool:
    return bool(job.world.scripted) and job.scene is not None


def _portable(job: Job) -> Job:
    """Leave out Scenic's scene, which cannot be sent to another process, if it is not needed."""
    return job if _needs_scene(job) else dataclasses.replace(job, scene=None)


def run_first_tick(job: Job) -> None:
    """Simulate the first tick of a job, to find what only a frame can tell.

    Raises:
        InputError: a formula names a signal or a robot that the job does not have.
    """
    _run_episode(
        job,
        build_specifications(job.specifications),
        keep_trace=False,
        stop=lambda frame: "decided",
    )


def _run_episode(
    job: Job,
    specifications: tuple[Specification, ...],
    *,
    keep_trace: bool,
    on_progress: Callable[[float], None] | None = None,
    stop: Callable[[Frame], str] | None = None,
) -> Outcome:
    """Run our own loop, or Scenic's over the same loop for a scripted world."""
    episode = functools.partial(simulate, job.world, job.config)
    if _needs_scene(job):
        from simulator_interface.scenic_bridge.simulator import simulate_scene  # noqa: PLC0415 - Scenic

        episode = functools.partial(simulate_scene, job.scene, job.world, job.config)
    return episode(
        specifications=specifications,
        keep_trace=keep_trace,
        on_progress=on_progress,
        stop=stop,
    )


def judge(job: Job, *, keep_trace: bool = True) -> Judged:
    """Simulate one job for a search: margins and descriptors too, ended once it is decided.

    With ``early_stop`` the episode goes on for 3 s after its first violation, for the evidence.
    Verdicts that are violated by then are final, with their times; the others are not decided
    by the executed part and are left out. Within :func:`simulator_interface.guard.guarded` it
    runs in a copy of this process.
    """
    guard = current_guard()
    if guard is None or _has_window(job):
        return _judge(job, keep_trace=keep_trace)
    return _in_copy(guard, job, functools.partial(_judge, _portable(job), keep_trace=keep_trace))


def _judge(job: Job, *, keep_trace: bool) -> Judged:
    specifications = build_specifications(job.specifications)
    watch = _Watch(job, specifications)
    outcome = _run_episode(job, specifications, keep_trace=keep_trace, stop=watch.stop)
    verdicts = tuple(_bounded(verdict) for verdict in outcome.verdicts)
    margins = objectives(verdicts)
    if outcome.ended == "decided":
        verdicts = tuple(verdict for verdict in verdicts if verdict.violated)
    return Judged(
        outcome=outcome,
        verdicts=verdicts,
        margins=margins,
        descriptors=watch.descriptors.values(),
    )


class _Watch:
    """Looks at every frame; says when an episode may end."""

    def __init__(self, job: Job, specifications: tuple[Specification, ...]) -> None:
        dt = 1.0 / job.config.control_rate
        self.descriptors = Descriptors(job.world, dt)
        self._specifications = specifications if job.early_stop else ()
        self._stride = max(1, round(LOOK_EVERY / dt))
        self._decided = np.inf

    def stop(self, frame: Frame) -> str:
        self.descriptors.update(frame)
        sensed = frame.sensed
        if sensed.tick % self._stride == 0 and self._decided == np.inf:
            for specification in self._specifications:
                verdict = specification.verdict()
                if verdict.violated and verdict.violated_at is not None:
                    self._decided = min(self._decided, verdict.violated_at)
        return "decided" if sensed.time >= self._decided + SETTLE else ""


def _bounded(verdict: Verdict) -> Verdict:
    if abs(verdict.robustness) <= UNBOUNDED:
        return verdict
    limit = UNBOUNDED if verdict.robustness > 0.0 else -UNBOUNDED
    return dataclasses.replace(verdict, robustness=limit)


def quick_stack(config: StackConfig) -> StackConfig:
    """Put ``config`` on the kinematic engine."""
    return dataclasses.replace(config, engine=Choice("kinematic"))


def campaign_specifications() -> tuple[str, ...]:
    """List the specifications of a campaign unless the user says otherwise.

    All that score a run but ``human_clearance``: people who do not react to robots come
    nearer than its 0.1 m on their own, and a search would find nothing else.
    """
    return tuple(name for name in default_specifications() if name != "human_clearance")
