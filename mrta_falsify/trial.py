"""One world under one stack: simulate it and judge it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from mrta_falsify.campaigns.rules import RULES
from mrta_falsify.core.config import Choice, StackConfig, apply_setting
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.protocols import Comparing, Costs, Specification
from mrta_falsify.core.run_result import Rank
from mrta_falsify.core.spec_profile import profile_of
from mrta_falsify.core.stack_failure import StackLimits
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World
from mrta_falsify.specs.causes import kind_of, primary, secondary
from mrta_falsify.specs.costly import CostMeter
from mrta_falsify.specs.descriptors import Descriptors
from mrta_falsify.specs.library import (
    build_specifications,
    default_specifications,
    spec_names,
)
from mrta_falsify.specs.objectives import objectives
from simulator_interface.external.transcript import Transcript
from simulator_interface.guard import Guard, current_guard
from simulator_interface.simulate import Outcome, simulate

T = TypeVar("T")

SETTLE = 3.0  # s of simulation kept after the violation that decides a run
LOOK_EVERY = 0.5  # s between two looks at whether a run is decided
NO_COSTS = Costs(way=(), time=0.0, calls=0, undelivered=0)
REFERENCES_KEPT = 8  # worlds; copies of one world follow each other
UNBOUNDED = 1e9  # stands for an infinite robustness in records


#: costs by the digests of world and reference; only saves runs
_references: dict[tuple[str, str], Costs] = {}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """One world under one stack, judged by named specifications."""

    world: World
    config: StackConfig
    specifications: tuple[str, ...] = default_specifications()
    early_stop: bool = False  #: end soon after the first violation
    then: tuple[str, ...] = ()  #: specifications whose violation ends no run early, as a shut place
    scene: Any = None  #: Scenic's, for a world that cannot do without its program
    limits: StackLimits = StackLimits()  #: kept only where runs are guarded
    transcript: Transcript | None = None  #: what a foreign stack has said; it is not asked
    reference: Costs | None = None  #: to compare with; None: of a run of the reference stack
    rules: int = RULES  #: in whose form its failures are compared, see :mod:`.campaigns.rules`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """A finished job with all that a record needs."""

    outcome: Outcome
    verdicts: tuple[Verdict, ...]  #: that the executed part decides
    margins: dict[str, float]  #: see :mod:`mrta_falsify.specs.objectives`
    descriptors: dict[str, float]  #: see :mod:`mrta_falsify.specs.descriptors`
    situations: tuple[str, ...] = ()  #: see :mod:`mrta_falsify.specs.descriptors`
    involved: tuple[str, ...] = ()  #: objects that took part when it was nearest to a deadlock
    then: tuple[str, ...] = ()  #: secondary specifications

    @property
    def failed(self) -> bool:
        """Whether a specification is violated."""
        return any(verdict.violated for verdict in self.verdicts)

    @property
    def is_primary(self) -> bool:
        """Whether a primary specification is violated."""
        return bool(primary(self.verdicts, self.then))

    @property
    def rank(self) -> Rank:
        """What its failure counts for."""
        if not self.failed:
            return "none"
        return "primary" if self.is_primary else "secondary"

    @property
    def status(self) -> Literal["judged", "not_judged"]:
        """Not judged if nothing is violated, and a specification could not be judged."""
        unjudged = not self.failed and any(verdict.not_judged for verdict in self.verdicts)
        return "not_judged" if unjudged else "judged"

    @property
    def is_shut(self) -> bool:
        """Whether it fails only because the world shut a place during the run."""
        return not self.is_primary and kind_of(self.verdicts) == "shut"

    @property
    def secondary(self) -> frozenset[str]:
        """Specifications whose violation a search does not look for first."""
        return secondary(self.verdicts, self.then)


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
    return _run_episode(job, judges_of(job), keep_trace=keep_trace, on_progress=on_progress)


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
        InputError: a formula names a signal or a robot that the job does not have, or none of
            the job's specifications can be judged.
    """
    specifications = build_specifications(job.specifications)
    for specification in specifications:
        if isinstance(specification, Comparing):  # a tick needs no run of the reference
            specification.compare_with(NO_COSTS)
    outcome = _run_episode(job, specifications, keep_trace=False, stop=lambda frame: "decided")
    refuse_unjudgeable(outcome.verdicts)


