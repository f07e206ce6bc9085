"""A long shift: Poisson tasks for hours; are memory and cost flat, is every task accounted for?

python -m experiments.long_shift --hours 8 --robots 24 --every 60 [--trace FILE] [--seed 0]
    [--set engine=kinematic]

People come and go: half of them work the first half of the shift, half the second, each for some
time more or less; at noon all of them are there.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.core.config import StackConfig
from mrta_falsify.process.usage import cpu_of_tree
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import Task, World, write_world
from mrta_falsify.trial import Job, run_job
from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.stacks import load_stack
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from simulator_interface.guard import guarded

MARK_EVERY = 600.0  # s of simulation


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


@dataclass(frozen=True, slots=True)
class Mark:
    """What a shift has cost up to a simulated time."""

    sim_s: float
    cpu_s: float  #: of all processes
    rss_mb: float  #: of all processes, shared pages counted once


def row_of(last: Mark, now: Mark) -> str:
    """Say what the time between two marks cost."""
    cpu, simulated = now.cpu_s - last.cpu_s, now.sim_s - last.sim_s
    factor, hourly = simulated / cpu, cpu / simulated * 3600.0
    hours = now.sim_s / 3600.0
    return f"{hours:5.2f} h  x{factor:5.1f}  {hourly:6.0f} s CPU/h  {now.rss_mb:6.0f} MB"


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
    config = load_stack(settings=args.settings)
    world = shift_world(args.hours, args.every, args.seed, args.robots)
    marks: list[Mark] = []

    def mark(sim_time: float) -> None:
        if marks and sim_time - marks[-1].sim_s < MARK_EVERY:
            return
        marks.append(Mark(sim_time, cpu_of_tree(os.getpid()), resident_mb()))
        if len(marks) > 1:
            print(row_of(marks[-2], marks[-1]), flush=True)

    with guarded():
        job = Job(world=world, config=config)
        outcome = run_job(job, keep_trace=args.trace is not None, on_progress=mark)
    spent = cpu_of_tree(os.getpid())
    print(f"ended {outcome.ended} at {outcome.sim_time:.0f} s, {spent:.0f} s of CPU")
    print(f"tasks {outcome.tasks}, contacts {outcome.contacts}")
    for verdict in outcome.verdicts:
        flag = f"violated at {verdict.violated_at}" if verdict.violated else "holds"
        print(f"  {verdict.spec:26} {verdict.robustness:9.3f}  {flag} {verdict.who}")
    if args.trace:
        write_trace(outcome.trace, args.trace)
        write_world(world, args.trace.with_suffix(".world.json"))
        print(f"trace: {args.trace.stat().st_size / 2**20:.0f} MB, {resident_mb():.0f} MB resident")
    if args.output:
        summary = {
            "tasks": dataclasses.asdict(outcome.tasks),
            "contacts": outcome.contacts,
            "ended": outcome.ended,
            "marks": [dataclasses.asdict(row) for row in marks],
            "violated": {v.spec: v.violated_at for v in outcome.verdicts if v.violated},
        }
        args.output.write_text(json.dumps(summary, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
