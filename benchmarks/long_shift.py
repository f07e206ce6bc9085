"""A long shift: 6 robots, Poisson tasks for hours; is memory flat, is every task accounted for?

python benchmarks/long_shift.py --hours 4 [--every 45] [--seed 0] [--set engine=kinematic]
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
from mrta_falsify.core.world import Task, World
from mrta_falsify.specs.library import build_specifications
from scenic_worlds.layouts import load_world
from scenic_worlds.variation import vary_world
from simulator_interface.simulate import simulate

PAGE = os.sysconf("SC_PAGE_SIZE")


def shift_world(hours: float, every: float, seed: int) -> World:
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
    return dataclasses.replace(world, tasks=tuple(tasks), horizon=hours * 3600.0 + 1200.0)


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0)
    parser.add_argument("--every", type=float, default=45.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    config = StackConfig()
    for setting in args.settings:
        config = apply_setting(config, setting)
    world = shift_world(args.hours, args.every, args.seed)
    marks: list[tuple[float, float, float]] = []

    def mark(sim_time: float) -> None:
        if sim_time % 600.0 < 1.0 and (not marks or sim_time - marks[-1][0] > 300.0):
            marks.append((sim_time, time.perf_counter(), resident_mb()))
            if len(marks) > 1:
                (t0, w0, _), (t1, w1, mb) = marks[-2], marks[-1]
                factor = (t1 - t0) / (w1 - w0)
                print(f"{t1 / 3600:5.2f} h  x{factor:5.1f}  {mb:6.0f} MB", flush=True)

    outcome = simulate(
        world,
        config,
        specifications=build_specifications(),
        keep_trace=False,
        on_progress=mark,
    )
    print(f"ended {outcome.ended} at {outcome.sim_time:.0f} s, wall {outcome.wall_s:.0f} s")
    print(f"tasks {outcome.tasks}, contacts {outcome.contacts}")
    for verdict in outcome.verdicts:
        flag = f"violated at {verdict.violated_at}" if verdict.violated else "holds"
        print(f"  {verdict.spec:26} {verdict.robustness:9.3f}  {flag} {verdict.who}")
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
