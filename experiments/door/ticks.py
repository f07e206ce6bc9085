"""How much time does a process of its own add to a tick?

    python -m experiments.door.ticks

A stack that does nothing is asked by the clock of ``mrta-falsify stack-test``, in Python and in C++,
and called in this process in the same run: rounds of the three follow each other, so that they
have the same machine. What is added is the difference of their medians; p50 of each is the median
of its rounds.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import World
from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.stack_test.episodes import TIMED_TICKS, WARM_TICKS, time_of_ticks
from mrta_falsify.commands.stack_test.testing import FLEETS, WORLD
from scenic_worlds.layouts import load_world
from simulator_interface.clients import mrta_stack
from simulator_interface.episode import Episode

HERE = Path(__file__).parent
CLIENTS = HERE.parents[1] / "simulator_interface" / "clients"


class Nothing:
    """Stands still."""

    def __init__(self, world: dict, harness: mrta_stack.Harness) -> None:
        self.robots = len(world["robots"])

    def step(self, tick: dict) -> dict:
        return {"twist": np.zeros((self.robots, 3))}


def commands(folder: Path) -> dict[str, tuple[str, ...]]:
    """Give the stacks that do nothing, by language."""
    found = {"Python": (sys.executable, str(HERE / "ticks.py"), "--serve")}
    compiler = shutil.which("c++")
    if compiler is not None:
        program = str(folder / "nothing_stack")
        flags = ["-std=c++17", "-O2", f"-I{CLIENTS}"]
        source = str(HERE / "nothing_stack.cpp")
        subprocess.run([compiler, *flags, "-o", program, source], check=True)
        found["C++"] = (program,)
    return found


def in_process(config: StackConfig, world: World) -> float:
    """Measure a call of a stack that does nothing, on what a tick tells it [us]."""
    stack = Nothing({"robots": world.robots}, None)  # type: ignore[arg-type]
    running = Episode(world, config)
    frames, spent = running.frames(), []
    try:
        for frame in frames:
            began = perf_counter()
            stack.step({"pose": frame.sensed.pose})
            spent.append(perf_counter() - began)
            if len(spent) == WARM_TICKS + TIMED_TICKS:
                break
    finally:
        frames.close()
    return float(np.percentile(spent[WARM_TICKS:], 50.0)) * 1e6


def measure(robots: int, rounds: int, stacks: dict[str, tuple[str, ...]]) -> dict[str, float]:
    """Measure p50 [us] of each way to call."""
    world = fleet_world(load_world(WORLD), StackConfig(), robots)
    plain = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))
    env = {"PYTHONPATH": str(HERE.parents[1])}
    configs = {
        language: dataclasses.replace(plain, stack=ExternalStack(command=command, env=env))
        for language, command in stacks.items()
    }
    found: dict[str, list[float]] = {"in process": [], **{name: [] for name in configs}}
    for _ in range(rounds):
        for language, config in configs.items():
            found[language].append(time_of_ticks(config, world).p50_us)
        found["in process"].append(in_process(configs["Python"], world))
    return {name: round(statistics.median(spent), 1) for name, spent in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="+", default=FLEETS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--serve", action="store_true", help="(internal) be the stack")
    arguments = parser.parse_args()
    if arguments.serve:
        mrta_stack.serve(Nothing, name="nothing")
        return
    with tempfile.TemporaryDirectory() as folder:
        stacks = commands(Path(folder))
        for robots in arguments.robots:
            found = measure(robots, arguments.rounds, stacks)
            added = {name: round(found[name] - found["in process"], 1) for name in stacks}
            print(json.dumps({"robots": robots, "p50_us": found, "added_us": added}), flush=True)


if __name__ == "__main__":
    main()
