"""The same run of a foreign stack again and again, in several processes and on both engines.

``python -m benchmarks.door.foreign_repeats STACK.yaml WORLD [--runs 20] [--processes 3]
[--horizon 10] [--people 0] [--engines kinematic bullet]``: prints the digests, how often each was
seen, and the real-time factor. The stack's command must be absolute, or found from here.
"""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import time
from collections import Counter
from pathlib import Path

from mrta_falsify.core.config import Choice, read_config
from mrta_falsify.verbs.worlds import find_world
from simulator_interface.simulate import simulate

ENGINES = ("kinematic", "bullet")


def run(task: tuple[str, str, str, float, int]) -> tuple[str, str, float]:
    """Run once; give the engine, the digest and the wall-clock time [s]."""
    stack, name, engine, horizon, people = task
    world = find_world(name)
    world = dataclasses.replace(world, horizon=horizon, humans=world.humans[:people])
    config = dataclasses.replace(read_config(Path(stack)), engine=Choice(engine))
    began = time.perf_counter()
    outcome = simulate(world, config)
    return engine, outcome.trace.digest, time.perf_counter() - began


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stack")
    parser.add_argument("world")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--processes", type=int, default=3)
    parser.add_argument("--horizon", type=float, default=10.0)
    parser.add_argument("--engines", nargs="+", default=ENGINES, choices=ENGINES)
    parser.add_argument("--people", type=int, default=0)
    options = parser.parse_args()
    tasks = [
        (options.stack, options.world, engine, options.horizon, options.people)
        for engine in options.engines
        for _ in range(options.runs)
    ]
    seen: Counter[tuple[str, str]] = Counter()
    walls: dict[str, list[float]] = {engine: [] for engine in ENGINES}
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for engine, digest, wall in pool.imap_unordered(run, tasks):
            seen[engine, digest] += 1
            walls[engine].append(wall)
            print(f"{engine} {digest[:16]} {wall:.1f} s", flush=True)
    for (engine, digest), count in sorted(seen.items()):
        factor = options.horizon / min(walls[engine])
        print(
            f"{engine}: {digest[:16]} in {count} of {options.runs}; best {factor:.2f} x real time"
        )


if __name__ == "__main__":
    main()
