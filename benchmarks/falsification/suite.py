"""The benchmark suite: how samplers do on frozen scenario and stack pairs.

    python -m benchmarks.falsification.suite rates DIR [--trials 200]
    python -m benchmarks.falsification.suite search DIR [--samplers random auto ...] [--repeats 10]
    python -m benchmarks.falsification.suite modes DIR [--budget 200] [--jittered 4]
    python -m benchmarks.falsification.suite confirm DIR
    python -m benchmarks.falsification.suite table DIR [-o OUT]

``rates`` draws uniform worlds and counts failures: what makes a pair easy or hard. ``search`` is
``mrta-falsify compare`` on each pair, on the kinematic engine; ``modes`` one search per sampler
that runs its budget out, with ``--jittered`` going for robust failures; ``confirm`` runs each
search's first failure, and its first robust one, again in PyBullet; ``table`` sums up what is in
DIR. Each goes on where it was interrupted; ``--pairs`` chooses pairs, by default all of the hard
half.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import sys
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.statistics import failure_probability
from mrta_falsify.campaigns.store import SETTINGS, Campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.trial import Job, campaign_specifications, judge
from mrta_falsify.verbs.campaign import open_store, run_store
from mrta_falsify.verbs.campaign_settings import new_settings
from mrta_falsify.verbs.search_outcomes import (
    SamplerRow,
    SearchOutcome,
    sampler_rows,
    survival_curves,
)
from mrta_falsify.verbs.searches import ComparisonPlan, outcomes, run_searches
from mrta_falsify.verbs.stored_trials import open_campaign, stored_world
from mrta_falsify.verbs.workers import local_workers
from reports.figure_searches import Curve, write_searches

HERE = Path(__file__).parent
SUITE = HERE / "suite.yaml"
CONFIRMED = "confirmed.jsonl"
ALL = "all pairs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """One scenario on one stack."""

    name: str
    scenario: str  #: in scenarios/, without its ending
    half: Literal["easy", "hard"]
    defects: tuple[str, ...] = ()
    layers: dict[str, str] = dataclasses.field(default_factory=dict)
    specifications: tuple[str, ...] = ()

    @property
    def stack(self) -> StackConfig:
        """On the kinematic engine."""
        layers = {name: Choice(value) for name, value in self.layers.items()}
        sound = StackConfig(engine=Choice("kinematic"), defects=self.defects)
        return codec.decode(
            StackConfig, codec.encode(sound) | codec.encode(layers), where=self.name
        )

    def plan(
        self, directory: Path, options: argparse.Namespace, *, stop_after: int = 1
    ) -> ComparisonPlan:
        """Searches on this pair."""
        settings = new_settings(
            str(HERE / "scenarios" / f"{self.scenario}.scenic"),
            output=directory,
            stack=self.stack,
            specs=self.specifications or campaign_specifications(self.stack),
            window=1,  # a search runs in one process: nothing has to run ahead
            jittered=options.jittered,
        )
        return ComparisonPlan(
            settings=settings,
            samplers=tuple(options.samplers),
            repeats=options.repeats,
            budget=options.budget,
            first_seed=options.seed,
            stop_after=stop_after,
        )


def read_suite() -> dict[str, Pair]:
    """The pairs by name."""
    data = yaml.safe_load(SUITE.read_text(encoding="utf-8"))
    pairs = [codec.decode(Pair, pair, where=str(SUITE)) for pair in data["pairs"]]
    return {pair.name: pair for pair in pairs}


# --- searches --------------------------------------------------------------------------------


def rates(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Uniform draws, run until decided: share of failures and cost of a trial."""
    for pair in pairs:
        folder = options.directory / "rates" / pair.name
        plan = pair.plan(folder, options, stop_after=0)
        trials = dataclasses.replace(plan.settings.trials, mode="exact", seed=options.seed)
        sampler = Choice("random")
        settings = dataclasses.replace(plan.settings, trials=trials, sampler=sampler, window=8)
        limits = Limits(budget=options.trials)
        with open_store(folder, settings) as store:
            result = run_store(store, limits, local_workers(options.workers))
        if result.ended == "interrupted":
            raise KeyboardInterrupt
        print(json.dumps(rate_row(pair.name, result.campaign.records)), flush=True)


