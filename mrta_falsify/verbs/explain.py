"""Why a failure happens: the same episode with one thing changed shortly before it.

The episode is run up to a few seconds before the onset (and, if no change helps there, only to
its first tick). From there copies of the whole process
go on, each with one layer replaced: by the shipped reference, or by another implementation if
it is the reference already. The copies share everything until the change, so what differs
afterwards is its doing. Of robots that wait for each other each is taken away in a copy of its
own at the onset, to see whom it holds up. Beside them the world is run with small differences, to
tell failures that any change would cure.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mrta_falsify.campaigns.attribution import suspected_layer, waited_for
from mrta_falsify.campaigns.signature import leading
from mrta_falsify.campaigns.store import Campaign, write_atomically
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.trial import Job, judge
from mrta_falsify.verbs.stored_trials import job_of
from reports.sentences import listed
from scenic_worlds.variation import jittered_worlds
from simulator_interface.continuation import Running, run_to

#: layers of the stack in the order in which they are asked; people and physics are not its own
SUSPECTS = (
    "queue_policy",
    "waypoint_generator",
    "planner",
    "costmap",
    "priority_rule",
    "controller",
    "allocator",
)
LEAD = 10.0  # s before the onset at which things are changed
AFTER = 45.0  # s after the violation that a changed episode must survive
GOES_ON = 1.0  # m from where it stood: a robot goes on
JITTERED = 20
#: alternatives that need an extra and take minutes for a stream: no use in a re-run
LEFT_OUT = frozenset(("smt", "tsp"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One thing that a copy of the episode does differently."""

    layer: str  #: that is replaced
    text: str  #: in words
    config: StackConfig
    restores: bool = False  #: the shipped layer comes back in place of another


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What a change did."""

    layer: str
    change: str
    failure_gone: bool
    detail: str = ""
    restores: bool = False  #: see :class:`Change`


@dataclass(frozen=True, slots=True, kw_only=True)
class Removal:
    """What became of the others when one of the robots that wait was taken away."""

    robot: str
    time: float  #: [s]
    go_on: tuple[str, ...] = ()
    stay: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """Why a failure happens, as far as re-runs can say."""

    layer: str  #: suspected
    guess: str  #: by rules on the trace alone
    reason: str  #: in words
    changed_at: float  #: [s]
    counterfactuals: tuple[Finding, ...]
    jittered: dict[str, int]  #: runs, failed
    runs: int  #: episodes or continuations simulated
    removals: tuple[Removal, ...] = ()  #: of each robot of a deadlock; none for other failures


def explain(
    campaign: Campaign,
    record: TrialRecord,
    *,
    max_runs: int = 40,
    on_done: Callable[[str], None] = lambda text: None,
) -> Explanation:
    """Explain a stored failure and keep the explanation beside it.

    Args:
        campaign: it belongs to.
        record: of the failure.
        max_runs: episodes and continuations at most; jittered copies give way first.
        on_done: called with a line about each finding.

    Raises:
        InputError: the trial did not fail, or its world is missing.
    """
    if not record.failed:
        raise InputError(f"trial {record.id} violates nothing; there is nothing to explain")
    job = job_of(campaign, record)
    found = explain_job(job, max_runs=max_runs, on_done=on_done)
    folder = campaign.folder(record)
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(codec.encode(found), indent=1) + "\n"
    write_atomically(folder / "explain.json", text.encode())
    return found


def explain_job(
    job: Job, *, max_runs: int = 40, on_done: Callable[[str], None] = lambda text: None
) -> Explanation:
    """Explain the failure of a job (see :func:`explain`)."""
    judged = judge(job)
    verdict = leading(judged.verdicts)
    if verdict is None:
        raise InputError("the run violates nothing; there is nothing to explain")
    trace = judged.outcome.trace
    guess = suspected_layer(judged.verdicts, trace)
    at = moment_of_change(verdict)
    changes = changes_of(job.config)[: max(1, max_runs - 1)]
    findings = tuple(_continue(job, verdict, at, changes, on_done))
    runs = 1 + len(findings)
    if at > 0.0 and not any(finding.failure_gone for finding in findings):
        # What was lost long before the onset is not mended by mending the layer that lost it.
        at = 0.0
        findings = tuple(_continue(job, verdict, at, changes, on_done))
        runs += len(findings)
    removals = tuple(_taken_away(job, verdict, trace, max_runs - runs, on_done))
    runs += len(removals) + bool(removals)
    left = max(0, min(JITTERED, max_runs - runs))
    jittered = _jittered(job, left)
    layer, reason = verdict_on(findings, guess)
    return Explanation(
        layer=layer,
        guess=guess,
        reason=reason,
        changed_at=at,
        counterfactuals=findings,
        removals=removals,
        jittered=jittered,
        runs=runs + jittered["runs"],
    )


def moment_of_change(verdict: Verdict) -> float:
    """When to change something: shortly before the onset if it is known, well before otherwise."""
    onset = verdict.evidence.get("onset")
    if isinstance(onset, float):
        return max(0.0, onset - LEAD)
    since = verdict.evidence.get("since", verdict.evidence.get("waiting_since"))
    if isinstance(since, float):
        return max(0.0, since - LEAD)
    if verdict.spec in ("deadlines", "all_tasks_done"):
        return 0.0  # whatever cost the time may be anywhere
    return max(0.0, (verdict.violated_at or 0.0) - LEAD)


def changes_of(config: StackConfig) -> list[Change]:
    """One change per layer: to the reference, or to the others if it is the reference."""
    reference = StackConfig()
    changes = []
    for layer in SUSPECTS:
        choice: Choice = getattr(config, layer)
        kept = tuple(name for name in config.defects if DEFECTS[name].layer != layer)
        ours: Choice = getattr(reference, layer)
        if choice != ours or kept != config.defects:
            text = f"{_spaced(layer)}: the shipped {ours.name} instead of the one under test"
            other: dict[str, Any] = {layer: ours}
            changed = dataclasses.replace(config, defects=kept, **other)
            changes.append(Change(layer=layer, text=text, config=changed, restores=True))
            continue
        for name in registry.names(layer):
            if name == choice.name or name in LEFT_OUT:
                continue
            other = {layer: Choice(name)}
            changed = dataclasses.replace(config, **other)
            text = f"{_spaced(layer)}: {name} instead of {choice.name}"
            changes.append(Change(layer=layer, text=text, config=changed))
    return changes


def _spaced(layer: str) -> str:
    return layer.replace("_", " ")


def verdict_on(findings: Sequence[Finding], guess: str) -> tuple[str, str]:
    """The suspected layer, and why.

    A single layer whose change removes the failure is it. Of several, those count that are not
    the shipped ones and were replaced by them: another implementation moves every robot
    otherwise, so that it may remove a failure by chance. Of these, the one that the trace points
    to; otherwise the first in the order of the pipeline, since what comes later acts on what it
    is given.
    """
    gone = [finding for finding in findings if finding.failure_gone]
    restored = [finding for finding in gone if finding.restores]
    cures = {finding.layer for finding in restored or gone}
    layers = [layer for layer in SUSPECTS if layer in cures]
    if restored and len(layers) == 1 and len({finding.layer for finding in gone}) > 1:
        return layers[0], "the shipped one in its place removes the failure"
    if not layers:
        return guess, "no single change removes the failure; named by what the trace shows"
    if len(layers) == 1:
        return layers[0], "changing it, and nothing else, removes the failure"
    named = ", ".join(_spaced(layer) for layer in layers)
    if guess in layers:
        return guess, f"changing any of {named} removes the failure; the trace points to this one"
    return layers[0], f"changing any of {named} removes the failure; this one acts first"


def _jittered(job: Job, count: int) -> dict[str, int]:
    runs = [
        judge(dataclasses.replace(job, world=world), keep_trace=False)
        for world in jittered_worlds(job.world, count)
    ]
    return {"runs": len(runs), "failed": sum(run.failed for run in runs)}


# --- continuations -------------------------------------------------------------------------


def _continue(
    job: Job,
    verdict: Verdict,
    at: float,
    changes: Sequence[Change],
    on_done: Callable[[str], None],
) -> Iterator[Finding]:
    """Run to ``at`` [s] once, and from there once per change."""
    until = (verdict.violated_at or job.world.horizon) + AFTER
    with run_to(job.world, job.config, job.specifications, at) as running:
        for change in changes:
            finding = running.in_a_copy(partial(_with, running, verdict, change, until), Finding)
            on_done(f"{'gone ' if finding.failure_gone else 'stays'}  {finding.change}")
            yield finding


def _with(running: Running, verdict: Verdict, change: Change, until: float) -> Finding:
    episode = running.episode
    episode.swap(change.config)
    own = [s for s in running.specifications if s.verdict().spec == verdict.spec]
    violated = False
    ended = "the time looked at was over"
    for frame in running.frames:
        for specification in own:
            specification.update(frame)
        time = frame.sensed.time
        if frame.sensed.tick % 10 == 0 and any(s.verdict().violated for s in own):
            violated = True
            ended = f"violated again at {time:.1f} s"
            break
        if episode.world.tasks and episode.all_done:
            ended = f"all tasks done at {time:.1f} s"
            break
        if time >= min(until, episode.world.horizon):
            ended = f"nothing violated until {time:.1f} s"
            break
    violated = violated or any(s.verdict().violated for s in own)
    return Finding(
        layer=change.layer,
        change=change.text,
        failure_gone=not violated,
        detail=ended,
        restores=change.restores,
    )


def _taken_away(
    job: Job, verdict: Verdict, trace: Trace, max_runs: int, on_done: Callable[[str], None]
) -> Iterator[Removal]:
    """Take each robot of a deadlock away at its onset, and each that one of them waits for.

    The run up to there counts as one of ``max_runs``, too.
    """
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    held = waited_for(verdict, trace)
    names = [name for name in numbers if name in held]
    onset = verdict.evidence.get("onset")
    if len(names) < 2 or not isinstance(onset, float):
        return
    with run_to(job.world, job.config, job.specifications, onset) as running:
        if not running.episode.can_remove:
            return
        for name in names[: max(0, max_runs - 1)]:
            others = {other: numbers[other] for other in names if other != name}
            run = partial(_without, running, name, numbers[name], others)
            removal = running.in_a_copy(run, Removal)
            on_done(removal_text(removal))
            yield removal


def _without(running: Running, name: str, robot: int, others: dict[str, int]) -> Removal:
    """Who of the others goes on without a robot."""
    start, time = running.last.sensed.pose, running.last.sensed.time
    running.episode.remove(robot)
    go_on: set[str] = set()
    for frame in running.frames:
        moved = np.linalg.norm((frame.sensed.pose - start)[:, :2], axis=1)
        go_on |= {other for other, i in others.items() if moved[i] >= GOES_ON}
        if len(go_on) == len(others) or frame.sensed.time >= time + AFTER:
            break
    return Removal(
        robot=name,
        time=time,
        go_on=tuple(other for other in others if other in go_on),
        stay=tuple(other for other in others if other not in go_on),
    )


def removal_text(removal: Removal) -> str:
    """A removal in words."""
    parts = []
    for names, one, many in (
        (removal.go_on, "goes on", "go on"),
        (removal.stay, "stays", "stay"),
    ):
        if names:
            parts.append(f"{listed(names)} {one if len(names) == 1 else many}")
    return f"without {removal.robot} from {removal.time:.1f} s on, {', '.join(parts)}"


def stored_explanation(folder: Path) -> Explanation | None:
    """What :func:`explain` has kept in a trial's folder, if anything."""
    path = folder / "explain.json"
    if not path.is_file():
        return None
    return codec.decode(Explanation, codec.read_json(path), where=str(path))
