"""How long a scene takes: compile time, dimensions, milliseconds and attempts per program.

Run: ``python experiments/scenic/speed.py [PROGRAM ...] [--count 40] [--json FILE]``

Without programs: all shipped ones, and 20, 40 and 60 pieces of furniture uniform in the rooms of a
fixed floor. Times are CPU time of this process, without compiling.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from scenic_worlds.program import Program, RejectedScene, compile_program
from scenic_worlds.shipped import scenario_names, scenario_path

PROGRAMS = Path(__file__).parent / "programs"


def measured(program: Program, count: int, seed: int = 0) -> dict[str, Any]:
    """Times [ms] and attempts of ``count`` candidates of a random campaign."""
    times, attempts, failures = [], [], 0
    program.realise(program.candidate(seed, count))  # fills what is computed once
    for number in range(count):
        candidate = program.candidate(seed, number)
        began = time.process_time()
        try:
            found = program.realise(candidate)
        except RejectedScene:
            failures += 1
            continue
        times.append(1000.0 * (time.process_time() - began))
        attempts.append(found.attempts)
    kinds = [dimension.kind for dimension in program.space.dimensions]
    return {
        "k": len(kinds),
        "opaque": kinds.count("opaque"),
        "median_ms": round(statistics.median(times), 1) if times else None,
        "p90_ms": round(float(np.quantile(times, 0.9)), 1) if times else None,
        "attempts": round(statistics.mean(attempts), 1) if attempts else None,
        "failures": failures,
    }


def main() -> None:
    """Print one row per program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="*")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    cases: list[tuple[str, Path, dict[str, Any]]] = [
        (name, scenario_path(name), {}) for name in arguments.programs or scenario_names()
    ]
    if not arguments.programs:
        crowded = PROGRAMS / "crowded_rooms.scenic"
        cases += [(f"{n} pieces uniform", crowded, {"pieces": n}) for n in (20, 40, 60)]
    rows = {}
    print(
        f"{'program':24} {'compile s':>9} {'k':>4} {'opaque':>6} {'median':>7} {'p90':>7}", end=""
    )
    print(f" {'attempts':>8} {'failed':>6}")
    for name, path, params in cases:
        began = time.process_time()
        program = compile_program(path, params)
        compile_s = time.process_time() - began
        row = rows[name] = {"compile_s": round(compile_s, 2)} | measured(program, arguments.count)
        print(
            f"{name:24} {row['compile_s']:9} {row['k']:4} {row['opaque']:6} "
            f"{row['median_ms']!s:>7} {row['p90_ms']!s:>7} {row['attempts']!s:>8} "
            f"{row['failures']:6}",
            flush=True,
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
