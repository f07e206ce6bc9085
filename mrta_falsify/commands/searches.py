"""The searches of a comparison of samplers: many short campaigns, whole ones side by side.

Each search runs in a process of its own: it never waits for workers, and nothing is computed
beyond its first failure.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.runner import Progress
from mrta_falsify.campaigns.settings import CampaignSettings, Limits
from mrta_falsify.campaigns.store import SETTINGS, StoreError
from mrta_falsify.commands.campaign import open_store, run_store
from mrta_falsify.commands.search_outcomes import SearchOutcome, search_outcome
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import HarnessError, PlaceError
from mrta_falsify.core.interruption import describe_interrupt
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.pool import MAX_DEATHS, Pool

MARK = "comparison.json"  # says what is compared; makes a directory one of comparisons

#: called after each search with the number done, the total and a line about it
OnSearch = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """What a directory of comparisons compares samplers on, as its mark says."""

    scenario: str
    parameters: dict[str, Any]
    stack: StackConfig
    specifications: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonPlan:
    """Which searches a comparison consists of."""

    settings: CampaignSettings  #: of all searches, apart from sampler, seed and directory
    samplers: tuple[str, ...]
    repeats: int
    budget: int
    first_seed: int = 0
    stop_after: int = 1  #: failures, 0: run the budget out
    #: what a name stands for that is no sampler's own
    choices: Mapping[str, Choice] = field(default_factory=dict)

    @property
    def limits(self) -> Limits:
        """Limits of each search."""
        return Limits(budget=self.budget, stop_after=self.stop_after)

    def searches(self, directory: Path) -> list[tuple[str, int, Path]]:
        """List sampler, seed and directory of each search, one repeat of all after the other."""
        seeds = range(self.first_seed, self.first_seed + self.repeats)
        return [
            (name, seed, directory / name / f"{seed}") for seed in seeds for name in self.samplers
        ]


def run_searches(
    plan: ComparisonPlan,
    directory: Path,
    *,
    workers: int = 1,
    on_search: OnSearch = lambda done, total, text: None,
) -> None:
    """Run the searches that are missing; call again to go on.

    Args:
        plan: what to run.
        directory: of the comparison.
        workers: searches at a time, each in a process of its own.
        on_search: called after each with the number done, the total and a line about it.

    Raises:
        StoreError: ``directory``, or a search in it, belongs to another plan.
        PlaceError: a file cannot be written.
        HarnessError: processes died three times in a row; what they had finished is kept.
        Interrupted: Ctrl-C; finished trials are kept, also those of unfinished searches.
    """
    _mark(plan, directory)
    searches = plan.searches(directory)
    missing = [search for search in searches if not _has_ended(plan, search[2])]
    done = len(searches) - len(missing)

    def state() -> tuple[str, str]:
        kept = f"{done} of {len(searches)} searches, and the finished trials of the others"
        return kept, f"{directory} is not complete; continue with --resume"

    try:
        with describe_interrupt(state), Pool(_runs_searches, workers=workers) as pool:
            jobs = [(_settings(plan, *search), plan.limits) for search in missing]
            for number, text in pool.unordered(jobs):
                done += 1
                name, seed, _ = missing[number]
                on_search(done, len(searches), f"{name}, seed {seed}: {text}")
    except Ending:
        raise HarnessError(
            f"{directory}: processes that ran searches have died {MAX_DEATHS} times in a row; "
            "continue with --resume"
        ) from None
    except PlaceError as error:
        error.then = f"call again with --resume (kept: {state()[0]})"
        raise


def outcomes(
    plan: ComparisonPlan, directory: Path, *, knife_edges: bool = False
) -> dict[str, list[SearchOutcome]]:
    """Count what the searches that have begun came to, by sampler, in the plan's order."""
    found: dict[str, list[SearchOutcome]] = {name: [] for name in plan.samplers}
    for name, _, folder in plan.searches(directory):
        if (folder / SETTINGS).exists():
            campaign = open_campaign(folder)
            if campaign.records:
                outcome = search_outcome(campaign, budget=plan.budget, knife_edges=knife_edges)
                found[name].append(outcome)
    return {name: rows for name, rows in found.items() if rows}


def _runs_searches() -> Callable[[tuple[CampaignSettings, Limits]], str]:
    return _search


def _search(search: tuple[CampaignSettings, Limits]) -> str:
    """Run one search, or what is missing of it, here; return a line about it."""
    settings, limits = search
    with open_store(Path(settings.trials.directory), settings) as store:
        result = run_store(store, limits, Choice("serial"))
    if result.ended == "interrupted":
        raise KeyboardInterrupt
    progress = result.progress
    found = f"failure at {progress.first_failure}" if progress.first_failure else "no failure"
    return f"{found} in {progress.ran} trials"


def _has_ended(plan: ComparisonPlan, folder: Path) -> bool:
    """Whether the stored trials of a search are all that its limits ask for."""
    if not (folder / SETTINGS).exists():
        return False
    campaign = open_campaign(folder)
    progress = Progress(campaign.settings, limits=plan.limits)
    for number, record in enumerate(campaign.records):
        if record.number != number:
            return False
        progress.take(record)
        if progress.has_enough:
            return True
    return progress.ran >= plan.budget


def check_is_comparison(directory: Path) -> None:
    """Refuse to resume a directory that does not hold a comparison.

    Raises:
        StoreError: it does not.
    """
    if not (directory / MARK).is_file() and not any(directory.glob(f"*/*/{SETTINGS}")):
        raise StoreError(
            f"{directory}: is not a comparison (it has no {MARK}); begin one without --resume"
        )


def _mark(plan: ComparisonPlan, directory: Path) -> None:
    """Note in ``directory`` what is compared there.

    Raises:
        StoreError: something else is.
    """
    trials = plan.settings.trials
    compared = codec.encode(
        Compared(
            scenario=trials.scenario,
            parameters=trials.params,
            stack=trials.stack,
            specifications=trials.specifications,
        )
    )
    path = directory / MARK
    if not path.is_file():
        write_atomically(path, (json.dumps(compared, indent=1) + "\n").encode())
        return
    known = codec.read_json(path)
    for name, value in compared.items():
        there = known.get(name) if isinstance(known, dict) else None
        if there != value:
            raise StoreError(
                f"{directory}: compares samplers with other {name} (see its {MARK}); "
                "choose another directory"
            )


def _settings(plan: ComparisonPlan, name: str, seed: int, folder: Path) -> CampaignSettings:
    trials = dataclasses.replace(plan.settings.trials, seed=seed, directory=str(folder.resolve()))
    return dataclasses.replace(
        plan.settings, trials=trials, sampler=plan.choices.get(name, Choice(name))
    )
