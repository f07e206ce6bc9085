"""A long shift: Poisson tasks for hours; is memory flat, is every task accounted for?

python -m benchmarks.long_shift --hours 8 --robots 24 --every 60 [--trace FILE] [--seed 0]
    [--set engine=kinematic]

People come and go: half of them work the first half of the shift, half the second, each for some
time more or less; at noon all of them are there.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import time
from pathlib import Path

from mrta_falsify.core.config import StackConfig, apply_setting
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import Task, World, write_world
from mrta_falsify.trial import Job, run_job
from mrta_falsify.verbs.bench.bench_worlds import fleet_world
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from simulator_interface.guard import guarded


def shift_world(hours: float, every: float, seed: int, robots: int) -> World:
    """``aws_hospital_day`` with tasks arriving every ``every`` s on average for ``hours``."""
    random = stream(seed, "long_shift")
    tasks, now = [], 0.0
    while True:
        now += float(random.exponential(every))
        if now > hours * 3600.0:
            break
        start, end = random.choice(6, size=2, replace=False).tolist()
        tasks.append(Task(arrival=now, start=start, end=end, deadline=now + 600.0))
    world = vary_world(load_world("aws_hospital_day"), seed)
    world = fleet_world(world, StackConfig(), robots)
    middle = hours * 1800.0
    people = []
    for number, person in enumerate(world.humans):
        early, late = random.uniform(0.8, 1.2) * middle, random.uniform(0.8, 1.2) * middle
        span = (0.0, max(early, late)) if number % 2 else (min(early, late), 2.0 * middle)
        people.append(dataclasses.replace(person, appears_at=span[0], leaves_at=span[1]))
    return dataclasses.replace(
        world,
        name=f"shift_{robots}",
        humans=tuple(people),
        tasks=tuple(tasks),
        horizon=hours * 3600.0 + 1200.0,
    )


def resident_mb(process: int | None = None) -> float:
    """Memory of a process and of all that it has started, shared pages counted once [MB]."""
    process = process or os.getpid()
    try:
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    own = sum(float(row.split()[1]) for row in rollup.splitlines() if row.startswith("Pss:"))
    return own / 1024.0 + sum(resident_mb(int(child)) for child in children)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0)
    parser.add_argument("--every", type=float, default=45.0)
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--trace", type=Path, help="keep the trace in this file")
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    config = StackConfig()
    for setting in args.settings:
        config = apply_setting(config, setting)
    world = shift_world(args.hours, args.every, args.seed, args.robots)
    marks: list[tuple[float, float, float]] = []

    def mark(sim_time: float) -> None:
        if not marks or sim_time - marks[-1][0] >= 600.0:
            marks.append((sim_time, time.perf_counter(), resident_mb()))
            if len(marks) > 1:
                (t0, w0, _), (t1, w1, mb) = marks[-2], marks[-1]
                factor = (t1 - t0) / (w1 - w0)
                print(f"{t1 / 3600:5.2f} h  x{factor:5.1f}  {mb:6.0f} MB", flush=True)

    with guarded():
        job = Job(world=world, config=config)
        outcome = run_job(job, keep_trace=args.trace is not None, on_progress=mark)
    print(f"ended {outcome.ended} at {outcome.sim_time:.0f} s, wall {outcome.wall_s:.0f} s")
    print(f"tasks {outcome.tasks}, contacts {outcome.contacts}")
    for verdict in outcome.verdicts:
        flag = f"violated at {verdict.violated_at}" if verdict.violated else "holds"
        print(f"  {verdict.spec:26} {verdict.robustness:9.3f}  {flag} {verdict.who}")
    if args.trace:
        write_trace(outcome.trace, args.trace)
        write_world(world, args.trace.with_suffix(".world.json"))
        print(f"trace: {args.trace.stat().st_size / 2**20:.0f} MB, {resident_mb():.0f} MB resident")
    if args.output:
        rows = [{"sim_s": t, "wall_s": w - marks[0][1], "rss_mb": m} for t, w, m in marks]
        summary = {
            "tasks": dataclasses.asdict(outcome.tasks),
            "contacts": outcome.contacts,
            "ended": outcome.ended,
            "marks": rows,
            "violated": {v.spec: v.violated_at for v in outcome.verdicts if v.violated},
        }
        args.output.write_text(json.dumps(summary, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