def refuse_unjudgeable(verdicts: Sequence[Verdict]) -> None:
    """Refuse a job of which nothing can be judged.

    Args:
        verdicts: of all its specifications.

    Raises:
        ConfigError: none was judged; the message says what was missing.
    """
    if not verdicts or any(not verdict.not_judged for verdict in verdicts):
        return
    reasons = dict.fromkeys(f"{verdict.spec}: {verdict.not_judged}" for verdict in verdicts)
    raise ConfigError(f"none of the specifications can be judged; {'; '.join(reasons)}")


# --- a reference to compare with -----------------------------------------------------------


def judges_of(job: Job) -> tuple[Specification, ...]:
    """Build a job's specifications; those that compare get the costs of their reference."""
    specifications = build_specifications(job.specifications)
    for specification in specifications:
        if isinstance(specification, Comparing):
            known = job.reference
            specification.compare_with(known or _reference_costs(job, specification.reference))
    return specifications


def _reference_costs(job: Job, changes: Sequence[str]) -> Costs:
    """Run the reference stack in a job's world, once for each world.

    The reference is the default stack with ``changes``, on the job's engine, with its people
    and control rate.
    """
    config = StackConfig(
        engine=_without_window(job.config.engine),
        human_model=job.config.human_model,
        control_rate=job.config.control_rate,
    )
    for change in changes:
        config = apply_setting(config, change)
    key = (job.world.digest(), config.digest())
    if key not in _references:
        meter = _Metering()
        job = dataclasses.replace(job, config=config, transcript=None)
        _run_episode(job, (meter,), keep_trace=False)
        while len(_references) >= REFERENCES_KEPT:
            _references.pop(next(iter(_references)))
        _references[key] = meter.costs()
    return _references[key]


def _without_window(engine: Choice) -> Choice:
    options = {name: value for name, value in engine.options.items() if name != "gui"}
    return Choice(engine.name, options)


class _Metering:
    """A specification that only adds up costs."""

    def start(self, world: World, dt: float) -> None:
        del dt
        self._meter = CostMeter(world)

    def update(self, frame: Frame) -> None:
        self._meter.update(frame)

    def costs(self) -> Costs:
        return self._meter.costs()

    def verdict(self) -> Verdict:
        return unjudged("costs", "they are only added up")


# --- running ------------------------------------------------------------------------------


