"""Stored trials: list them, show one, get its world back."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.campaigns.settings import COMPARISON_RUNS
from mrta_falsify.campaigns.statistics import chance_in_vote
from mrta_falsify.campaigns.store import Campaign, StoreError, read_campaign, read_trial
from mrta_falsify.campaigns.trial_index import TrialRow, explained_rows, read_index
from mrta_falsify.commands.folders import Place
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.findings import Explanation
from mrta_falsify.core.probability import interval_text
from mrta_falsify.core.record import OtherRun, TrialRecord
from mrta_falsify.core.run_result import Vote
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import WaitAccount, wait_account
from mrta_falsify.core.words import listed
from mrta_falsify.core.world import World, read_world
from mrta_falsify.lab.stored import kept_trace
from mrta_falsify.specs.causes import by_cause, kind_of, leading
from reports.sentences import (
    account_sentences,
    consequence_sentence,
    violation_sentence,
    who_text,
)


def open_campaign(directory: Place) -> Campaign:
    """Open a campaign directory for reading.

    Raises:
        StoreError: it is not one.
    """
    return read_campaign(Path(directory))


def list_trials(directory: Place, failed: bool = False) -> tuple[TrialRow, ...]:
    """List the trials of a campaign, one row each.

    Args:
        directory: of the campaign.
        failed: only trials that violate a specification.

    Raises:
        StoreError: not a campaign.
    """
    index = read_index(Path(directory))
    if index is None:
        return trial_rows(open_campaign(directory), failed)
    return tuple(row for row in explained_rows(Path(directory), index) if row.failed or not failed)


def trial_rows(campaign: Campaign, failed: bool = False) -> tuple[TrialRow, ...]:
    """List the trials of a campaign that is read already, as :func:`list_trials`."""
    return tuple(
        row_of(record, layer_of(campaign, record))
        for record in campaign.records
        if record.failed or not failed
    )


def row_of(record: TrialRecord, layer: str) -> TrialRow:
    """Tell a record in one line.

    Args:
        record: of a trial.
        layer: suspected.
    """
    verdict = leading(record.verdicts)
    theirs = record.other.jittered if record.other else None
    return TrialRow(
        id=record.id,
        status=record.status,
        score=record.score,
        signature=record.signature,
        failed=record.failed,
        jittered=record.vote.runs if record.vote else 0,
        jittered_failures=record.vote.failed if record.vote else 0,
        violated=tuple(verdict.spec for verdict in record.verdicts if verdict.violated),
        headline=violation_sentence(verdict) if verdict is not None else "",
        who=who_text(verdict) if verdict is not None else "",
        layer=layer,
        engine=record.engine,
        sim_time_s=record.sim_time,
        wall_s=record.wall_s,
        attempts=record.origin.attempts,
        world_digest=record.world_digest,
        trace_digest=record.trace_digest,
        error=record.error,
        not_judged=tuple(verdict.spec for verdict in record.verdicts if verdict.not_judged),
        other_engines=record.confirmation,
        repeats=record.repeats.runs if record.repeats else 0,
        repeats_failed=record.repeats.same.failures if record.repeats else 0,
        other=record.other.fate if record.other else "",
        other_jittered=theirs.runs if theirs else 0,
        other_jittered_failures=theirs.failed if theirs else 0,
        kind=kind_of(record.verdicts),
    )


def compared_sentences(
    jittered: Vote | None, other: OtherRun | None, most: int = COMPARISON_RUNS
) -> tuple[str, ...]:
    """Say what the other stack does in the world of a failure, and what copies say of both.

    Args:
        jittered: copies under the stack under test.
        other: the other stack's run and copies; None: there is none, and nothing is said.
        most: copies at most.
    """
    if other is None:
        return ()
    parts = [str(other)]
    if jittered is not None:
        parts.append(f"of the perturbed runs this stack fails {_chance_text(jittered, most)}")
        if other.jittered is not None:
            parts[-1] += f", the other one {_chance_text(other.jittered, most)}"
    if other.passes:
        is_borne_out = jittered is not None and jittered.robust and other.passes_most
        parts.append(f"perturbed runs {'confirm' if is_borne_out else 'do not confirm'} it")
    return tuple(parts)


def _chance_text(copies: Vote, most: int) -> str:
    chance = chance_in_vote(copies, most)
    return (
        f"{copies.failed} of {copies.runs} ({interval_text(chance.low, chance.high, chance.level)})"
    )


def layer_of(campaign: Campaign, record: TrialRecord) -> str:
    """Name the suspected layer: by ``explain`` if it was run, else by rules on the trace.

    Empty where these, or the runs of ``explain``, name none.
    """
    explained = _explanation(campaign, record) if record.failed else None
    return record.layer if explained is None else explained.layer


def explained_reason(campaign: Campaign, record: TrialRecord) -> str:
    """Say why ``explain`` named a layer or none; empty if it was not run."""
    explained = _explanation(campaign, record)
    return "" if explained is None else explained.reason


def _explanation(campaign: Campaign, record: TrialRecord) -> Explanation | None:
    """Read what ``explain`` found; None: it was not run, or `report` says what is wrong with it."""
    with contextlib.suppress(InputError):  # a damaged file
        return read_finding(campaign.folder(record), Explanation)
    return None


def account_of(campaign: Campaign, record: TrialRecord) -> WaitAccount | None:
    """Tell who waits for whom in a stored failure, None if nothing is violated.

    Evidence of older versions is completed from the trace, if that was kept and can be read.
    """
    verdict = leading(record.verdicts)
    if verdict is None:
        return None
    if record.trace_file:
        with contextlib.suppress(InputError):
            return wait_account(verdict, kept_trace(campaign, record))
    return wait_account(verdict)


def what_happened(campaign: Campaign, record: TrialRecord) -> tuple[str, ...]:
    """Tell a stored failure in sentences: what came first, who waits for whom, what followed."""
    account = account_of(campaign, record)
    return () if account is None else failure_sentences(record.verdicts, account)


def failure_sentences(verdicts: Sequence[Verdict], account: WaitAccount) -> tuple[str, ...]:
    """Tell a failing run in sentences, as :func:`what_happened` does.

    Args:
        verdicts: of the run; at least one is violated.
        account: of who waited for whom in it.
    """
    first, *others = (verdict for verdict in by_cause(verdicts) if verdict.violated)
    followed = [consequence_sentence(verdict, first) for verdict in others]
    return (violation_sentence(first), *account_sentences(account), *followed)


def show_trial(directory: Place, id: str | int) -> TrialRecord:
    """Look at one trial: verdicts, evidence, digests.

    Args:
        directory: of the campaign.
        id: of the trial, as ``"0042"``, ``"42"`` or 42.

    Raises:
        StoreError: not a campaign, or no such trial.
    """
    return read_trial(Path(directory), id).record(id)


def of_other_stack(campaign: Campaign, record: TrialRecord) -> tuple[Campaign, TrialRecord]:
    """Give the run of the other stack in a trial's world, as a trial of a campaign on that stack.

    Raises:
        InputError: the campaign compares no two stacks, or the other one was not run.
    """
    theirs = campaign.seen_by_other()
    if record.other is None:
        raise StoreError(
            f"trial {record.id}: the other stack was not run; it runs only worlds in which the "
            "stack under test violates a primary specification"
        )
    return theirs, theirs.record(record.id)


def read_run(world_file: Path, trace_file: Path) -> tuple[World, Trace]:
    """Read a world and the trace of its run.

    Raises:
        InputError: a file is missing or damaged, or the trace is of another world.
    """
    world, trace = read_world(world_file), read_trace(trace_file)
    robots = tuple(robot.name for robot in world.robots)
    if trace.robots != robots:
        raise FormatError(
            f"{trace_file}: has robots {listed(trace.robots)}; {world_file.name} has "
            f"{listed(robots)}"
        )
    return world, trace