def rate_row(name: str, records: Sequence[TrialRecord]) -> dict[str, Any]:
    """Share of failures with its interval, and what a trial took."""
    judged = [record for record in records if record.status == "ok"]
    failed = [record for record in judged if record.failed]
    share = failure_probability(len(failed), len(judged))
    specs = [v.spec for record in failed for v in record.verdicts if v.violated]
    return {
        "pair": name,
        "k": len(judged[0].candidate.u),
        "trials": len(judged),
        "failed": len(failed),
        "share": [round(v or 0.0, 4) for v in (share.estimate, share.low, share.high)],
        "modes": len({record.signature for record in failed}),
        "by": {spec: specs.count(spec) for spec in sorted(set(specs))},
        "best": round(min(record.score for record in judged), 4),
        "sim_s": round(statistics.median(record.sim_time for record in judged), 1),
        "wall_s": round(statistics.median(r.scene_s + r.wall_s for r in judged), 2),
    }


def search(pairs: Iterable[Pair], options: argparse.Namespace, *, modes: bool = False) -> None:
    """Searches of each pair, side by side; with ``modes`` they do not stop at a failure."""
    began = clock.monotonic()
    for pair in pairs:
        folder = options.directory / ("modes" if modes else "searches") / pair.name
        folder.mkdir(parents=True, exist_ok=True)
        plan = pair.plan(folder, options, stop_after=0 if modes else 1)

        def say(done: int, total: int, text: str, name: str = pair.name) -> None:
            minutes = (clock.monotonic() - began) / 60.0
            print(f"{minutes:5.1f} min  {name} {done}/{total}  {text}", flush=True)

        run_searches(plan, folder, workers=options.workers, on_search=say)


