"""Pools of uniform draws: what makes a pair easy or hard, and the searches of ``random``.

Uniform draws do not learn, so one pool stands for any number of searches of ``random``: a search
ends at its first failure or with its budget, and the next one begins with the draw after it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.falsification.pairs import Pair
from mrta_falsify.core.probability import failure_probability
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import SETTINGS, Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.commands.campaign import open_store, run_store
from mrta_falsify.commands.search_outcomes import SearchOutcome, search_outcome
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.workers import local_workers

WINDOW = 8  # draws that may run at a time


def pool_folder(directory: Path, pair: Pair) -> Path:
    """Name the campaign of a pair's draws."""
    return directory / "rates" / pair.name


def rates(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Draw worlds evenly, accepted as in searches: share of failures and cost of a trial."""
    for pair in pairs:
        folder = pool_folder(options.directory, pair)
        settings = pair.searches(folder, jittered=options.jittered)
        trials = dataclasses.replace(settings.trials, seed=options.seed)
        settings = dataclasses.replace(
            settings, trials=trials, sampler=Choice("random"), window=WINDOW
        )
        with open_store(folder, settings) as store:
            result = run_store(store, Limits(budget=options.trials), local_workers(options.workers))
        if result.ended == "interrupted":
            raise KeyboardInterrupt
        pool = pool_of(pair.name, result.campaign.records)
        print(json.dumps(codec.encode(pool)), flush=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pool:
    """What the draws of a pair came to."""

    pair: str
    k: int  #: dimensions
    trials: int  #: judged
    not_run: int
    failed: int
    share: tuple[float, ...]  #: that fails, low and high end of its 95 % interval
    wanted: int  #: failures that most copies share
    wanted_share: tuple[float, ...]
    modes: int
    by: dict[str, int]  #: failures by specification
    best: float  #: lowest score
    sim_s: float  #: median [s]
    wall_s: float  #: median of a trial, scene included [s]


def read_draws(directory: Path, pair: Pair) -> Campaign | None:
    """Read the draws of a pair that are in a directory; None: none has been judged."""
    folder = pool_folder(directory, pair)
    draws = open_campaign(folder) if (folder / SETTINGS).exists() else None
    return draws if draws and any(of.status == "ok" for of in draws.records) else None


def pool_of(name: str, records: Sequence[TrialRecord]) -> Pool:
    """Sum up draws: shares that fail, with intervals, and what a trial took."""
    judged = [record for record in records if record.status == "ok"]
    failed = [record for record in judged if record.is_primary]
    wanted = [record for record in judged if record.is_robust]
    specs = [v.spec for record in failed for v in record.verdicts if v.violated]
    return Pool(
        pair=name,
        k=len(judged[0].candidate.u),
        trials=len(judged),
        not_run=len(records) - len(judged),
        failed=len(failed),
        share=_share(len(failed), len(judged)),
        wanted=len(wanted),
        wanted_share=_share(len(wanted), len(judged)),
        modes=len({record.signature for record in failed}),
        by={spec: specs.count(spec) for spec in sorted(set(specs))},
        best=round(min(record.score for record in judged), 4),
        sim_s=round(statistics.median(record.sim_time for record in judged), 1),
        wall_s=round(statistics.median(r.origin.scene_s + r.wall_s for r in judged), 2),
    )


def _share(failed: int, trials: int) -> tuple[float, ...]:
    """Estimate a share, low and high end of its 95 % interval."""
    share = failure_probability(failed, trials)
    return tuple(round(value or 0.0, 4) for value in (share.estimate, share.low, share.high))


def pool_outcomes(draws: Campaign, *, budget: int, knife_edges: bool) -> list[SearchOutcome]:
    """Cut a pair's draws into searches of ``random``."""
    return [
        search_outcome(search, budget=budget, knife_edges=knife_edges)
        for search in _searches(draws, budget, knife_edges=knife_edges)
    ]


def _searches(campaign: Campaign, budget: int, *, knife_edges: bool) -> Iterator[Campaign]:
    """Cut draws after each failure, and where a budget is spent."""
    begin, simulated = 0, 0
    for end, record in enumerate(campaign.records, start=1):
        simulated += record.was_run
        found = record.is_primary if knife_edges else record.is_robust
        if found or simulated == budget:
            yield dataclasses.replace(campaign, records=campaign.records[begin:end])
            begin, simulated = end, 0
    if simulated:
        yield dataclasses.replace(campaign, records=campaign.records[begin:])
