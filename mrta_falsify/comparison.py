"""Samplers on the same scenario: how often and how soon they find a failure, and how many kinds."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify import campaigns
from mrta_falsify.campaign import survival
from mrta_falsify.campaign.settings import CampaignSettings, Limits
from mrta_falsify.campaign.store import SETTINGS, Campaign, StoreError, write_atomically
from mrta_falsify.campaign.survival import Search
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice

MARK = "comparison.json"  # says what is compared; makes a directory one of comparisons


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Which searches a comparison consists of."""

    settings: CampaignSettings  #: of all searches, apart from sampler, seed and directory
    samplers: tuple[str, ...]
    repeats: int
    budget: int
    first_seed: int = 0
    stop_after: int = 1  #: failures, 0: run the budget out

    def searches(self, directory: Path) -> list[tuple[str, int, Path]]:
        """Sampler, seed and directory of each search; repeats outside, so that pieces compare."""
        seeds = range(self.first_seed, self.first_seed + self.repeats)
        return [
            (name, seed, directory / name / f"{seed}") for seed in seeds for name in self.samplers
        ]


def run(
    plan: Plan,
    directory: Path,
    executor: Choice,
    *,
    on_search: Callable[[int, int, str], None] = lambda done, total, text: None,
) -> bool:
    """Run the searches that are missing; call again to go on.

    Args:
        plan: what to run.
        directory: of the comparison.
        executor: for each search in turn.
        on_search: called after each with the number done, the total and a line about it.

    Returns:
        Whether all have ended; False after Ctrl-C.

    Raises:
        StoreError: ``directory``, or a search in it, belongs to another plan.
    """
    _mark(plan, directory)
    searches = plan.searches(directory)
    for done, (name, seed, folder) in enumerate(searches, start=1):
        settings = _settings(plan, name, seed, folder)
        with campaigns.open_store(folder, settings) as store:
            limits = Limits(budget=plan.budget, stop_after=plan.stop_after)
            result = campaigns.run(store, limits, executor)
        if result.ended == "interrupted":
            return False
        progress = result.progress
        found = f"failure at {progress.first_failure}" if progress.first_failure else "no failure"
        on_search(done, len(searches), f"{name}, seed {seed}: {found} in {progress.ran} trials")
    return True


def check_is_comparison(directory: Path) -> None:
    """Refuse to go on with what is no comparison.

    Raises:
        StoreError: says so.
    """
    if not (directory / MARK).is_file() and not any(directory.glob(f"*/*/{SETTINGS}")):
        raise StoreError(
            f"{directory}: is not a comparison (it has no {MARK}); begin one without --resume"
        )


def _mark(plan: Plan, directory: Path) -> None:
    """Note in ``directory`` what is compared there.

    Raises:
        StoreError: something else is.
    """
    trials = plan.settings.trials
    compared: dict[str, Any] = {
        "scenario": trials.scenario,
        "parameters": codec.encode(trials.params),
        "stack": codec.encode(trials.stack),
        "specifications": list(trials.specifications),
    }
    path = directory / MARK
    if not path.is_file():
        try:
            write_atomically(path, (json.dumps(compared, indent=1) + "\n").encode())
        except OSError as error:
            raise StoreError(f"{path}: cannot be written: {error.strerror}") from None
        return
    known = codec.read_json(path)
    for name, value in compared.items():
        there = known.get(name) if isinstance(known, dict) else None
        if there != value:
            raise StoreError(
                f"{directory}: compares samplers with other {name} (see its {MARK}); "
                "choose another directory"
            )


def _settings(plan: Plan, name: str, seed: int, folder: Path) -> CampaignSettings:
    trials = dataclasses.replace(plan.settings.trials, seed=seed, directory=str(folder.resolve()))
    return dataclasses.replace(plan.settings, trials=trials, sampler=Choice(name))


# --- what came of it -----------------------------------------------------------------------


def told(campaign: Campaign, plan: Plan) -> tuple[Search, Search, int, int]:
    """A search in simulations and in seconds of computing, its trials and its failure modes.

    Only the trials up to the first failure count for the searches; trials that other workers
    happened to have finished by then do not.
    """
    simulations, seconds, signatures, ran = 0, 0.0, set(), 0
    found: tuple[Search, Search] | None = None
    for record in campaign.records:
        seconds += record.scene_s + record.wall_s
        if record.status == "rejected":
            continue
        simulations += 1
        ran += 1
        if record.failed:
            signatures.add(record.signature)
            if found is None:
                found = (
                    Search(spent=simulations, found=True),
                    Search(spent=seconds, found=True),
                )
        if ran >= plan.budget:
            break
    missed = (Search(spent=simulations, found=False), Search(spent=seconds, found=False))
    return (*(found or missed), ran, len(signatures))


def table(plan: Plan, directory: Path) -> list[dict[str, Any]]:
    """One row per sampler: falsification rate, simulations to first failure, modes.

    The log-rank p-value compares with the first sampler of the plan.
    """
    by_sampler: dict[str, list[tuple[Search, Search, int, int]]] = {}
    for name, _, folder in plan.searches(directory):
        if (folder / SETTINGS).exists():
            campaign = campaigns.open_campaign(folder)
            if campaign.records:
                by_sampler.setdefault(name, []).append(told(campaign, plan))
    rows = []
    reference = by_sampler.get(plan.samplers[0], [])
    for name in plan.samplers:
        found = by_sampler.get(name, [])
        if found:
            rows.append(_row(name, found, reference, plan.budget))
    return rows


def _row(
    name: str,
    found: Sequence[tuple[Search, Search, int, int]],
    reference: Sequence[tuple[Search, Search, int, int]],
    budget: int,
) -> dict[str, Any]:
    simulations = [row[0] for row in found]
    seconds = [row[1] for row in found]
    trials = sum(row[2] for row in found)
    mean = survival.restricted_mean_interval(simulations, budget)
    longest = max(row[1].spent for row in (*found, *reference))
    rate = survival.found_share(simulations)
    return {
        "sampler": name,
        "searches": len(found),
        "falsification_rate": dataclasses.asdict(rate),
        "simulations_to_failure": {
            "restricted_mean": dataclasses.asdict(mean),
            "median": survival.median(simulations),
        },
        "seconds_to_failure": survival.restricted_mean(seconds, longest),
        "log_rank_p": survival.log_rank(simulations, [row[0] for row in reference]),
        "trials": trials,
        "modes_per_1000": 1000.0 * sum(row[3] for row in found) / max(trials, 1),
    }