def _run_episode(
    job: Job,
    specifications: tuple[Specification, ...],
    *,
    keep_trace: bool,
    on_progress: Callable[[float], None] | None = None,
    stop: Callable[[Frame], str] | None = None,
) -> Outcome:
    """Run our own loop, or Scenic's over the same loop for a scripted world."""
    episode = functools.partial(simulate, job.world, job.config, transcript=job.transcript)
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
    Verdicts that are violated by then are final, with their times. So is that something is not
    judged. The others are not decided by the executed part and are left out. Within
    :func:`simulator_interface.guard.guarded` the episode runs in a copy of this process.
    """
    guard = current_guard()
    if guard is None or _has_window(job):
        return _judge(job, keep_trace=keep_trace)
    return _in_copy(guard, job, functools.partial(_judge, _portable(job), keep_trace=keep_trace))


def _judge(job: Job, *, keep_trace: bool) -> Judged:
    specifications = judges_of(job)
    watch = TrialWatch(job, specifications)
    outcome = _run_episode(job, specifications, keep_trace=keep_trace, stop=watch.stop)
    return summed_up(outcome, watch)


def summed_up(outcome: Outcome, watch: TrialWatch) -> Judged:
    """Sum up a run that ``watch`` has seen and may have ended."""
    verdicts = tuple(_bounded(verdict) for verdict in outcome.verdicts)
    margins = objectives(verdicts)
    if outcome.ended == "decided":
        verdicts = tuple(v for v in verdicts if v.violated or v.not_judged)
    return Judged(
        outcome=outcome,
        verdicts=verdicts,
        margins=margins,
        descriptors=watch.descriptors.values(),
        situations=watch.descriptors.situations(),
        involved=watch.descriptors.involved(),
        then=watch.then,
    )


class TrialWatch:
    """Looks at every frame; says when an episode may end.

    Args:
        job: whether it ends early, and in which world.
        specifications: that judge it, the objects that are updated.
    """

    def __init__(self, job: Job, specifications: tuple[Specification, ...]) -> None:
        dt = 1.0 / job.config.control_rate
        self.descriptors = Descriptors(job.world, dt)
        self.then = job.then
        self._specifications = specifications if job.early_stop else ()
        self._stride = max(1, round(LOOK_EVERY / dt))
        self._decided = np.inf

    def stop(self, frame: Frame) -> str:
        """Take in a tick; give the reason to end here, empty: there is none."""
        self.descriptors.update(frame)
        sensed = frame.sensed
        if sensed.tick % self._stride == 0:
            verdicts = [specification.verdict() for specification in self._specifications]
            found = (verdict.violated_at for verdict in primary(verdicts, self.then))
            # looked at anew each time: a claim that the run refutes is withdrawn
            self._decided = min((time for time in found if time is not None), default=np.inf)
        return "decided" if sensed.time >= self._decided + SETTLE else ""


def _bounded(verdict: Verdict) -> Verdict:
    if abs(verdict.robustness) <= UNBOUNDED:
        return verdict
    limit = UNBOUNDED if verdict.robustness > 0.0 else -UNBOUNDED
    return dataclasses.replace(verdict, robustness=limit)


def on_kinematic_engine(config: StackConfig) -> StackConfig:
    """Put ``config`` on the kinematic engine."""
    return dataclasses.replace(config, engine=Choice("kinematic"))


def campaign_specifications(config: StackConfig | None = None) -> tuple[str, ...]:
    """List the specifications of a campaign unless the user says otherwise.

    All that score a run but ``human_clearance``: people who do not react to robots come
    nearer than its 0.1 m on their own, and a search would find nothing else. The same goes for
    ``repeatable`` of a foreign stack, where noise is usual: each failure is run
    again instead.

    Args:
        config: the stack under test; None: the default one.
    """
    left_out = {"human_clearance"}
    if config is not None and config.stack is not None:
        left_out.add("repeatable")
    return tuple(name for name in default_specifications() if name not in left_out)


def late_or_undone() -> tuple[str, ...]:
    """List the usual specifications that say only that work was late or undone, lateness first."""
    outcomes = [name for name in default_specifications() if profile_of(name).role == "outcome"]
    return tuple(sorted(outcomes, key=lambda name: profile_of(name).tie))


def primary_and_secondary(
    specs: str | Sequence[str] = (),
    then: str | Sequence[str] = (),
    config: StackConfig | None = None,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Put the specifications of a campaign in order.

    Args:
        specs: that the user names; those of campaigns if empty.
        then: that the user wants to be secondary. Without either these are the ones that say
            only that work was late or undone: they drown deadlocks, which people look for.
        config: the stack under test; None: the default one.

    Returns:
        All that judge a trial, and the secondary ones of them.

    Raises:
        ConfigError: no primary specification is left.
    """
    named, last = spec_names(specs), spec_names(then)
    if not named and not last:
        last = late_or_undone()
    first = tuple(name for name in named or campaign_specifications(config) if name not in last)
    if not first:
        raise ConfigError(
            f"--secondary-spec {', '.join(last)}: is all that is judged; name by --spec what comes "
            "first"
        )
    return first + last, last
