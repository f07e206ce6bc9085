"""What a tick of the whole stack costs beside plain PyBullet, and beside ir-sim.

    pip install ir-sim
    python -m benchmarks.engine.beside --robots 6,24,100 --seconds 20

All in turn in one process, CPU time of a tick of 50 ms:

- the whole stack with all default specifications, on both engines, without copies of the run: what
  copies cost depends on the day more than on the fleet;
- `stepSimulation` alone, in that very run on PyBullet: the floor under any stack on PyBullet;
- ir-sim with as many robots that drive by its RVO on a circle: no solids, people, tasks, lidar or
  judges. It is left out where it is not installed.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import pybullet
import yaml

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.verbs.bench.bench_worlds import fleet_world
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import EpisodeRun

TICK = 0.05  # s
WARM = 40  # ticks that are not counted: kernels are loaded, all robots set out


class _Clock:
    """Adds up the CPU time of `stepSimulation`."""

    def __init__(self) -> None:
        self.spent = 0.0
        self._step = pybullet.stepSimulation

    def step(self, *args: Any, **named: Any) -> None:
        before = time.process_time()
        self._step(*args, **named)
        self.spent += time.process_time() - before


def stack_tick(robots: int, engine: str, ticks: int) -> tuple[float, float]:
    """Measure a tick of the whole stack, and what `stepSimulation` takes of it [s]."""
    config = StackConfig(engine=Choice(engine))
    world = fleet_world(load_world("aws_hospital_day"), config, robots)
    judges = build_specifications()
    run = EpisodeRun(world, config, specifications=judges, keep_trace=False, copies=False)
    clock = _Clock()
    try:
        for _ in range(WARM):
            run.advance()
        pybullet.stepSimulation = clock.step
        before = time.process_time()
        for _ in range(ticks):
            run.advance()
        return (time.process_time() - before) / ticks, clock.spent / ticks
    finally:
        pybullet.stepSimulation = clock._step
        run.close()


def irsim_tick(robots: int, ticks: int) -> float:
    """Measure a tick of ir-sim [s]."""
    irsim = importlib.import_module("irsim")
    side = 20.0 + robots
    world = {
        "world": {"height": side, "width": side, "step_time": TICK, "sample_time": TICK},
        "robot": [
            {
                "number": robots,
                "distribution": {
                    "name": "circle",
                    "radius": side / 2 - 2.0,
                    "center": [side / 2, side / 2],
                },
                "kinematics": {"name": "diff"},
                "shape": {"name": "circle", "radius": 0.25},
                "behavior": {"name": "rvo", "vxmax": 1.5, "vymax": 1.5, "acce": 1.0},
                "vel_min": [-1.0, -3.0],
                "vel_max": [1.0, 3.0],
            }
        ],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(yaml.safe_dump(world))
        env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
        for _ in range(WARM):
            env.step()
        before = time.process_time()
        for _ in range(ticks):
            env.step()
        return (time.process_time() - before) / ticks


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="6,24,100")
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated")
    arguments = parser.parse_args()
    os.environ.setdefault("MPLBACKEND", "Agg")
    ticks = round(arguments.seconds / TICK)
    has_irsim = importlib.util.find_spec("irsim") is not None
    print("| Robots | kinematic | PyBullet | stepSimulation | times it | ir-sim |")
    print("|---|---|---|---|---|---|")
    for robots in map(int, arguments.robots.split(",")):
        kinematic, _ = stack_tick(robots, "kinematic", ticks)
        bullet, plain = stack_tick(robots, "bullet", ticks)
        other = f"{1000 * irsim_tick(robots, ticks):.2f}" if has_irsim else "-"
        times = bullet / plain
        row = f"{1000 * kinematic:.2f} | {1000 * bullet:.2f} | {1000 * plain:.2f} | {times:.1f}"
        print(f"| {robots} | {row} | {other} |", flush=True)


if __name__ == "__main__":
    main()
