"""What the searches of a suite came to: rows, curves, modes, confirmation."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from experiments import holm, markdown
from experiments.falsification.kept import RANDOM, Search, all_pools, all_searches
from experiments.falsification.pairs import Pair
from experiments.falsification.uniform import ALL, beside_uniform, expected_curve, print_compared
from mrta_falsify.campaigns.journal import read_rows
from mrta_falsify.campaigns.store import SETTINGS
from mrta_falsify.core import codec
from mrta_falsify.commands.search_outcomes import (
    SamplerRow,
    SearchOutcome,
    sampler_rows,
    survival_curves,
)
from mrta_falsify.commands.stored_trials import open_campaign
from reports.figure_searches import Curve, write_searches

CONFIRMED = "confirmed.jsonl"
EXPECTED = "uniform draws, by the share of the pool that fails"
Rows = dict[str, tuple[SamplerRow, ...]]


def table(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Rows per pair and for all pairs together, as JSON, and survival curves.

    Where copies were run once for robust failures and once for all. Searches are also compared with
    the pools of uniform draws, of which more is kept than searches of ``random`` can be cut from.
    """
    pairs = list(pairs)
    options.output.mkdir(parents=True, exist_ok=True)
    pools = all_pools(pairs, options)
    rates = [pools[pair.name] for pair in pairs if pair.name in pools]
    out: dict[str, Any] = {"budget": options.budget, "rates": rates}
    kinds = {"searches": False} | ({"searches_with_knife_edges": True} if options.jittered else {})
    searches = all_searches(pairs, options).values()
    for kind, knife_edges in kinds.items():
        known = [search for search in searches if search.knife_edges == knife_edges]
        rows, panels = searches_table(pairs, known, options.budget)
        out[kind], corrected = rows, corrected_p(rows)
        for name, curves in panels.items():
            of_panel = [pool for pool in rates if name in (pool.pair, ALL) and pool.pair in rows]
            if of_panel and RANDOM not in curves:
                curves[EXPECTED] = expected_curve(of_panel, options.budget, knife_edges=knife_edges)
        out[f"{kind}_holm_p"] = corrected
        write_searches(panels, options.budget, options.output / f"{kind}.png")
        print_rows(rows, corrected)
        compared = beside_uniform(known, rates, options.budget, knife_edges=knife_edges)
        out[f"{kind}_beside_uniform_draws"] = compared
        print_compared(compared)
    out["modes"] = modes_table(pairs, options)
    out["confirmation"] = confirmation(options.directory)
    path = options.output / "results.json"
    told = codec.finite(codec.encode(out))
    path.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    print(json.dumps({name: told[name] for name in ("rates", "modes", "confirmation")}, indent=1))


def searches_table(
    pairs: Iterable[Pair], searches: Iterable[Search], budget: int
) -> tuple[Rows, dict[str, dict[str, Curve]]]:
    """Rows and survival curves of the searches, per pair and of all pairs together.

    Each search counts as far as it went within ``budget`` simulations; ``random`` comes first.
    """
    rows: Rows = {}
    panels: dict[str, dict[str, Curve]] = {}
    pooled: dict[str, list[SearchOutcome]] = {}
    known = sorted(searches, key=lambda of: (of.sampler != RANDOM, of.sampler, of.seed))
    for pair in pairs:
        found: dict[str, list[SearchOutcome]] = {}
        for of in known:
            if of.pair == pair.name:
                found.setdefault(of.sampler, []).append(of.within(budget))
        if not found:
            continue
        rows[pair.name] = sampler_rows(found, budget)
        panels[pair.name] = survival_curves(found)
        for name, told in found.items():
            pooled.setdefault(name, []).extend(told)
    pooled = dict(sorted(pooled.items(), key=lambda of: of[0] != RANDOM))  # tests are against it
    rows[ALL] = sampler_rows(pooled, budget)
    panels[ALL] = survival_curves(pooled)
    return rows, panels


def corrected_p(rows: Rows) -> dict[str, dict[str, float]]:
    """Correct the tests of each sampler against the first one for the number of pairs (Holm)."""
    found: dict[str, dict[str, float]] = {}
    for pair, of in rows.items():
        for row in of[1:] if pair != ALL else ():
            found.setdefault(row.sampler, {})[pair] = row.log_rank_p
    return {
        name: dict(zip(by_pair, holm.adjusted(list(by_pair.values())), strict=True))
        for name, by_pair in found.items()
    }


def modes_table(pairs: Iterable[Pair], options: argparse.Namespace) -> list[dict[str, Any]]:
    """Distinct failure modes per 1000 simulations, of searches that ran their budget out."""
    rows = []
    for pair in pairs:
        root = options.directory / "modes" / pair.name
        for folder in sorted(path.parent for path in root.glob(f"*/*/{SETTINGS}")):
            campaign = open_campaign(folder)
            records = [record for record in campaign.records if record.status == "ok"]
            kinds = {"failed": [record for record in records if record.is_primary]}
            if campaign.settings.trials.jittered:
                kinds["robust"] = [record for record in records if record.is_robust]
            row = {"pair": pair.name, "sampler": folder.parent.name, "seed": int(folder.name)}
            row["trials"] = len(records)
            for kind, of in kinds.items():
                row[kind] = len(of)
                row[f"{kind}_modes"] = sorted({record.signature for record in of})
                row[f"{kind}_first"] = records.index(of[0]) + 1 if of else None
            rows.append(row)
    return rows


def confirmation(directory: Path) -> dict[str, Any]:
    """Share of the searches' failures that physics confirms, by pair and by copies that fail."""
    rows = list(read_rows(directory / CONFIRMED))
    by_pair: dict[str, list[bool]] = {}
    by_copies: dict[str, list[bool]] = {}
    for row in rows:
        by_pair.setdefault(row["pair"], []).append(row["confirmed"])
        if row["jittered"] is not None:
            copies = "{} of {}".format(*row["jittered"])
            by_copies.setdefault(copies, []).append(row["confirmed"])
    return {
        "failures": len(rows),
        "confirmed": sum(row["confirmed"] for row in rows),
        "by_pair": {name: f"{sum(of)} of {len(of)}" for name, of in by_pair.items()},
        "by_copies": {name: f"{sum(of)} of {len(of)}" for name, of in sorted(by_copies.items())},
    }


def print_rows(rows: Rows, corrected: dict[str, dict[str, float]]) -> None:
    """Print the searches as a table in Markdown."""
    heads = ("Pair", "Sampler", "Found", "Simulations", "Per failure", "Seconds", "p", "Holm")
    print(markdown.heads(*heads))
    for pair, of in rows.items():
        for row in of:
            rate, mean = row.falsification_rate, row.simulations_to_failure.restricted_mean
            per = row.simulations_per_failure
            adjusted = corrected.get(row.sampler, {}).get(pair)
            told = markdown.row(
                pair,
                f"`{row.sampler}`",
                f"{rate.value:.0%} of {row.searches} [{rate.low:.0%}, {rate.high:.0%}]",
                f"{mean.value:.1f} [{mean.low:.1f}, {mean.high:.1f}]",
                f"{per.value:.0f} [{per.low:.0f}, {per.high:.0f}]",
                f"{row.seconds_to_failure:.0f}",
                f"{row.log_rank_p:.2g}",
                "" if adjusted is None else f"{adjusted:.2g}",
            )
            print(told)
