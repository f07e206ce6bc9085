"""Searches beside pools of uniform draws: how many times fewer simulations a failure takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from experiments import holm, markdown
from experiments.falsification.kept import RANDOM, Search
from experiments.falsification.pools import Pool
from mrta_falsify.core.seeding import stream
from reports.figure_searches import Curve

ALL = "all pairs"
RESAMPLES = 4000
NONE_FOUND = 0.5  # failures, where there are none


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A sampler beside uniform draws of the same pair."""

    pair: str
    sampler: str
    failures: int
    simulations: float
    drawn_failures: int
    draws: int
    times: float  #: fewer simulations per failure; half a failure where there is none
    low: float  #: end of the 95 % interval
    high: float
    p: float  #: that the chance of a failure is the same
    holm_p: float = 1.0  #: corrected for the number of pairs


def beside_uniform(
    searches: Iterable[Search], pools: Sequence[Pool], budget: int, *, knife_edges: bool
) -> list[Compared]:
    """Compare each sampler with the pools, per pair and with all pairs counted alike.

    Each search counts as far as it went within ``budget`` simulations.
    A pair's trials are taken as independent: both counts of failures as Poisson, so that given
    their sum one of them is binomial (Przyborowski and Wilenski, "Homogeneity of results in testing
    samples from Poisson series", 1940); the interval is Clopper and Pearson's. Over all pairs the
    mean of simulations per failure is compared, with a bootstrap over searches and draws.
    """
    found: list[Compared] = []
    by_sampler: dict[str, list[Search]] = {}
    for search in searches:
        if search.sampler != RANDOM:
            by_sampler.setdefault(search.sampler, []).append(search)
    for sampler, own in by_sampler.items():
        rows, costs, drawn = [], [], []
        for pool in pools:
            of_pair = [s.within(budget).simulations for s in own if s.pair == pool.pair]
            if not of_pair:
                continue
            costs.append(np.array([(cost.spent, cost.found) for cost in of_pair]))
            drawn.append((_failures(pool, knife_edges), pool.trials))
            rows.append(_of_pair(pool.pair, sampler, costs[-1], drawn[-1]))
        corrected = holm.adjusted([row.p for row in rows])
        found += [
            dataclasses.replace(row, holm_p=p) for row, p in zip(rows, corrected, strict=True)
        ]
        if rows:
            found.append(_of_all(sampler, costs, drawn))
    return found


def expected_curve(pools: Sequence[Pool], budget: int, *, knife_edges: bool) -> Curve:
    """Say which share of searches of uniform draws has no failure yet, from what pools show.

    Returns:
        Simulations ``(budget + 1,)`` and the share ``(budget + 1,)``, the mean over the pools.
    """
    times = np.arange(budget + 1.0)
    chances = [max(_failures(pool, knife_edges), NONE_FOUND) / pool.trials for pool in pools]
    return times, np.mean([(1.0 - chance) ** times for chance in chances], axis=0)


def _failures(pool: Pool, knife_edges: bool) -> int:
    return pool.failed if knife_edges else pool.wanted


def _of_pair(pair: str, sampler: str, costs: np.ndarray, drawn: tuple[int, int]) -> Compared:
    spent, failures = costs.sum(axis=0)
    drawn_failures, draws = drawn
    total = int(failures) + drawn_failures
    low, high, p = 0.0, float("inf"), 1.0
    if total:
        test = stats.binomtest(int(failures), total, spent / (spent + draws))
        p = float(test.pvalue)
        shares = test.proportion_ci(method="exact")
        low, high = (
            share / (1.0 - share) * draws / spent if share < 1.0 else float("inf")
            for share in (shares.low, shares.high)
        )
    return Compared(
        pair=pair,
        sampler=sampler,
        failures=int(failures),
        simulations=float(spent),
        drawn_failures=drawn_failures,
        draws=draws,
        times=_per_failure(draws, drawn_failures) / _per_failure(spent, failures),
        low=low,
        high=high,
        p=p,
    )


def _per_failure(simulations: float, failures: float) -> float:
    return simulations / max(failures, NONE_FOUND)


def _of_all(
    sampler: str, costs: Sequence[np.ndarray], drawn: Sequence[tuple[int, int]]
) -> Compared:
    def times(costs: Sequence[np.ndarray], drawn: Sequence[tuple[int, int]]) -> float:
        searched = np.mean([_per_failure(*of.sum(axis=0)) for of in costs])
        return float(np.mean([_per_failure(of[1], of[0]) for of in drawn]) / searched)

    random = stream(0, "beside uniform draws")
    resampled = [
        times(
            [of[random.integers(len(of), size=len(of))] for of in costs],
            [
                (int(random.binomial(draws, max(of, NONE_FOUND) / draws)), draws)
                for of, draws in drawn
            ],
        )
        for _ in range(RESAMPLES)
    ]
    low, high = np.quantile(resampled, [0.025, 0.975])
    share = float(np.mean(np.array(resampled) <= 1.0))
    spent, failures = np.concatenate(costs).sum(axis=0)
    return Compared(
        pair=ALL,
        sampler=sampler,
        failures=int(failures),
        simulations=float(spent),
        drawn_failures=sum(of for of, _ in drawn),
        draws=sum(draws for _, draws in drawn),
        times=times(costs, drawn),
        low=float(low),
        high=float(high),
        p=max(2.0 * min(share, 1.0 - share), 1.0 / RESAMPLES),
    )


def print_compared(rows: Iterable[Compared]) -> None:
    """Print the comparison as a table in Markdown."""
    heads = ("Pair", "Sampler", "Found in", "Uniform draws", "Times fewer", "p", "Holm")
    print(markdown.heads(*heads))
    for row in rows:
        told = markdown.row(
            row.pair,
            f"`{row.sampler}`",
            f"{row.failures} in {row.simulations:.0f}",
            f"{row.drawn_failures} in {row.draws}",
            f"{row.times:.1f} [{row.low:.1f}, {row.high:.1f}]",
            f"{row.p:.2g}",
            "" if row.pair == ALL else f"{row.holm_p:.2g}",
        )
        print(told)