def confirm(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Run failures again in PyBullet, to the end of the episode.

    Of each search the first one, and the first that most of its copies share.
    """
    path = options.directory / CONFIRMED
    known = {(row["pair"], row["search"], row["id"]) for row in read_rows(path)}
    for pair in pairs:
        for settings in sorted(options.directory.glob(f"*/{pair.name}/*/*/{SETTINGS}")):
            kind, _, sampler, seed = settings.relative_to(options.directory).parts[:4]
            name = f"{kind}/{sampler}/{seed}"
            campaign = open_campaign(settings.parent)
            failed = [record for record in campaign.records if record.failed]
            robust = [record for record in failed if record.wanted]
            for record in {r.number: r for r in (*failed[:1], *robust[:1])}.values():
                if (pair.name, name, record.id) not in known:
                    row = {"pair": pair.name, "search": name, **in_physics(pair, campaign, record)}
                    append_row(path, row)
                    print(json.dumps(row), flush=True)


def in_physics(pair: Pair, campaign: Campaign, record: TrialRecord) -> dict[str, Any]:
    """What PyBullet says about a failure of the kinematic engine."""
    job = Job(
        world=stored_world(campaign, record),
        config=dataclasses.replace(pair.stack, engine=Choice("bullet")),
        specifications=pair.specifications or campaign_specifications(),
    )
    judged = judge(job, keep_trace=False)
    copies = record.jittered
    return {
        "id": record.id,
        "jittered": [copies.failed, copies.runs] if copies is not None else None,
        "kinematic": sorted(v.spec for v in record.verdicts if v.violated),
        "bullet": sorted(v.spec for v in judged.verdicts if v.violated),
        "confirmed": judged.failed,
    }


# --- what came of it -----------------------------------------------------------------------------


def table(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Rows per pair and for all pairs together, as JSON, and survival curves.

    Where copies were run once for robust failures and once for all.
    """
    options.output.mkdir(parents=True, exist_ok=True)
    out: dict[str, Any] = {"budget": options.budget}
    kinds = {"searches": False} | ({"searches_with_knife_edges": True} if options.jittered else {})
    for kind, knife_edges in kinds.items():
        out[kind], panels = searches_table(pairs, options, knife_edges=knife_edges)
        write_searches(panels, options.budget, options.output / f"{kind}.png")
        print_rows(out[kind])
    out["modes"] = modes_table(pairs, options)
    out["confirmation"] = confirmation(options.directory)
    path = options.output / "results.json"
    path.write_text(json.dumps(codec.finite(codec.encode(out)), indent=1) + "\n", encoding="utf-8")
    print(json.dumps({name: out[name] for name in ("modes", "confirmation")}, indent=1))


def searches_table(
    pairs: Iterable[Pair], options: argparse.Namespace, *, knife_edges: bool
) -> tuple[dict[str, tuple[SamplerRow, ...]], dict[str, dict[str, Curve]]]:
    """Rows and survival curves of the searches, per pair and of all pairs together."""
    rows: dict[str, tuple[SamplerRow, ...]] = {}
    panels: dict[str, dict[str, Curve]] = {}
    pooled: dict[str, list[SearchOutcome]] = {}
    for pair in pairs:
        plan = pair.plan(options.directory, options)
        folder = options.directory / "searches" / pair.name
        found = outcomes(plan, folder, knife_edges=knife_edges)
        if not found:
            continue
        rows[pair.name] = sampler_rows(found, options.budget)
        panels[pair.name] = survival_curves(found)
        for name, told in found.items():
            pooled.setdefault(name, []).extend(told)
    rows[ALL] = sampler_rows(pooled, options.budget)
    panels[ALL] = survival_curves(pooled)
    return rows, panels


def modes_table(pairs: Iterable[Pair], options: argparse.Namespace) -> list[dict[str, Any]]:
    """Distinct failure modes per 1000 simulations, of searches that ran their budget out."""
    rows = []
    for pair in pairs:
        root = options.directory / "modes" / pair.name
        for folder in sorted(path.parent for path in root.glob(f"*/*/{SETTINGS}")):
            campaign = open_campaign(folder)
            records = [record for record in campaign.records if record.status == "ok"]
            kinds = {"failed": [record for record in records if record.failed]}
            if campaign.settings.trials.jittered:
                kinds["robust"] = [record for record in records if record.wanted]
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


def print_rows(rows: dict[str, tuple[SamplerRow, ...]]) -> None:
    """The searches as a table in Markdown."""
    heads = ("Pair", "Sampler", "Found", "Simulations", "Per failure", "Seconds", "Log-rank p")
    print(f"| {' | '.join(heads)} |")
    print("|---" * len(heads) + "|")
    for pair, of in rows.items():
        for row in of:
            rate, mean = row.falsification_rate, row.simulations_to_failure.restricted_mean
            per = row.simulations_per_failure
            print(
                f"| {pair} | `{row.sampler}` | {rate.value:.0%} of {row.searches} "
                f"[{rate.low:.0%}, {rate.high:.0%}] | {mean.value:.1f} "
                f"[{mean.low:.1f}, {mean.high:.1f}] | {per.value:.0f} "
                f"[{per.low:.0f}, {per.high:.0f}] | {row.seconds_to_failure:.0f} | "
                f"{row.log_rank_p:.2g} |"
            )


def main() -> None:
    """Command line."""
    suite = read_suite()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("rates", "search", "modes", "confirm", "table"))
    parser.add_argument("directory", type=Path)
    parser.add_argument("--pairs", nargs="+", choices=list(suite), help="default: the hard half")
    parser.add_argument("--samplers", nargs="+", default=["random", "auto"])
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--budget", type=int, default=100)
    parser.add_argument("--trials", type=int, default=200, help="of rates")
    parser.add_argument("--seed", type=int, default=0, help="of the first repeat")
    parser.add_argument("--jittered", type=int, default=0, help="copies of each failing world")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=HERE / "results")
    options = parser.parse_args()
    names = options.pairs or [name for name, pair in suite.items() if pair.half == "hard"]
    pairs = [suite[name] for name in names]
    does: dict[str, Any] = {"rates": rates, "search": search, "confirm": confirm, "table": table}
    try:
        if options.what == "modes":
            search(pairs, options, modes=True)
        else:
            does[options.what](pairs, options)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
