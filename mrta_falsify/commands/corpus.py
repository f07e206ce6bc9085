"""All stored failures on a changed stack: fixed, still failing, flaky, timed out or not judged."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import get_args

from mrta_falsify.campaigns.rules import signed
from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.campaigns.store import Campaign, StoreError
from mrta_falsify.commands.folders import Place, make_directory
from mrta_falsify.commands.stacks import Stack, load_stack
from mrta_falsify.commands.trust import Trust, open_to_run, permit_rechecks
from mrta_falsify.commands.workers import count_cores
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.findings import Recheck, RecheckFate
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.lab import Experiment, Lab, RunResult, certain, experiment_of_trial
from mrta_falsify.lab.running import has_place
from mrta_falsify.lab.stored import stored_world
from mrta_falsify.specs.causes import kind_of, leading
from reports.sentences import violation_sentence

JOURNAL_NAME = "corpus.journal.jsonl"  # in the campaign, until all rows are finished


# --- the command -----------------------------------------------------------------------------


def recheck_corpus(
    directory: Place,
    *,
    stack: Stack | None = None,
    settings: Sequence[str] = (),
    jittered: int = 2,
    workers: int | None = None,
    time_limit: float | None = None,
    only: Sequence[str] = (),
    pictures: Place | None = None,
    run: bool = False,
    trust: Trust = False,
    on_done: Callable[[Recheck], None] = lambda row: None,
) -> tuple[Recheck, ...]:
    """Run all stored failures of a campaign on a changed stack.

    Each is fixed, still failing, flaky (only copies with small differences fail) or a timeout.
    The recorded engine is kept unless the stack file or a setting names one.

    Args:
        directory: of the campaign.
        stack: the changed stack, or its YAML file; the campaign's own if None.
        settings: ``--set`` texts applied to the stack.
        jittered: copies with small differences that are run of each failure.
        workers: processes; one per core if None.
        time_limit: what one run may work and sleep [s]; the campaign's own limit if None.
        only: ids of the failures to run; all if empty.
        pictures: directory for a picture of each run that fails; none are drawn if None.
        run: sample worlds anew that were not kept.
        trust: run what is not ours, though somebody else has made the campaign.
        on_done: called with each row.

    Raises:
        InputError: not a campaign, an unknown layer, or a trial that did not fail.
    """
    campaign = open_to_run(directory, trust)
    config = load_stack(stack, settings) if stack is not None or settings else None
    named = StackConfig() if config is not None else None
    if config is not None and named is not None and keeps_engine(stack, settings):
        config = on_recorded_engine(campaign, config)
        named = on_recorded_engine(campaign, named)
    chosen = failures_named(campaign, only)
    permit_rechecks(campaign, named, trust, only=chosen, run=run)
    return recheck(
        campaign,
        config=config,
        jittered=jittered,
        workers=count_cores(workers),
        time_limit=time_limit,
        only=chosen,
        pictures=make_directory(Path(pictures)) if pictures is not None else None,
        on_done=on_done,
    )


def failures_named(campaign: Campaign, names: Sequence[str]) -> tuple[str, ...]:
    """Find the ids of failures by what a user calls them, as ``0042`` or ``42``.

    Raises:
        InputError: no such trial, or it did not fail.
    """
    found = [campaign.record(name) for name in names]
    for record in found:
        if not record.failed:
            raise StoreError(f"trial {record.id} of {campaign.directory} violates nothing")
    return tuple(record.id for record in found)


def keeps_engine(stack: Stack | None, settings: Sequence[str] = ()) -> bool:
    """Say whether a changed stack leaves the engine to the campaign that it is run on.

    A stack given as a value names an engine; a file or ``--set`` text may.
    """
    path = Path(stack) if isinstance(stack, str | Path) else None
    is_value = stack is not None and path is None
    return not is_value and not names_engine(path, settings)


# --- the changed stack ---------------------------------------------------------------------


def names_engine(path: Path | None, settings: Sequence[str]) -> bool:
    """Whether a stack file or a ``--set`` text names an engine.

    Args:
        path: of the YAML file, if one was given.
        settings: ``--set`` texts.
    """
    data = codec.read_yaml(path) if path is not None else None
    layers = [text.partition("=")[0].strip().partition(".")[0] for text in settings]
    return "engine" in layers or (isinstance(data, dict) and "engine" in data)


def on_recorded_engine(campaign: Campaign, config: StackConfig) -> StackConfig:
    """Put a changed stack on the engine that the campaign ran on."""
    return dataclasses.replace(config, engine=campaign.settings.trials.stack.engine)


# --- all failures --------------------------------------------------------------------------


def recheck(
    campaign: Campaign,
    *,
    config: StackConfig | None = None,
    jittered: int = 2,
    workers: int = 1,
    time_limit: float | None = None,
    only: Collection[str] = (),
    pictures: Path | None = None,
    on_done: Callable[[Recheck], None] = lambda row: None,
) -> tuple[Recheck, ...]:
    """Run all stored failures again.

    Args:
        campaign: whose failures.
        config: the changed stack; the campaign's own if None.
        jittered: copies of each world with small differences (see ``perturb_world``).
        workers: processes at a time; they change no result.
        time_limit: what one run may work and sleep [s]; the campaign's own limit if None.
        only: ids of the failures to run; all if empty.
        pictures: directory for a picture of each run that fails; none are drawn if None.
        on_done: called after each failure, in the order of the trials.

    Returns:
        One row per failure, in the order of the trials.

    Raises:
        InputError: a stored world is missing or damaged.
        HarnessError: a run crashed.
        Interrupted: Ctrl-C; finished runs are kept for the next call.
    """
    failures = [r for r in campaign.records if r.failed and (not only or r.id in only)]
    lab = Lab(
        campaign.directory / JOURNAL_NAME,
        what=f"corpus of {len(failures)} failures",
        workers=workers,
        time_limit=time_limit or campaign.settings.time_limit,
    )
    rows = []
    with lab:
        wanted = [
            list(_experiments(campaign, record, config, jittered, pictures)) for record in failures
        ]
        results = map(certain_or_late, lab.map(itertools.chain.from_iterable(wanted)))
        for record, experiments in zip(failures, wanted, strict=True):
            runs = list(itertools.islice(results, len(experiments)))
            rows.append(_row(record, runs[0], runs[1:], campaign.settings.rules))
            on_done(rows[-1])
    lab.journal.discard()
    return tuple(rows)


def _experiments(
    campaign: Campaign,
    record: TrialRecord,
    config: StackConfig | None,
    jittered: int,
    pictures: Path | None,
) -> Iterator[Experiment]:
    """Yield the runs of a stored failure: its world, then copies with small differences.

    Copies that have no place for their robots are left out. A changed stack is judged on its own
    engine, whatever found the failure.
    """
    trials = campaign.settings.trials
    if config is not None:
        trials = dataclasses.replace(trials, stack=config)
    world = stored_world(campaign, record)
    own = experiment_of_trial(trials, world, trials.stack, record.candidate)
    for number in range(1 + jittered):
        copy = f".copy{number - 1}" if number else ""
        name = f"{record.id}{copy}.png"
        one = dataclasses.replace(
            own,
            perturbation=number,
            picture=str(pictures.resolve() / name) if pictures is not None else "",
        )
        if not number or has_place(one):
            yield one


def certain_or_late(result: RunResult) -> RunResult:
    """Give the result of a run that must have been run, or was killed at its time limit.

    Raises:
        InputError: the world, or the stack in it, cannot be run.
        HarnessError: the toolkit failed.
    """
    return result if result.status == "timeout" else certain(result)


def counts_by_fate(rows: Sequence[Recheck]) -> dict[RecheckFate, int]:
    """Count rows by what became of them."""
    fates: tuple[RecheckFate, ...] = get_args(RecheckFate)
    return {fate: sum(row.fate == fate for row in rows) for fate in fates}


def _row(
    record: TrialRecord, stored: RunResult, perturbed: Sequence[RunResult], rules: int
) -> Recheck:
    """Judge a failure by the runs of its world and of its copies, in the form of its rules."""
    copies = [run for run in perturbed if run.status in ("judged", "not_judged")]
    told = next((run for run in (stored, *copies) if run.violated), stored)
    first = leading(told.verdicts)
    failures = sum(bool(run.violated) for run in copies)
    return Recheck(
        id=record.id,
        fate=_fate(record, stored, perturbed),
        # recomputed: another version may have written the stored one in other words
        signature=signed(record.verdicts, rules),
        violated=stored.violated,
        signature_now=signed(stored.verdicts, rules),
        jittered_failures=failures,
        jittered=len(copies),
        sentence=violation_sentence(first) if first is not None else "",
        copy_signatures=tuple(signed(run.verdicts, rules) for run in copies if run.violated),
        picture=told.picture,
        kind_now=kind_of(stored.verdicts),
        forms_now=(signature(stored.verdicts), signature_before(stored.verdicts)),
    )


def _fate(record: TrialRecord, stored: RunResult, perturbed: Sequence[RunResult]) -> RecheckFate:
    if stored.violated:
        return "still failing"
    if any(run.violated for run in perturbed):
        return "flaky"
    if any(run.status == "timeout" for run in (stored, *perturbed)):
        return "timeout"
    return "not judged" if _violated(record) & not_judged(stored) else "fixed"


def _violated(record: TrialRecord) -> set[str]:
    return {verdict.spec for verdict in record.verdicts if verdict.violated}


def not_judged(result: RunResult) -> frozenset[str]:
    """Name the specifications that a stack tells too little for."""
    return frozenset(verdict.spec for verdict in result.verdicts if verdict.not_judged)
