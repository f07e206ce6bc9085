"""The benchmark suite: how samplers do on frozen scenario and stack pairs.

    python -m experiments.falsification.suite rates DIR [--trials 200] [--perturbed 4]
    python -m experiments.falsification.suite search DIR [--samplers random auto ...] [--repeats 10]
    python -m experiments.falsification.suite modes DIR [--budget 200] [--perturbed 4]
    python -m experiments.falsification.suite confirm DIR
    python -m experiments.falsification.suite keep DIR --code VERSION [-o OUT]
    python -m experiments.falsification.suite table DIR [-o OUT]

``--suite tuning`` is what samplers may be tuned on. ``rates``
draws uniform worlds and counts failures: what makes a pair easy or hard, and the searches of
``random`` in the table. ``search`` is
``mrta-falsify compare`` on each pair, on the kinematic engine; ``modes`` one search per sampler
that runs its budget out, with ``--perturbed`` going for robust failures; ``confirm`` runs each
search's first failure, and its first robust one, again in PyBullet. ``keep`` adds what searches
and pools in DIR came to to files in OUT, so that machines and sessions may share a suite; ``table``
sums up both, and compares searches with pools. Each goes on where it was interrupted; ``--pairs``
chooses pairs, by default all of the hard half.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time as clock
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from experiments.falsification.kept import keep
from experiments.falsification.pairs import HERE, SUITES, Pair, read_suite
from experiments.falsification.pools import rates
from experiments.falsification.tables import CONFIRMED, table
from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.store import SETTINGS, Campaign
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.trial import Job, judge
from mrta_falsify.commands.searches import run_searches
from mrta_falsify.lab.stored import stored_world
from mrta_falsify.commands.stored_trials import open_campaign


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
        for settings in sorted(options.directory.glob(f"*/{pair.name}/**/{SETTINGS}")):
            name = "/".join(
                part
                for part in settings.parent.relative_to(options.directory).parts
                if part != pair.name
            )
            campaign = open_campaign(settings.parent)
            failed = [record for record in campaign.records if record.is_primary]
            robust = [record for record in failed if record.is_robust]
            for record in {r.number: r for r in (*failed[:1], *robust[:1])}.values():
                if (pair.name, name, record.id) not in known:
                    row = {"pair": pair.name, "search": name, **in_physics(pair, campaign, record)}
                    append_row(path, row)
                    print(json.dumps(row), flush=True)


def in_physics(pair: Pair, campaign: Campaign, record: TrialRecord) -> dict[str, Any]:
    """Say what PyBullet does with a failure of the kinematic engine."""
    specifications, then = pair.judged_by
    job = Job(
        world=stored_world(campaign, record),
        config=dataclasses.replace(pair.stack, engine=Choice("bullet")),
        specifications=specifications,
        then=then,
    )
    judged = judge(job, keep_trace=False)
    copies = record.vote
    return {
        "id": record.id,
        "jittered": [copies.failed, copies.runs] if copies is not None else None,
        "kinematic": sorted(v.spec for v in record.verdicts if v.violated),
        "bullet": sorted(v.spec for v in judged.verdicts if v.violated),
        "confirmed": judged.is_primary,
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    does: dict[str, Any] = {
        "rates": rates,
        "search": search,
        "modes": lambda pairs, options: search(pairs, options, modes=True),
        "confirm": confirm,
        "keep": keep,
        "table": table,
    }
    parser.add_argument("what", choices=does)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--suite", choices=SUITES, default="suite")
    parser.add_argument("--pairs", nargs="+", metavar="PAIR", help="default: the hard half")
    parser.add_argument("--samplers", nargs="+", default=["random", "auto"])
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--budget", type=int, default=100)
    parser.add_argument("--trials", type=int, default=200, help="of rates")
    parser.add_argument("--seed", type=int, default=0, help="of the first repeat")
    parser.add_argument("--perturbed", dest="jittered", type=int, default=0, help="copies of each failing world")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--code", default="", help="of keep: the version that proposed")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "results")
    options = parser.parse_args()
    if options.what == "keep" and not options.code:
        parser.error("keep: --code is missing; it says which version proposed, as a commit")
    suite = read_suite(options.suite)
    names = options.pairs or [name for name, pair in suite.items() if pair.half == "hard"]
    if unknown := set(names) - set(suite):
        parser.error(f"{', '.join(sorted(unknown))}: no such pair; there are {', '.join(suite)}")
    try:
        does[options.what]([suite[name] for name in names], options)
    except InputError as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
