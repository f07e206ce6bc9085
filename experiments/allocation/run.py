"""Times, proofs and quality of the allocators.

    python -m experiments.allocation.run PART [PART ...] [--smrta DIR] [-o FILE.json]

Parts: `smrta` (SMrTa's own set, DIR = its folder), `edge` (single SMrTa files with scaled and
common deadlines: proofs, cores re-checked), `hard` (our generated set), `scale`, `late`,
`loop` (`chain` batch by batch), `gap` (to a lower bound), `cold`. Times are CPU time of this process,
warm: everything is compiled before anything is timed.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from experiments.allocation.edge import part_edge, probe, summary
from experiments.allocation.generate import instances, travel_times
from experiments.allocation.measuring import (
    IMPROVING,
    INSERTION,
    batch_problem,
    best_of,
    cpu,
    family,
    stream_ms,
)
from mrta_falsify.core.allocation_problem import AllocationProblem
from mrta_falsify.core.allocation_problem import OpenTask
from mrta_falsify.core.seeding import stream as random_stream
from mrta_falsify.stack.allocation.chain import Chain, ChainOptions
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.objective import objective_value
from mrta_falsify.stack.allocation.proving import Prover
from mrta_falsify.stack.allocation.timing import closed_travel_times
from mrta_falsify.stack.allocation.verification import verify
from simulator_interface.formats.smrta import SmrtaCase, read_case, read_travel_times


def completion_bound(problem: AllocationProblem) -> float:
    """Sum of completion times [s] that no plan can undercut.

    Every task as if its best robot had nothing else to do; loads on board count with the
    robot that has them.
    """
    travel, total = problem.travel_times, 0.0
    carrier = {number: plan for plan in problem.robots for number in plan.onboard}
    for task in problem.tasks:
        ends = []
        able = [plan for plan in problem.robots if task.allows(plan.robot)]
        for plan in [carrier[task.number]] if task.number in carrier else able:
            time, room = max(plan.free_at, problem.now), plan.room
            if task.number not in carrier:
                time = max(time, task.arrival) + float(travel[room, task.start])
                time, room = time + task.pickup_time, task.start
            ends.append(time + float(travel[room, task.end]) + task.dropoff_time)
        total += min(ends, default=0.0)
    return total


def part_smrta(root: Path) -> dict:
    from scenic_worlds.layouts import load_world  # noqa: PLC0415 - no part of a cold start

    times = read_travel_times(root / "travel_time_65_rooms.json").times
    exact = Exact(ExactOptions())
    table: dict = collections.defaultdict(lambda: {"insertion_ms": [], "exact_ms": [], "ok": 0})
    for path in sorted((root / "single").glob("*.json")):
        problem = batch_problem(read_case(path, rooms=len(times)), times)
        row = table[family(path)]
        for name, allocator in (("insertion_ms", INSERTION), ("exact_ms", exact)):
            ms, answer = best_of(lambda a=allocator, p=problem: a.allocate(p))
            row[name].append(ms)
            row["ok"] += answer.status == "plan" and not verify(answer, problem)
    single = {
        name: {
            "files": len(row["exact_ms"]),
            "solved_and_verified": row["ok"] // 2,
            "insertion_ms": round(float(np.median(row["insertion_ms"])), 3),
            "exact_ms": round(float(np.median(row["exact_ms"])), 2),
        }
        for name, row in sorted(table.items())
    }
    streams = {}
    for path in sorted((root / "incremental").glob("*.json")):
        case = read_case(path, rooms=len(times))
        best = min((stream_ms(case, times, INSERTION) for _ in range(3)), key=lambda x: sum(x[0]))
        spent, _, outcome = best
        streams[path.stem] = {
            "status": outcome.answer.status,
            "faults": len(outcome.faults),
            "whole_ms": round(sum(spent), 2),
            "worst_batch_ms": round(max(spent), 2),
        }
    simulation = {}
    six = closed_travel_times(np.ceil(load_world("aws_hospital_day").travel_times))
    for path in sorted((root / "simulation").glob("*.json")):
        simulation[path.stem] = _simulation(path, six)
    return {"single": single, "streams": streams, "simulation": simulation}


def _simulation(path: Path, times) -> str:
    case = read_case(path, rooms=len(times))
    _, _, outcome = stream_ms(case, times, INSERTION)
    return f"{outcome.answer.status}, {len(outcome.faults)} faults"


def part_hard() -> dict:
    times = travel_times(0)
    problems, streams = [], collections.defaultdict(lambda: [0, 0, 0.0])
    for instance in instances(0, 3):
        case = _case(instance.data)
        if len(case.batches) == 1:
            problem = batch_problem(case, times, capacity=instance.capacity)
            problems.append(probe(instance.name, problem))
            continue
        delay = (0.5, 30) if instance.name.startswith("late") else None
        spent, _, outcome = stream_ms(
            case, times, INSERTION, capacity=instance.capacity, delay=delay
        )
        row = streams[instance.name.rpartition("-")[0]]
        assert not outcome.faults or delay
        row[0] += 1
        row[1] += len(outcome.answer.late)
        row[2] = max(row[2], *spent)
    table = {
        k: {"streams": n, "late": late, "worst_batch_ms": round(ms, 2)}
        for k, (n, late, ms) in streams.items()
    }
    return {"single": summary(problems), "streams": table}


def _case(data: dict) -> SmrtaCase:
    tasks, batches = 0, []
    for batch in data["tasks_stream"]:
        group = []
        for task in batch["tasks"]:
            group.append(
                OpenTask(
                    number=tasks,
                    arrival=float(batch["arrival"]),
                    pickup_time=1.0,
                    dropoff_time=1.0,
                    **task,
                )
            )
            tasks += 1
        batches.append(tuple(group))
    arrivals = tuple(float(batch["arrival"]) for batch in data["tasks_stream"])
    return SmrtaCase(rooms=tuple(data["agents"]), arrivals=arrivals, batches=tuple(batches))


def part_gap(root: Path) -> dict:
    """How far plans are from a lower bound, after 2,000 steps of improvement."""
    times = read_travel_times(root / "travel_time_65_rooms.json").times
    rows = {}
    for path in sorted((root / "single").glob("t_1[05]_*-0.json")):
        problem = batch_problem(read_case(path, rooms=len(times)), times)
        improved = objective_value(problem, IMPROVING.allocate(problem), "completion")
        rows[path.stem] = f"{100 * (improved / completion_bound(problem) - 1):.0f} %"
    return rows


def part_loop() -> dict:
    """CPU time [ms] of `chain` per batch of streams in which deadlines are lost."""
    times = travel_times(0)
    chain = Chain(ChainOptions())
    spent, rows = [], {}
    for robots, tasks, slack in ((5, 5, (40, 120)), (10, 10, (40, 120)), (20, 20, (40, 120))):
        case = big_case(robots, 40 * tasks, 40, gap=80.0, slack=slack)
        ms, _, outcome = stream_ms(case, times, chain)
        assert not outcome.faults
        spent += ms
        rows[f"{robots} robots, {tasks} tasks a batch"] = _spread(ms, outcome)
    return {"streams": rows, "all": _spread(spent)}


def _spread(ms, outcome=None) -> dict:
    found = {
        "batches": len(ms),
        "median": round(float(np.median(ms)), 2),
        "p99": round(float(np.percentile(ms, 99)), 2),
        "max": round(max(ms), 2),
    }
    return found if outcome is None else {**found, "late": len(outcome.answer.late)}


def big_case(robots=200, tasks=2000, batches=1, gap=80.0, slack=(170, 800)) -> SmrtaCase:
    random = random_stream(1, "experiments/allocation/big")
    times = travel_times(0)
    groups, number = [], 0
    for b in range(batches):
        arrival, group = b * gap, []
        for _ in range(tasks // batches):
            start, end = (int(x) for x in random.choice(len(times), 2, replace=False))
            group.append(
                OpenTask(
                    number=number,
                    start=start,
                    end=end,
                    arrival=arrival,
                    deadline=arrival + float(random.integers(*slack)),
                    pickup_time=1.0,
                    dropoff_time=1.0,
                )
            )
            number += 1
        groups.append(tuple(group))
    rooms = tuple(int(room) for room in random.integers(len(times), size=robots))
    return SmrtaCase(
        rooms=rooms, arrivals=tuple(b * gap for b in range(batches)), batches=tuple(groups)
    )


def part_scale() -> dict:
    times = travel_times(0)
    found = {}
    for name, case in (
        ("one batch", big_case(slack=(170, 1500))),
        ("20 batches", big_case(batches=20)),
        ("2000 single arrivals", big_case(batches=2000, gap=1.0)),
    ):
        spent, _, outcome = stream_ms(case, times, INSERTION)
        found[f"200 x 2000, {name}"] = {
            "late": len(outcome.answer.late),
            "faults": len(outcome.faults),
            "total_ms": round(sum(spent), 1),
            "worst_batch_ms": round(max(spent), 2),
        }
    return found


def _all_open(case: SmrtaCase) -> SmrtaCase:
    """Everything is known at the start; 20 later reports come without new tasks."""
    later = tuple(30.0 * i for i in range(1, 21))
    return SmrtaCase(
        rooms=case.rooms, arrivals=(0.0, *later), batches=(*case.batches, *([()] * 20))
    )


def part_late() -> dict:
    times = travel_times(0)
    found = {}
    for name, case in (
        ("20 x 200", big_case(20, 200, 20, slack=(150, 400))),
        ("200 x 2000", big_case(200, 2000, 20, slack=(150, 400))),
        ("20 x 200 all open", _all_open(big_case(20, 200, slack=(200, 900)))),
        ("200 x 2000 all open", _all_open(big_case(200, 2000, slack=(200, 900)))),
    ):
        for share, most in ((0.3, 20), (0.8, 60)):
            replans, late, unserved = [], 0, 0
            for seed in range(15 if len(case.rooms) == 20 else 5):
                _, ms, outcome = stream_ms(case, times, INSERTION, delay=(share, most), seed=seed)
                replans += ms
                late += len(outcome.answer.late)
                unserved += len(outcome.answer.unserved)
                assert not [fault for fault in outcome.faults if not fault.promise]
            found[f"{name}, {share:.0%} of robots 1-{most} s late"] = {
                "late": late,
                "unserved": unserved,
                "replans": len(replans),
                "replan_ms": {
                    "median": round(float(np.median(replans)), 3),
                    "p99": round(float(np.percentile(replans, 99)), 3),
                    "max": round(max(replans), 3),
                },
            }
    return found


def part_cold() -> dict:
    """CPU seconds of the first answer in a new process, without and with compiled code kept."""
    code = (
        "import time;from experiments.allocation.run import *;"
        "from mrta_falsify.stack.allocation.chain import *;"
        "c=big_case(5,10);s=stream_ms(c,travel_times(0),Chain(ChainOptions()));"
        "print(time.process_time())"
    )
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("nothing compiled", "compiled before"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            done = subprocess.run(
                [sys.executable, "-c", code],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            found[name] = round(float(done.stdout.split()[-1]), 2)
    return found


PARTS = {
    "smrta": part_smrta,
    "edge": part_edge,
    "hard": part_hard,
    "scale": part_scale,
    "late": part_late,
    "loop": part_loop,
    "gap": part_gap,
    "cold": part_cold,
}
NEED_SMRTA = {"smrta", "edge", "gap"}


def compile_everything() -> None:
    """Run every compiled function, and what is imported on first use, once."""
    stream_ms(
        big_case(5, 20, 4),
        travel_times(0),
        Insertion(InsertionOptions(rescue_steps=2)),
        delay=(1.0, 300),
    )
    one_deadline = big_case(5, 10)
    for seconds in (90.0, 110.0, 130.0):
        problem = batch_problem(one_deadline, travel_times(0), deadline=lambda _, s=seconds: s)
        prover = Prover(problem, 1_000_000)
        prover._list_sets()
        prover.fewest_lost()
        Prover(problem, 1_000_000).prove()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+", choices=tuple(PARTS))
    parser.add_argument("--smrta", type=Path, help="folder of SMrTa's instances")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if options.smrta is None and NEED_SMRTA & set(options.parts):
        parser.error("parts smrta, edge and gap need --smrta DIR")
    compile_everything()
    results = {}
    for part in options.parts:
        results[part] = PARTS[part](options.smrta) if part in NEED_SMRTA else PARTS[part]()
        print(json.dumps({part: results[part]}, indent=1), flush=True)
    if options.output:
        options.output.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
