"""Overhead of Scenic's loop against our own on the same scene, interleaved in one run.

    python benchmarks/scenic/loop_overhead.py [--rounds 3] [--engine kinematic] [-o FILE.json]

Three ways to run one scene of ``hospital_day``: our loop, Scenic's loop with nothing in the
program that looks at objects, and Scenic's loop with the 17 objects of the scene read back at
each of its steps (as any ``record``, monitor or behaviour makes it). CPU time, medians of the
rounds; the digests of all runs must agree.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import platform
import statistics
import time
from pathlib import Path

from mrta_falsify.core.config import Choice, StackConfig
from scenic_worlds.program import compile_program, scenario_path
from simulator_interface.scenic_bridge.simulator import PyBulletSimulator
from simulator_interface.simulate import simulate

RECORDS = """
record [obj.position for obj in simulation().objects] as positions
"""


def measure(engine: str, rounds: int, seed: int) -> dict:
    config = dataclasses.replace(StackConfig(), engine=Choice(engine))
    path = scenario_path("hospital_day")
    watched_path = Path(__file__).parent / "_hospital_day_watched.scenic"
    watched_path.write_text(path.read_text() + RECORDS)
    try:
        plain, watched = compile_program(path), compile_program(watched_path)
    finally:
        watched_path.unlink()
    scenes = {name: p.realise(p.candidate(seed)) for name, p in (("plain", plain), ("w", watched))}
    world = scenes["plain"].world

    def scenic(name: str) -> str:
        simulator = PyBulletSimulator(realise=lambda _: world, config=config, specifications=tuple)
        return simulator.simulate(scenes[name].scene, verbosity=0).outcome.trace.digest

    ways = {
        "own": lambda: simulate(world, config).trace.digest,
        "scenic": lambda: scenic("plain"),
        "scenic_watched": lambda: scenic("w"),
    }
    spent: dict[str, list[float]] = {name: [] for name in ways}
    digests = set()
    for turn in range(rounds + 1):  # the first round warms up
        for name, way in ways.items():
            began = time.process_time()
            digests.add(way())
            if turn:
                spent[name].append(time.process_time() - began)
    assert len(digests) == 1, digests
    cpu = {name: statistics.median(times) for name, times in spent.items()}
    return {
        "engine": engine,
        "rounds": rounds,
        "digest": digests.pop(),
        "cpu_s": {name: round(value, 3) for name, value in cpu.items()},
        "ratio": {name: round(value / cpu["own"], 3) for name, value in cpu.items()},
        "all_cpu_s": {name: [round(t, 3) for t in times] for name, times in spent.items()},
        "machine": platform.platform(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    text = json.dumps(measure(options.engine, options.rounds, options.seed), indent=1)
    print(text)
    if options.output:
        options.output.write_text(text + "\n")


if __name__ == "__main__":
    main()
