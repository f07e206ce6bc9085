"""Samplers on the same scenario: how often and how soon they find a failure, and how many kinds.

A comparison is many short searches, so whole searches run side by side, one in a process: a
search then never waits for workers, and nothing is computed beyond its first failure.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns import survival
from mrta_falsify.campaigns.processes import spawned
from mrta_falsify.campaigns.runner import Progress
from mrta_falsify.campaigns.settings import CampaignSettings, Limits
from mrta_falsify.campaigns.store import SETTINGS, Campaign, StoreError, write_atomically
from mrta_falsify.campaigns.survival import SearchCost
from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.verbs import campaign as campaigns

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

    @property
    def limits(self) -> Limits:
        """Of each search."""
        return Limits(budget=self.budget, stop_after=self.stop_after)

    def searches(self, directory: Path) -> list[tuple[str, int, Path]]:
        """Sampler, seed and directory of each search; repeats outside, so that pieces compare."""
        seeds = range(self.first_seed, self.first_seed + self.repeats)
        return [
            (name, seed, directory / name / f"{seed}") for seed in seeds for name in self.samplers
        ]


def run(
    plan: Plan,
    directory: Path,
    *,
    workers: int = 1,
    on_search: Callable[[int, int, str], None] = lambda done, total, text: None,
) -> bool:
    """Run the searches that are missing; call again to go on.

    Args:
        plan: what to run.
        directory: of the comparison.
        workers: searches at a time, each in a process of its own.
        on_search: called after each with the number done, the total and a line about it.

    Returns:
        Whether all have ended; False after Ctrl-C.

    Raises:
        StoreError: ``directory``, or a search in it, belongs to another plan.
        HarnessError: a process died; what it had finished is kept.
    """
    _mark(plan, directory)
    searches = plan.searches(directory)
    missing = [search for search in searches if not _has_ended(plan, search[2])]
    done = len(searches) - len(missing)
    pool = spawned(workers, hear_interrupts=True)  # a search takes minutes
    try:
        asked = {
            pool.submit(_search, _settings(plan, name, seed, folder), plan.limits): (name, seed)
            for name, seed, folder in missing
        }
        for future in as_completed(asked):
            name, seed = asked[future]
            text = future.result()
            if text is None:
                return False
            done += 1
            on_search(done, len(searches), f"{name}, seed {seed}: {text}")
    except KeyboardInterrupt:
        return False
    except BrokenProcessPool:
        raise HarnessError(
            f"{directory}: a process that ran searches has died; go on with --resume"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)
    return True


def _search(settings: CampaignSettings, limits: Limits) -> str | None:
    """Run one search, or what is missing of it, here; a line about it, None after Ctrl-C."""
    with campaigns.open_store(Path(settings.trials.directory), settings) as store:
        result = campaigns.run(store, limits, Choice("serial"))
    if result.ended == "interrupted":
        return None
    progress = result.progress
    found = f"failure at {progress.first_failure}" if progress.first_failure else "no failure"
    return f"{found} in {progress.ran} trials"


def _has_ended(plan: Plan, folder: Path) -> bool:
    """Whether the stored trials of a search are all that its limits ask for."""
    if not (folder / SETTINGS).exists():
        return False
    progress = Progress(plan.limits)
    for number, record in enumerate(campaigns.open_campaign(folder).records):
        if record.number != number:
            return False
        progress.take(record)
        if progress.has_enough:
            return True
    return progress.ran >= plan.budget


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What one search came to."""

    simulations: SearchCost
    seconds: SearchCost  #: of computing
    trials: int  #: simulated, those after the first failure included
    modes: frozenset[str]  #: signatures of its failures


def told(campaign: Campaign, plan: Plan, *, knife_edges: bool = False) -> Told:
    """What a search came to within the plan's budget.

    Only the trials up to the first failure count for how long it took; a knife edge is none,
    where copies were run to tell, but with ``knife_edges``.
    """
    simulations, seconds, signatures = 0, 0.0, set()
    found: tuple[SearchCost, SearchCost] | None = None
    for record in campaign.records:
        seconds += record.scene_s + record.wall_s
        if record.status == "rejected":
            continue
        simulations += 1
        if record.failed if knife_edges else record.wanted:
            signatures.add(record.signature)
            found = found or (
                SearchCost(spent=simulations, found=True),
                SearchCost(spent=seconds, found=True),
            )
        if simulations >= plan.budget:
            break
    missed = (SearchCost(spent=simulations, found=False), SearchCost(spent=seconds, found=False))
    by_simulations, by_seconds = found or missed
    return Told(
        simulations=by_simulations,
        seconds=by_seconds,
        trials=simulations,
        modes=frozenset(signatures),
    )


def results(plan: Plan, directory: Path, *, knife_edges: bool = False) -> dict[str, list[Told]]:
    """What the searches that have begun came to (:func:`told`), by sampler, in the plan's order."""
    found: dict[str, list[Told]] = {name: [] for name in plan.samplers}
    for name, _, folder in plan.searches(directory):
        if (folder / SETTINGS).exists():
            campaign = campaigns.open_campaign(folder)
            if campaign.records:
                found[name].append(told(campaign, plan, knife_edges=knife_edges))
    return {name: rows for name, rows in found.items() if rows}


def table(found: Mapping[str, Sequence[Told]], budget: int) -> list[dict[str, Any]]:
    """One row per sampler: falsification rate, simulations to first failure, modes.

    The log-rank p-value compares with the first sampler.

    Args:
        found: by sampler, as of :func:`results`.
        budget: simulations per search.
    """
    reference = next(iter(found.values()), [])
    return [_row(name, rows, reference, budget) for name, rows in found.items()]


def curves(found: Mapping[str, Sequence[Told]]) -> dict[str, tuple[Array, Array]]:
    """Share of searches without a failure over simulations, by sampler (Kaplan-Meier)."""
    return {
        name: survival.survival_curve([row.simulations for row in rows])
        for name, rows in found.items()
    }


def _row(
    name: str, found: Sequence[Told], reference: Sequence[Told], budget: int
) -> dict[str, Any]:
    simulations = [row.simulations for row in found]
    seconds = [row.seconds for row in found]
    trials = sum(row.trials for row in found)
    mean = survival.restricted_mean_interval(simulations, budget)
    longest = max(row.seconds.spent for row in (*found, *reference))
    return {
        "sampler": name,
        "searches": len(found),
        "falsification_rate": dataclasses.asdict(survival.found_share(simulations)),
        "simulations_to_failure": {
            "restricted_mean": dataclasses.asdict(mean),
            "median": survival.median(simulations),
        },
        "simulations_per_failure": dataclasses.asdict(
            survival.spent_per_failure_interval(simulations)
        ),
        "seconds_to_failure": survival.restricted_mean(seconds, longest),
        "seconds_per_failure": survival.spent_per_failure(seconds),
        "log_rank_p": survival.log_rank(simulations, [row.simulations for row in reference]),
        "trials": trials,
        "modes_per_1000": 1000.0 * sum(len(row.modes) for row in found) / max(trials, 1),
    }
