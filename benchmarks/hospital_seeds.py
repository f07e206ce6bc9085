"""`aws_hospital_day` over seeds: who finishes, who touches whom, which deadlines hold.

python benchmarks/hospital_seeds.py --seeds 20 --workers 2 [--engine kinematic] [--set ...]
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from mrta_falsify.trial import Job, run_job
from mrta_falsify.verbs.stacks import load_stack
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world


def run_seed(seed: int, world_name: str, settings: tuple[str, ...]) -> dict[str, object]:
    config = load_stack(settings=settings)
    world = vary_world(load_world(world_name), seed)
    outcome = run_job(Job(world=world, config=config), keep_trace=False)
    return {
        "seed": seed,
        "ended": outcome.ended,
        "sim_time_s": round(outcome.sim_time, 2),
        "real_time_factor": round(outcome.sim_time / outcome.wall_s, 1),
        "robots_finished": outcome.robots_finished,
        "completed": outcome.tasks.completed,
        "total": outcome.tasks.total,
        "late": outcome.tasks.late,
        "contacts": outcome.contacts,
        "violated": [
            f"{v.spec}@{v.violated_at:.1f}" if v.violated_at is not None else v.spec
            for v in outcome.verdicts
            if v.violated
        ],
        "robustness": {v.spec: round(v.robustness, 3) for v in outcome.verdicts},
        "evidence": {v.spec: v.evidence for v in outcome.verdicts if v.violated},
        "digest": outcome.trace.digest,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", default="aws_hospital_day")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.seeds)
    rows = []
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(run_seed, seed, args.world, tuple(args.settings)) for seed in seeds]
        for job in jobs:
            row = job.result()
            rows.append(row)
            print(
                f"seed {row['seed']:3} {row['ended']:15} {row['sim_time_s']:7.1f} s  "
                f"x{row['real_time_factor']:5.1f}  robots {row['robots_finished']}  "
                f"tasks {row['completed']}/{row['total']} late {row['late']}  "
                f"{row['contacts']}  {', '.join(row['violated'])}",
                flush=True,
            )
    finished = sum(row["completed"] == row["total"] for row in rows)
    print(f"all tasks done in {finished} of {len(rows)} seeds")
    if args.output:
        args.output.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
