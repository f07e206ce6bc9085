"""Times, proofs and quality of the allocators.

    python -m benchmarks.allocation.run PART [PART ...] [--smrta DIR] [-o FILE.json]

Parts: `smrta` (SMrTa's own set, DIR = its folder), `edge` (single SMrTa files with scaled and
common deadlines: proofs, cores re-checked), `hard` (our generated set), `scale`, `late`,
`smt` (side by side with our own SMT allocator), `cold`. Times are CPU time of this process,
warm: everything is compiled before anything is timed.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.allocation.generate import instances, travel_times
from mrta_falsify.core.allocation import AllocationProblem, OpenTask, RobotPlan
from mrta_falsify.core.seeding import stream as random_stream
from mrta_falsify.stack.allocation.checking import verify
from mrta_falsify.stack.allocation.exact import Exact, ExactOptions
from mrta_falsify.stack.allocation.insertion import Insertion, InsertionOptions
from mrta_falsify.stack.allocation.objective import completion_bound, score
from mrta_falsify.stack.allocation.stream import Batch, Stream
from mrta_falsify.stack.allocation.timing import closed_travel_times
from simulator_interface.formats.smrta import Case, read_case, read_travel_times

INSERTION = Insertion(InsertionOptions())
IMPROVING = Insertion(InsertionOptions(improvement_steps=2000))


def family(path: Path) -> str:
    return path.stem.rpartition("_d_")[0] or path.stem.rpartition("-")[0]


def batch_problem(case: Case, times, *, capacity=2, deadline=None) -> AllocationProblem:
    """All tasks of a file as one batch; ``deadline`` maps old deadlines to new ones."""
    tasks = tuple(
        dataclasses.replace(task, deadline=deadline(task.deadline) if deadline else task.deadline)
        for batch in case.batches
        for task in batch
    )
    robots = tuple(
        RobotPlan(robot=r, room=room, free_at=0.0, onboard=(), capacity=capacity)
        for r, room in enumerate(case.rooms)
    )
    return AllocationProblem(now=0.0, robots=robots, tasks=tasks, travel_times=np.array(times))


def cpu(work):
    began = time.process_time()
    result = work()
    return 1e3 * (time.process_time() - began), result


def best_of(work, repeats=3):
    found = [cpu(work) for _ in range(repeats)]
    return min(ms for ms, _ in found), found[-1][1]


def stream_ms(case: Case, times, allocator, *, capacity=2, delay=None):
    """CPU times [ms] per batch, times of re-plans, and the outcome."""
    count = sum(map(len, case.batches))
    stream = Stream(np.array(times), case.rooms, capacity, allocator, room_for=count)
    spent, replans = [], []
    random = random_stream(0, "benchmarks/allocation/delays")
    for arrival, tasks in zip(case.arrivals, case.batches, strict=True):
        began = time.process_time()
        stream._table.commit(arrival)
        stream.now = arrival
        spent.append(1e3 * (time.process_time() - began))
        if delay is not None:
            share, most = delay
            ends = stream._table.w.time[: len(case.rooms)]
            busy = [r for r in range(len(case.rooms)) if ends[r] > arrival]
            hit = {
                r: ends[r] + random.integers(1, most + 1) for r in busy if random.random() < share
            }
            ms, _ = cpu(lambda hit=hit: stream.feedback(hit))
            replans.append(ms)
        ms, _ = cpu(
            lambda tasks=tasks, arrival=arrival: stream.take(Batch(arrival=arrival, tasks=tasks))
        )
        spent[-1] += ms
    return spent, replans, stream.outcome()


def part_smrta(root: Path) -> dict:
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
    six = root.parent / "aws_hospital" / "travel_time_data_6rooms.csv"
    if six.exists():
        for path in sorted((root / "simulation").glob("*.json")):
            simulation[path.stem] = _simulation(path, _six_rooms(six))
    return {"single": single, "streams": streams, "simulation": simulation}


def _simulation(path: Path, times) -> str:
    case = read_case(path, rooms=len(times))
    _, _, outcome = stream_ms(case, times, INSERTION)
    return f"{outcome.answer.status}, {len(outcome.faults)} faults"


def _six_rooms(samples: Path):
    """Largest published times ``(6, 6)`` [s] of the AWS hospital, whole and closed."""
    times = np.zeros((6, 6))
    for line in samples.read_text().splitlines():
        start, end, *seconds = line.split(",")
        times[int(start), int(end)] = np.ceil(max(map(float, seconds)))
    return closed_travel_times(times)


def part_edge(root: Path, *, recheck=60) -> dict:
    times = read_travel_times(root / "travel_time_65_rooms.json").times
    problems = []
    for path in sorted((root / "single").glob("*-0.json")):
        case = read_case(path, rooms=len(times))
        for scale in (1.0, 0.8, 0.6, 0.5, 0.4):
            problems.append(
                (
                    path.stem,
                    f"x{scale:g}",
                    batch_problem(case, times, deadline=lambda d, s=scale: int(d * s)),
                )
            )
        tasks, robots = len(case.batches[0]), len(case.rooms)
        for h in (110, 120, 130, 145, 160) if tasks <= 4 * robots else ():
            horizon = int(h * (1 + max(0.0, tasks / robots - 1.5) / 4))
            problems.append(
                (
                    path.stem,
                    f"h{horizon}",
                    batch_problem(case, times, deadline=lambda d, s=horizon: s),
                )
            )
    return decide(problems, recheck)


def part_hard(*, recheck=20) -> dict:
    times = travel_times(0)
    problems, streams = [], collections.defaultdict(lambda: [0, 0, 0.0])
    for instance in instances(0, 3):
        case = _case(instance.data)
        if len(case.batches) == 1:
            problem = batch_problem(case, times, capacity=instance.capacity)
            problems.append((instance.name, "", problem))
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
    return {"single": decide(problems, recheck), "streams": table}


def _case(data: dict) -> Case:
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
    return Case(rooms=tuple(data["agents"]), arrivals=arrivals, batches=tuple(batches))


def decide(problems, recheck: int) -> dict:
    """Plans and proofs by `exact`, agreement with insertion and with `smt` on the cores."""
    exact = Exact(ExactOptions(improvement_steps=0, fewest_lost=False))
    spent, count, sizes, wrong, slow = [], collections.Counter(), collections.Counter(), [], []
    cores = []
    for name, what, problem in problems:
        ms, answer = cpu(lambda p=problem: exact.allocate(p))
        spent.append(ms)
        count[answer.status] += 1
        if ms > 1000.0:
            slow.append(f"{name} {what}: {ms / 1e3:.1f} s, {answer.status}")
            print(slow[-1], file=sys.stderr, flush=True)
        if verify(answer, problem):
            wrong.append(f"{name} {what}: {verify(answer, problem)[0]}")
        if INSERTION.allocate(problem).status == "plan" and answer.status != "plan":
            wrong.append(f"{name} {what}: insertion has a plan")
        if answer.infeasible is not None:
            sizes[len(answer.infeasible.core)] += 1
            cores.append((name, what, problem, answer.infeasible))
    return {
        "instances": len(problems),
        "answers": dict(count),
        "core_sizes": {str(k): sizes[k] for k in sorted(sizes)},
        "ms": {
            "median": round(float(np.median(spent)), 1),
            "p95": round(float(np.percentile(spent, 95)), 1),
            "max": round(max(spent), 1),
        },
        "within_1_s": f"{100 * np.mean(np.array(spent) <= 1000):.1f} %",
        "slower_than_1_s": slow,
        "contradictions": wrong,
        "cores_rechecked": recheck_cores(cores, recheck),
    }


def recheck_cores(cores, most: int) -> dict:
    """Cores again by z3 with a resource limit; and minimality by plans of our own."""
    from mrta_falsify.stack.allocation.smt import Smt, SmtOptions  # noqa: PLC0415

    smt = Smt(SmtOptions(resource_limit=4_000_000))
    verdict = collections.Counter()
    step = max(1, len(cores) // most)
    for _, _, problem, proof in cores[::step][:most]:
        tasks = tuple(task for task in problem.tasks if task.number in proof.core)
        answer = smt.allocate(dataclasses.replace(problem, tasks=tasks))
        kind = {"infeasible": "confirmed", "plan": "CONTRADICTED"}.get(answer.status, "not decided")
        verdict[kind] += 1
    return dict(verdict)


def part_smt(root: Path) -> dict:
    """Side by side with our own SMT allocator: times, and what its first plan costs."""
    from mrta_falsify.stack.allocation.smt import Smt, SmtOptions  # noqa: PLC0415

    times = read_travel_times(root / "travel_time_65_rooms.json").times
    rows = {}
    for path in sorted((root / "single").glob("t_1[05]_*-0.json")):
        problem = batch_problem(read_case(path, rooms=len(times)), times)
        ms, plan = cpu(lambda p=problem: Smt(SmtOptions(resource_limit=100_000_000)).allocate(p))
        quick, ours = best_of(lambda p=problem: INSERTION.allocate(p), 5)
        if plan.reason.startswith("z3 reached"):
            rows[path.stem] = {"smt_s": None, "insertion_ms": round(quick, 3)}
            continue
        improved = score(problem, IMPROVING.allocate(problem), "completion")
        ratio = score(problem, plan, "completion") / score(problem, ours, "completion")
        rows[path.stem] = {
            "smt_s": round(ms / 1e3, 2),
            "insertion_ms": round(quick, 3),
            "times_faster": round(ms / quick),
            "completion_ratio": round(ratio, 2),
            "gap_to_bound": f"{100 * (improved / completion_bound(problem) - 1):.0f} %",
        }
    done = [row for row in rows.values() if row["smt_s"] is not None]
    return {
        "instances": rows,
        "times_faster": {
            "min": min(r["times_faster"] for r in done),
            "median": float(np.median([r["times_faster"] for r in done])),
        },
        "completion_ratio_median": float(np.median([r["completion_ratio"] for r in done])),
    }


def big_case(robots=200, tasks=2000, batches=1, gap=80.0, slack=(170, 800)) -> Case:
    random = random_stream(1, "benchmarks/allocation/big")
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
    return Case(rooms=rooms, arrivals=tuple(b * gap for b in range(batches)), batches=tuple(groups))


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


def _all_open(case: Case) -> Case:
    """Everything is known at the start; 20 later reports come without new tasks."""
    later = tuple(30.0 * i for i in range(1, 21))
    return Case(rooms=case.rooms, arrivals=(0.0, *later), batches=(*case.batches, *([()] * 20)))


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
            for _ in range(3):
                _, ms, outcome = stream_ms(case, times, INSERTION, delay=(share, most))
                replans += ms
                late, unserved = len(outcome.answer.late), len(outcome.answer.unserved)
                assert not [fault for fault in outcome.faults if not fault.promise]
            found[f"{name}, {share:.0%} of robots 1-{most} s late"] = {
                "late": late,
                "unserved": unserved,
                "replan_ms": {
                    "median": round(float(np.median(replans)), 3),
                    "p99": round(float(np.percentile(replans, 99)), 3),
                },
            }
    return found


def part_cold() -> dict:
    """CPU seconds of the first answer in a new process, without and with compiled code kept."""
    code = (
        "import time;from benchmarks.allocation.run import *;"
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "parts", nargs="+", choices=("smrta", "edge", "hard", "scale", "late", "smt", "cold")
    )
    parser.add_argument("--smrta", type=Path, help="folder of SMrTa's instances")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if options.smrta is None and {"smrta", "edge", "smt"} & set(options.parts):
        parser.error("parts smrta, edge and smt need --smrta DIR")
    stream_ms(
        big_case(5, 20, 4),
        travel_times(0),
        Insertion(InsertionOptions(rescue_steps=2)),
        delay=(1.0, 300),
    )
    Exact(ExactOptions()).allocate(batch_problem(big_case(2, 8, slack=(60, 120)), travel_times(0)))
    results = {}
    for part in options.parts:
        work = globals()[f"part_{part}"]
        results[part] = work(options.smrta) if part in ("smrta", "edge", "smt") else work()
        print(json.dumps({part: results[part]}, indent=1), flush=True)
    if options.output:
        options.output.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
