"""What a campaign prints: live progress on stderr, and what it found."""

from __future__ import annotations

import math
import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrta_falsify.campaigns.settings import MAX_TRIALS
from mrta_falsify.cli import output
from mrta_falsify.core.words import listed

if TYPE_CHECKING:
    from mrta_falsify.campaigns.runner import Progress
    from mrta_falsify.campaigns.stats import FailureMode
    from mrta_falsify.commands.campaign import CampaignResult
    from mrta_falsify.commands.campaign_summary import CampaignSummary
    from mrta_falsify.core.probability import Probability
    from mrta_falsify.core.record import TrialRecord

LINES = 10  # of progress in a pipe, per campaign
SHOWN_IDS = 6  # trials named per failure mode


class CampaignWatch:
    """Progress of one campaign on stderr: a bar on terminals, a line now and then elsewhere.

    A context manager; the bar appears at its start.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._announced: set[str] = set()
        self._bar: Any = None
        self._task: Any = None
        self._began = time.monotonic()
        self._ran_before: int | None = None
        self._tenths = 0  # of the time that the campaign may take, when a line was last told

    def __enter__(self) -> CampaignWatch:
        if sys.stderr.isatty():
            self._show_bar("0", "the first trial runs")
        return self

    def __exit__(self, *reason: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def on_record(self, record: TrialRecord, is_new: bool) -> None:
        """Announce the first failure."""
        del is_new
        announced = self._announced
        kind = _announced_kind(record)
        if kind and kind not in announced and "failure" not in announced:
            announced.add(kind)
            counted = [str(one) for one in (record.other, record.repeats, record.vote) if one]
            counted += [record.confirmation] if record.confirmation else []
            copies = f" ({'; '.join(counted)})" if counted else ""
            self.say(f"first {kind}: trial {record.id}, {record.signature}{copies}")
            place = shlex.quote(str(self._directory))
            self.say(f"  replay it by: mrta-falsify replay {place} {record.id}")

    def on_feedback(self, record: TrialRecord, counts: Progress) -> None:
        """Show how far the campaign is."""
        limits = counts.limits
        budget, spent = limits.budget, time.monotonic() - self._began
        by_clock = budget == MAX_TRIALS
        if self._ran_before is None:
            self._ran_before = counts.ran - record.was_run
        if sys.stderr.isatty():
            done, total = (spent, limits.wall_clock) if by_clock else (counts.ran, budget)
            ran = f"{counts.ran}" if by_clock else f"{counts.ran}/{budget}"
            self._show_bar(ran, _count_text(counts))
            self._bar.update(self._task, completed=done, total=total)
        elif by_clock and record.was_run:
            tenths = int(LINES * spent / limits.wall_clock)
            if tenths > self._tenths:
                self._tenths = tenths
                left = output.time_left(spent, limits.wall_clock, spent)
                self.say(f"{counts.ran} trials, {_count_text(counts)}{left}")
        elif counts.ran % max(1, budget // LINES) == 0 and record.was_run:
            done, total = counts.ran - self._ran_before, budget - self._ran_before
            left = output.time_left(done, total, spent)
            self.say(f"{counts.ran}/{budget} trials, {_count_text(counts)}{left}")

    def _show_bar(self, ran: str, counts: str) -> None:
        if self._bar is None:
            self._bar = _new_bar()
            self._task = self._bar.add_task("campaign", total=None, ran="", counts="")
            self._bar.start()
        self._bar.update(self._task, ran=ran, counts=counts)

    def say(self, text: str) -> None:
        """Print a line beside the progress."""
        if self._bar is not None:
            self._bar.console.print(text)
        else:
            output.say(text)


def _announced_kind(record: TrialRecord) -> str:
    """Say what a trial is the first of; empty if it did not fail."""
    if not record.failed:
        return ""
    from mrta_falsify.specs.causes import group_of

    group = group_of(record.result)
    if group == "shut":
        return "place that the world shut"
    if group == "secondary":
        return "failure only of a secondary specification"
    if not record.is_primary:
        return "failure that the other stack does not pass either"
    return "failure" if record.is_robust else "knife edge"


def _new_bar() -> Any:
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True, markup=False, highlight=False, emoji=False)
    return progress.Progress(
        progress.TextColumn("{task.fields[ran]} trials"),
        progress.BarColumn(bar_width=20),
        progress.TextColumn("{task.fields[counts]}"),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        console=console,
        transient=True,
    )


def _count_text(counts: Progress) -> str:
    failures = ", ".join(f"{n} {name}" for name, n in sorted(counts.by_specification.items()))
    best = f"lowest score {counts.best:+.3f}" if math.isfinite(counts.best) else "no score yet"
    parts = [f"{counts.failed} failed" + (f" (violated: {failures})" if failures else ""), best]
    if counts.on_both:
        parts.append(f"{counts.on_both} on both stacks")
    if counts.rejected:
        parts.append(f"{counts.rejected} rejected")
    if counts.impossible:
        parts.append(f"{counts.impossible} impossible")
    if counts.errors:
        parts.append(f"{counts.errors} errors")
    return ", ".join(parts)


def say_interrupted(result: CampaignResult) -> None:
    """Say on stderr what an interrupted campaign has stored, and how to go on."""
    place = shlex.quote(str(result.campaign.directory))
    output.say(
        f"interrupted: {result.progress.ran} of {result.progress.limits.budget} trials are "
        f"stored; continue with: mrta-falsify campaign --resume {place}"
    )


def print_campaign(result: CampaignResult) -> None:
    """Print what a campaign found, as text."""
    from mrta_falsify.commands.campaign_summary import (
        NoProbability,
        comparison_sentence,
        kinds_text,
        repeat_sentence,
        shut_sentence,
        summarise_campaign,
        unjudged_sentences,
        unseen_sentence,
    )

    out = output.stdout()
    data = summarise_campaign(result)
    out.print(
        f"{data.ran} {'trial' if data.ran == 1 else 'trials'} "
        f"({data.sim_hours:.2f} h simulated in {data.wall_s:.0f} s): "
        f"{kinds_text(data.kinds)}{_secondary_note(data)}; "
        f"{data.rejected} scenes rejected, {data.impossible} impossible, {data.errors} errors; "
        f"ended: {data.ended}"
    )
    if data.shut:
        are_run = result.campaign.settings.trials.with_shut_rooms
        which = "worlds that no stack can do, run nevertheless" if are_run else "impossible"
        out.print(f"{which}: {shut_sentence(data.shut)}")
    if data.uncounted:
        out.print(f"{data.uncounted} more were under way when it ended; they are stored, too")
    if data.against is not None:
        out.print(comparison_sentence(data.against))
    if data.screening is not None:
        out.print(
            f"screening: physics confirmed {data.screening.confirmed} of "
            f"{data.screening.failed_in_screening} failures of the kinematic engine"
        )
    for engine in data.confirmed:
        out.print(f"on {engine.engine}: {engine.fails} of {engine.asked} robust failures fail, too")
    if data.robust is not None:
        sought = result.progress.sought
        out.print(f"most perturbed runs fail too: {data.robust} of {sought} failures")
    uncounted = _why_not_stopped(result, data)
    if uncounted:
        out.print(uncounted)
    if data.repeated is not None:
        out.print(repeat_sentence(data.repeated))
    for text in unjudged_sentences(result.campaign.stats()):
        out.print(text)
    if data.modes:
        _print_modes(data.modes)
        place = shlex.quote(data.directory)
        out.print(f"replay: mrta-falsify replay {place} {data.modes[0].ids[0]}")
    elif data.best_score is not None:
        none = "no violation" if data.against is None else "no such world"
        out.print(f"{none} found; closest call: score {data.best_score:+.3f}")
    if not isinstance(data.probability, NoProbability) and data.probability.trials:
        _print_probability(data.probability)
    if data.unseen is not None and (text := unseen_sentence(data.unseen)):
        out.print(text)
    out.print(f"campaign: {data.directory}")


def _why_not_stopped(result: CampaignResult, data: CampaignSummary) -> str:
    """Say why failures did not stop a campaign that is to stop at some; empty: they did."""
    progress = result.progress
    limit = progress.limits.stop_after
    if not limit or not data.failed or progress.robust >= limit or data.ended == "interrupted":
        return ""
    few = "that few perturbed runs share"
    passed_over = [
        (data.afterthoughts, f"only in {' or '.join(data.then)}"),
        (data.kinds["shut"], "shut by the world"),
        (
            progress.sought - progress.robust,
            f"{few}, or the other stack, too" if data.against else few,
        ),
    ]
    counts = [f"{count} {what}" for count, what in passed_over if count]
    if not counts:
        return ""
    return f"--stop-after {limit} counts other failures than these: {listed(counts)}"


def _secondary_note(data: CampaignSummary) -> str:
    """Count the failures in secondary specifications only."""
    return f", {data.afterthoughts} only in {' or '.join(data.then)}" if data.then else ""


def _print_modes(modes: tuple[FailureMode, ...]) -> None:
    table = output.new_table("failure mode", "trials", "ids", right=("trials",))
    for mode in modes:
        more = " ..." if len(mode.ids) > SHOWN_IDS else ""
        table.add_row(mode.signature, str(mode.count), ", ".join(mode.ids[:SHOWN_IDS]) + more)
    output.print_table(table)


def _print_probability(chance: Probability) -> None:
    from mrta_falsify.core.probability import interval_text

    out = output.stdout()
    estimate = "unknown" if chance.estimate is None else f"{chance.estimate:.3g}"
    out.print(
        f"probability of a violation: {estimate}, "
        f"{interval_text(chance.low, chance.high, chance.level, digits='.3g')} ({chance.method})"
    )
    if chance.note:
        out.print(f"  {chance.note}")
