"""Planted defects: does the right specification catch each, and does the default stack pass?

    python -m experiments.defects.run [--variants 10] [--engine bullet] [--only NAME ...]
                                     [--workers 2] [-o FILE.json]

World 0 is the test world, worlds 1 to ``--variants`` are its sampled variants; each runs under
the default stack and under the stack with the defect.
"""

from __future__ import annotations

import argparse
import json
import time as wall_clock
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.specs.library import default_specifications
from mrta_falsify.testing.planted import PLANTS
from mrta_falsify.trial import Job, run_job

ENOUGH = 0.3  # share of the variants in which the defect must fail


def judge(defect: str, seed: int, engine: str) -> dict[str, Any]:
    """One world under both stacks."""
    plant = PLANTS[defect]
    world = plant.world(seed)
    names = tuple(dict.fromkeys((plant.specification, *default_specifications())))
    row: dict[str, Any] = {"defect": defect, "seed": seed, "world": world.digest()}
    for label, defects in (("default", ()), ("planted", (defect,))):
        config = StackConfig(engine=Choice(engine), defects=defects)
        began = wall_clock.perf_counter()
        outcome = run_job(Job(world=world, config=config, specifications=names), keep_trace=False)
        target = outcome.verdicts[0]
        row["specification"] = target.spec
        row[label] = {
            "robustness": round(target.robustness, 3),
            "violated": target.violated,
            "violated_at": target.violated_at,
            "who": list(target.who),
            "all_violated": [v.spec for v in outcome.verdicts if v.violated],
            "ended": outcome.ended,
            "sim_time_s": round(outcome.sim_time, 2),
            "wall_s": round(wall_clock.perf_counter() - began, 2),
        }
    return row


def summarise(defect: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the table says of one defect; ``rows`` by seed, the test world first."""
    first, variants = rows[0], rows[1:]
    passes = sum(not row["default"]["violated"] for row in variants)
    fails = sum(row["planted"]["violated"] for row in variants)
    return {
        "defect": defect,
        "specification": first["specification"],
        "test_world": bool(not first["default"]["violated"] and first["planted"]["violated"]),
        "variants": len(variants),
        "default_passes": passes,
        "default_passes_all_specs": sum(not row["default"]["all_violated"] for row in variants),
        "defect_fails": fails,
        "ok": bool(
            not first["default"]["violated"]
            and first["planted"]["violated"]
            and passes == len(variants)
            and fails >= ENOUGH * len(variants)
        ),
        "default_worst": min(row["default"]["robustness"] for row in rows),
        "defect_worst": min(row["planted"]["robustness"] for row in rows),
        "sim_s": round(sum(row["default"]["sim_time_s"] for row in rows) / len(rows), 1),
        "wall_s": round(
            sum(row[k]["wall_s"] for row in rows for k in ("default", "planted")) / len(rows) / 2, 2
        ),
    }


def collect(
    names: list[str], variants: int, engine: str, workers: int
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Summary and rows of each defect, as they come."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {
            name: [pool.submit(judge, name, seed, engine) for seed in range(variants + 1)]
            for name in names
        }
        for name in names:
            rows = [job.result() for job in jobs[name]]
            yield summarise(name, rows), rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--variants", type=int, default=10)
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--only", nargs="*", default=list(PLANTS), choices=list(PLANTS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-v", "--verbose", action="store_true", help="one line per world as well")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    table, details = [], []
    head = f"{'defect':30} {'specification':22} world default  defect  all specs  sim s  wall s"
    print(head, flush=True)
    for summary, rows in collect(args.only, args.variants, args.engine, args.workers):
        table.append(summary)
        details.extend(rows)
        n = summary["variants"]
        print(
            f"{summary['defect']:30} {summary['specification']:22} "
            f"{'ok' if summary['test_world'] else 'NO':5} "
            f"{summary['default_passes']:>4}/{n:<3} {summary['defect_fails']:>4}/{n:<3} "
            f"{summary['default_passes_all_specs']:>5}/{n:<4} "
            f"{summary['sim_s']:>6} {summary['wall_s']:>7}"
            f"{'' if summary['ok'] else '   NOT MET'}",
            flush=True,
        )
        for row in rows if args.verbose else ():
            for label in ("default", "planted"):
                r = row[label]
                print(
                    f"    {row['seed']:2} {label:8} {r['robustness']:8.2f} {r['ended']:15} "
                    f"{r['sim_time_s']:6.1f} s  {' '.join(r['all_violated'])}"
                )
    if args.output:
        data = {"engine": args.engine, "table": table, "worlds": details}
        args.output.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
