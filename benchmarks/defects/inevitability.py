"""Planted defects: was the failure decided before its onset, and by the layer that was planted?

    python -m benchmarks.defects.inevitability [--only NAME ...] [--engine bullet]
                                               [--rewinds 80] [-o FILE.json]

Each defect's test world runs under the stack with the defect and is explained as `explain` does:
the run is repeated from earlier and earlier, as it is and with one layer replaced. `others` counts
other changes that would have averted the failure as well.
"""

from __future__ import annotations

import argparse
import json
import os
import time as wall_clock
from pathlib import Path
from typing import Any

from benchmarks.defects.worlds import PLANTS
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import DEFECTS
from mrta_falsify.core.inevitability import moves_the_turn
from mrta_falsify.trial import Job
from mrta_falsify.verbs.explain import REWINDS
from mrta_falsify.verbs.explain.explaining import explain_job

MAX_RUNS = 14  # of the other parts of an explanation: one for each change


def measure(defect: str, engine: str, rewinds: int) -> dict[str, Any]:
    """Explain the failure of one defect's test world."""
    plant = PLANTS[defect]
    job = Job(
        world=plant.world(0),
        config=StackConfig(engine=Choice(engine), defects=(defect,)),
        specifications=(plant.specification,),
        early_stop=True,
    )
    began, cpu = wall_clock.perf_counter(), _cpu()
    found = explain_job(job, max_runs=MAX_RUNS, rewinds=rewinds).inevitability
    assert found is not None
    stack, *others = found.curves
    movers = [curve for curve in others if moves_the_turn(curve, stack)]
    return {
        "defect": defect,
        "planted": DEFECTS[defect].layer,
        "by": found.by,
        "decided_at": found.decided_at,
        "onset": found.onset,
        "found": found.found,
        "before_onset": found.decided_at is not None and found.decided_at < found.onset,
        "is_planted": found.by == DEFECTS[defect].layer,
        "others": [curve.change for curve in movers if curve.name != found.by],
        "copies": found.runs,
        "cpu_s": round(_cpu() - cpu, 1),
        "wall_s": round(wall_clock.perf_counter() - began, 1),
        "curves": codec.encode(found.curves),
    }


def _cpu() -> float:
    """CPU time [s] of this process and of the copies that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(PLANTS), choices=list(PLANTS))
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--rewinds", type=int, default=REWINDS)
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    print(f"{'defect':30} {'planted':18} {'by':18} decided  onset  found  copies  cpu s  others")
    table = []
    for name in args.only:
        row = measure(name, args.engine, args.rewinds)
        table.append(row)
        print(
            f"{name:30} {row['planted']:18} {row['by']:18} {row['decided_at']:>7} "
            f"{row['onset']:6.1f} {row['found']:6.1f} {row['copies']:>7} {row['cpu_s']:>6}  "
            f"{len(row['others'])}{'' if row['before_onset'] else '   NOT BEFORE'}"
            f"{'' if row['is_planted'] else '   OTHER LAYER'}",
            flush=True,
        )
        if args.output:
            data = {"engine": args.engine, "rewinds": args.rewinds, "table": table}
            args.output.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    before = sum(row["before_onset"] for row in table)
    planted = sum(row["is_planted"] for row in table)
    print(f"before the onset: {before} of {len(table)}; by the planted layer: {planted}")


if __name__ == "__main__":
    main()
