"""A table of runs: the stack as it is, and with one layer exchanged, all judged like a trial.

All rows have the same copies of the world with small differences. In each copy the layer is
exchanged at the same moment, so that what differs afterwards is its doing. A run ends at the
horizon, or once the tasks concerned are delivered. It

- *fails* where the same specification is violated;
- fails *otherwise* where another one is that a search looks for first: it neither repeats the
  failure nor shows a cure;
- *avoids* the situation where the robots concerned never come to the place together: it proves
  nothing of what they would have done there;
- passes otherwise.

A layer is named where its row and no other one separates: the upper 90 % bound of its chance of
failure lies below the lower bound of every other row that comes to the situation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.analysis.explain.changes import Change
from mrta_falsify.analysis.explain.whole_runs import STACK_RUNS
from mrta_falsify.core.findings import LayerRow
from mrta_falsify.core.task_history import last_robots, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import is_kept, tick_of
from mrta_falsify.core.words import listed
from mrta_falsify.lab import Edit, Experiment, Lab, RunResult, Situation, Vote, experiment_of_job
from mrta_falsify.specs.attribution import WHOLE, WORLD
from mrta_falsify.specs.causes import is_outcome, is_shut, primary
from mrta_falsify.trial import Job
from simulator_interface.simulate import Outcome

RUNS = 6  # of each row, at least; as many more while that may tell a layer
MOST = 18  # of each row
NO_LAYER = "no single layer: "  #: what a reason that names none begins with
HARDLY_ANY = 0.25  # share of copies; a failure that no more of them repeat is a knife edge
NEAR = 1.5  # m by which the robots concerned may stand further from the place than they did


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """The violation that the rows are asked about."""

    verdict: Verdict
    found: float  #: when it was found [s]
    tasks: tuple[int, ...]  #: concerned: that are late, or that the robots it names had then
    situation: Situation | None  #: None: it is not one of robots at a place


def failure_of(job: Job, verdict: Verdict, outcome: Outcome) -> Failure:
    """Describe the failure of a job.

    Args:
        job: that fails.
        verdict: the violated one that explains the failure.
        outcome: of its run, with the trace.
    """
    numbers = {robot.name: i for i, robot in enumerate(job.world.robots)}
    robots = tuple(numbers[name] for name in verdict.who if name in numbers)
    tasks = tuple(tasks_of(verdict)) or _open_tasks(verdict, outcome.trace)
    return Failure(
        verdict=verdict,
        found=job.world.horizon if verdict.violated_at is None else verdict.violated_at,
        tasks=tasks,
        situation=None if is_outcome(verdict) else _situation(verdict, outcome.trace, robots),
    )


def _open_tasks(verdict: Verdict, trace: Trace) -> tuple[int, ...]:
    """Find the tasks that the robots of a violation had then."""
    until = np.inf if verdict.violated_at is None else verdict.violated_at
    done = {e.task for e in trace.events if e.kind == "dropped-off" and e.time <= until}
    had = {
        event.task: trace.robots[event.robot]
        for event in trace.events
        if event.kind == "assigned" and event.robot >= 0 and event.time <= until
    } or last_robots(trace)
    return tuple(sorted(t for t, robot in had.items() if robot in verdict.who and t not in done))


def _situation(verdict: Verdict, trace: Trace, robots: tuple[int, ...]) -> Situation | None:
    if not robots or not is_kept(trace):
        return None
    poses = np.asarray(trace.columns["pose"][tick_of(verdict, trace), list(robots), :2])
    place = poses.mean(axis=0)
    spread = float(np.hypot(*(poses - place).T).max())
    return Situation(robots=robots, place=(float(place[0]), float(place[1])), reach=spread + NEAR)


# --- the runs --------------------------------------------------------------------------------


def rows_of(
    job: Job,
    failure: Failure,
    at: float,
    changes: Sequence[Change],
    most: int,
    lab: Lab,
    *,
    reserve: int = 0,
) -> tuple[LayerRow, ...]:
    """Run the stack as it is, and with each change, in the same copies of the world.

    Rounds of six copies follow each other while the rows tell no layer that they may tell. The
    stack as it is goes first: at a knife edge no other row is run.

    Args:
        job: that fails.
        failure: its.
        at: when a layer is exchanged [s].
        changes: of one layer each.
        most: runs at most; the first round is run whole.
        reserve: runs of these to leave over as long as no row removes the failure.
        lab: that runs them.

    Returns:
        A row for each of them, first that of the stack as it is; no others where that one passes
        in the world itself, since the rule decides nothing then, or in nearly all of its copies.
    """
    own = lab.run(experiment_of(job, failure, at, None, 0))
    if fate_of(own, failure, since=at) != "fails":
        return (_row(None, at, (own,), failure),)
    queried = (None, *changes)
    results: list[list[RunResult]] = [[] for _ in queried]

    def run(which: range, begun: int) -> tuple[LayerRow, ...]:
        runs = [(k, 1 + begun + copy) for copy in range(RUNS) for k in which]
        experiments = [experiment_of(job, failure, at, queried[k], number) for k, number in runs]
        for (k, _), result in zip(runs, lab.map(experiments), strict=True):
            results[k].append(result)
        return tuple(
            _row(change, at, found, failure)
            for change, found in zip(queried, results, strict=True)
            if found
        )

    rows = run(range(1), 0)
    if is_knife_edge(rows[0]):
        return rows
    rows = run(range(1, len(queried)), 0)
    for begun in range(RUNS, MOST, RUNS):
        left = most - (0 if curing(rows) else reserve)
        if (begun + RUNS) * len(queried) > left or not _may_tell_more(rows):
            break
        rows = run(range(len(queried)), begun)
    return rows


def _may_tell_more(rows: Sequence[LayerRow]) -> bool:
    """Whether no layer is told yet, and one fails less often than the stack as it is."""
    if separating(rows) or is_knife_edge(rows[0]):
        return False
    return any(meets(row) and row.failed * rows[0].runs < row.runs * rows[0].failed for row in rows)


def experiment_of(
    job: Job, failure: Failure, at: float, change: Change | None, perturbation: int
) -> Experiment:
    """Describe one run of a row.

    Args:
        job: that fails.
        failure: its.
        at: when a layer is exchanged [s].
        change: None: the stack stays as it is.
        perturbation: number of the copy.
    """
    return dataclasses.replace(
        experiment_of_job(job).for_vote(),
        early_stop=not is_outcome(failure.verdict),
        until_delivered=failure.tasks,
        ends_late=failure.verdict.spec == "deadlines",
        perturbation=perturbation,
        edits=(Edit(at=at, stack=change.config if change is not None else None),),
        situation=failure.situation,
    )


def run_to_keep(
    failure: Failure, row: LayerRow, change: Change | None, job: Job, lab: Lab
) -> Experiment | None:
    """Choose a run that shows what a row says: it passes, and without a change it fails.

    Args:
        failure: that the rows are asked about.
        row: of which a run is wanted.
        change: of the row; None: the stack as it is.
        job: that fails.
        lab: that has run the row.

    Returns:
        None if no copy was run that does.
    """
    fate = "fails" if change is None else "passes"
    for number in range(1, MOST + 1):
        experiment = experiment_of(job, failure, row.at, change, number)
        known = lab.result_of(experiment)
        if known is not None and fate_of(known, failure, since=row.at) == fate:
            return experiment
    return None


def fate_of(result: RunResult, failure: Failure, *, since: float = 0.0, without: str = "") -> str:
    """Say what became of a failure in a run: fails, otherwise, avoids, passes, or unknown.

    Args:
        result: of the run.
        failure: that is looked for.
        since: when something was changed in it [s].
        without: robot that was taken away: it fails at nothing.
    """
    if result.status == "impossible" or result.sim_time < since:
        return "unknown"  # it ended before anything was changed
    if result.status == "error":
        return "otherwise"  # the change brought the stack down
    spec = failure.verdict.spec
    verdicts = [v for v in result.verdicts if not v.violated or v.who != (without,)]
    own = next((verdict for verdict in verdicts if verdict.spec == spec), None)
    if own is not None and own.violated and is_shut(own) == is_shut(failure.verdict):
        late = set(tasks_of(failure.verdict))
        if not is_outcome(own) or not late or late & set(tasks_of(own)):
            return "fails"
    others = (verdict for verdict in primary(verdicts) if verdict.spec != spec)
    if not all(map(is_outcome, others)):
        return "otherwise"
    if own is not None and own.not_judged:
        return "unknown"
    if failure.situation is not None and result.met is None:
        return "avoids"
    return "passes"


def _row(
    change: Change | None, at: float, results: Sequence[RunResult], failure: Failure
) -> LayerRow:
    fates = [fate_of(result, failure, since=at) for result in results]
    return LayerRow(
        layer=change.layer if change is not None else "",
        change=change.text if change is not None else "the stack as it is",
        at=at,
        runs=fates.count("fails") + fates.count("passes"),
        failed=fates.count("fails"),
        otherwise=fates.count("otherwise"),
        avoided=fates.count("avoids"),
        unknown=fates.count("unknown"),
        restores=change is not None and change.restores,
    )


# --- what they say -----------------------------------------------------------------------------


def vote_of(row: LayerRow) -> Vote:
    """Count the runs of a row that came to the situation."""
    return Vote(runs=row.runs, failed=row.failed, undecided=row.otherwise + row.unknown)


def is_knife_edge(stack: LayerRow) -> bool:
    """Whether hardly any copy repeats the failure of the stack as it is."""
    return stack.failed <= HARDLY_ANY * stack.copies


def meets(row: LayerRow) -> bool:
    """Whether most runs of a row come to the situation."""
    return 2 * row.avoided < row.copies


def separating(rows: Sequence[LayerRow]) -> tuple[str, ...]:
    """List the layers a row of which separates from all rows of other layers.

    A row that still fails now and then does not where another one never fails and avoids the
    situation: that may be the better answer.

    Args:
        rows: the stack as it is, first, then one or more of each layer.
    """
    queried = [row for row in rows if meets(row)]
    found = []
    for row in queried:
        others = [other for other in queried if other.layer != row.layer]
        high = vote_of(row).bounds[1]
        avoid = (r for r in rows if r.layer != row.layer and not meets(r) and not r.failed)
        if row.failed and any(avoid):
            continue
        if row.layer and all(high < vote_of(other).bounds[0] for other in others):
            found.append(row.layer)
    return tuple(dict.fromkeys(found))


def curing(rows: Sequence[LayerRow]) -> tuple[LayerRow, ...]:
    """List the rows that separate from the stack as it is, whatever the others do."""
    low = vote_of(rows[0]).bounds[0]
    return tuple(row for row in rows[1:] if meets(row) and vote_of(row).bounds[1] < low)


class Suspicion(NamedTuple):
    """A layer that the rows name, and why; empty: they name none."""

    layer: str
    reason: str


def suspicion_from(
    rows: Sequence[LayerRow], verdict: Verdict, guess: str, untried: Sequence[str] = ()
) -> Suspicion:
    """Say which layer the rows name.

    Args:
        rows: the stack as it is, first; all exchanged at the same moment.
        verdict: the violated one that explains the failure.
        guess: of the trace alone.
        untried: layers that no run was left for, from the start; a row is not told from theirs.
    """
    if guess == WORLD:
        return Suspicion(WORLD, "the world shut a place during the run, no layer of the stack did")
    if verdict.spec == STACK_RUNS and guess and guess != WHOLE:
        return Suspicion(guess, "its code failed")
    if not rows:
        return Suspicion("", f"{NO_LAYER}no layer can be exchanged")
    stack = rows[0]
    if len(rows) == 1 and stack.copies == 1:
        return Suspicion(
            "",
            f"{NO_LAYER}run again by the same rule, the stack as it is "
            f"{'fails' if stack.failed else 'does not fail'}, so no row was run",
        )
    if is_knife_edge(stack):
        return Suspicion("", f"{NO_LAYER}a knife edge, {told(stack)}")
    if guess == WHOLE:
        return Suspicion(WHOLE, _of_whole(rows))
    if untried:
        few = f"{_listed(untried)} not exchanged from the start (--max-runs)"
        return Suspicion("", f"{NO_LAYER}{'; '.join(map(told, rows))}; {few}")
    names = separating(rows)
    if len(names) == 1:
        own = [row for row in curing(rows) if row.layer == names[0]]
        return Suspicion(names[0], f"{told(stack)}; {'; '.join(map(told, own))}")
    if names:
        any_of = f"{NO_LAYER}exchanging any of {_listed(names)} removes it"
        return Suspicion("", any_of + _not_as_shipped(curing(rows)))
    cures = curing(rows)
    if cures:
        which = _listed(tuple(dict.fromkeys(row.layer for row in cures)))
        does = "makes it rarer" if any(row.failed for row in cures) else "removes it"
        return Suspicion(
            "",
            f"{NO_LAYER}exchanging {which} {does}, and no row separates from all others"
            f"{_not_as_shipped(cures)}",
        )
    return Suspicion("", f"{NO_LAYER}{told(stack)}, and no exchange removes it")


def _not_as_shipped(cures: Sequence[LayerRow]) -> str:
    """Say which of several layers that may be exchanged is another one than the shipped."""
    others = tuple(dict.fromkeys(row.layer for row in cures if row.restores))
    if not others or len({row.layer for row in cures}) == 1:
        return ""
    return f"; of these, {_listed(others)} {'is' if len(others) == 1 else 'are'} not as shipped"


def _of_whole(rows: Sequence[LayerRow]) -> str:
    """Say what a stack without known layers has to do with a failure."""
    return "; ".join(map(told, rows))


def told(row: LayerRow) -> str:
    """Put a row in words, with its counts."""
    low, high = vote_of(row).bounds
    bounds = f"fails in {row.failed} of {row.runs} runs (90 % bounds {low:.2f} and {high:.2f})"
    parts = [part for part in (bounds if row.runs else "", row.beside) if part]
    return f"{row.change}: {', '.join(parts)}"


def _listed(layers: Sequence[str]) -> str:
    return listed([layer.replace("_", " ") for layer in layers])
