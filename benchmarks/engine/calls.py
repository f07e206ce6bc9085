"""Count the Python calls of a quiet tick, by file and by function.

    python -m benchmarks.engine.calls --engine kinematic --robots 6

A tick is quiet if nothing happens in it that the stack tells. Calls of compiled functions from
Python count, calls within compiled code do not.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.verbs.bench.bench_worlds import fleet_world
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import EpisodeRun

ROOT = Path(__file__).resolve().parents[2]
BEFORE = 400  # ticks that are not counted: tasks arrive, kernels are loaded
QUIET = 100  # ticks that are counted

Calls = Counter[tuple[str, str]]  #: by file and function


def count_calls(run: EpisodeRun, ticks: int) -> Calls:
    """Add up the calls of so many quiet ticks of a run."""
    total = Calls()
    for _ in range(BEFORE):
        run.advance()
    quiet = 0
    while quiet < ticks:
        calls = Calls()

        def note(frame: Any, event: str, _: Any, calls: Calls = calls) -> None:
            if event == "call":
                calls[frame.f_code.co_filename, frame.f_code.co_qualname] += 1

        sys.setprofile(note)
        try:
            happened = run.advance().events
        finally:
            sys.setprofile(None)
        if not happened:
            quiet += 1
            total += calls
    return total


def short_name(file: str) -> str:
    """Name a file relative to the project, or to the packages of others."""
    path = Path(file)
    if path.is_relative_to(ROOT) and "site-packages" not in path.parts:
        return str(path.relative_to(ROOT))
    return file.rpartition("site-packages/")[2]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--engine", default="kinematic", help="kinematic or bullet")
    parser.add_argument("--robots", type=int, default=6)
    parser.add_argument("--layout", default="aws_hospital_day", help="a shipped floor")
    parser.add_argument("--most", type=int, default=40, help="lines of each table")
    arguments = parser.parse_args()
    config = StackConfig(engine=Choice(arguments.engine))
    world = fleet_world(load_world(arguments.layout), config, arguments.robots)
    specifications = build_specifications()
    run = EpisodeRun(world, config, specifications=specifications, keep_trace=False, copies=False)
    try:
        calls = count_calls(run, QUIET)
    finally:
        run.close()
    print(f"{calls.total() / QUIET:7.1f} calls in a quiet tick")
    by_file = Calls()
    for (file, _), number in calls.items():
        by_file[short_name(file), ""] += number
    named = Calls({(short_name(file), name): number for (file, name), number in calls.items()})
    for table in (by_file, named):
        print()
        for (file, name), number in table.most_common(arguments.most):
            print(f"{number / QUIET:7.1f} {file} {name}".rstrip())


if __name__ == "__main__":
    main()
