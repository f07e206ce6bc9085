"""Do position and orientation come together as Scenic draws them, for every specifier of both?

Run: ``python -m experiments.scenic.specifiers [SPECIFIER ...] [--count 200] [--level 0.01]``

Each program of tests/scenic_worlds/specifiers.py is drawn by Scenic's own ``generate`` without
pruning (where Scenic can), with pruning, and by this project in the modes exact and repair. Each
row has the p-values of permutation tests on the energy distance against the first of these, and
what the test of mode exact finds in at least nine of ten repeats at its level: the least shift of
position, in standard deviations, and the least share of scenes whose orientation is drawn apart
from the position (a dash: not even all of them, as where something faces one way everywhere). The
level is that of the whole family of tests, by Holm's procedure.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments import holm
from mrta_falsify.core.arrays import Array
from tests.scenic_worlds.specifiers import (
    PROGRAMS,
    EnergyTest,
    drawn_apart,
    our_draws,
    scenics_draws,
    shifted,
    write,
)

REPEATS, ENOUGH = 10, 9
SHIFTS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)
SHARES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)


def least_found(
    levels: tuple[float, ...],
    change: Callable[[Array, float, np.random.Generator], Array],
    test: EnergyTest,
    pooled: Array,
    level: float,
) -> str:
    """The least deviation found in most repeats, between halves of the pooled draws."""
    numbers = np.random.default_rng(7)
    half = len(pooled) // 2
    for size in levels:
        found = 0
        for _ in range(REPEATS):
            mixed = pooled[numbers.permutation(len(pooled))]
            found += test.p_of(change(mixed[:half], size, numbers), mixed[half:]) <= level
        if found >= ENOUGH:
            return f"{size:.1f}"
    return "-"


def main() -> None:
    """Print a row for each specifier, and whether the family of tests rejects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specifiers", nargs="*")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--level", type=float, default=0.01)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    count = arguments.count
    p_values: dict[str, list[float]] = {"exact": [], "repair": [], "pruned": []}
    print(f"{'':28}{'p':>24}{'finds':>16}")
    columns = ("exact", "repair", "pruned", "shift", "apart", "CPU s")
    print(f"{'specifier':28}" + "".join(f"{column:>8}" for column in columns))
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.specifiers or PROGRAMS:
            began = time.process_time()
            path = write(name, Path(folder))
            theirs = scenics_draws(path, count).rows
            exact = our_draws(path, count, "exact", seed=2).rows
            drawn = {
                "exact": exact,
                "repair": our_draws(path, count, "repair", seed=3).rows,
                "pruned": scenics_draws(path, count, is_pruned=True, seed=1).rows,
            }
            tests = {
                mode: EnergyTest(rows, theirs, permutations=9999) for mode, rows in drawn.items()
            }
            for mode, test in tests.items():
                p_values[mode].append(test.p_value)
            pooled = np.concatenate([exact, theirs])
            powers = [
                least_found(levels, change, tests["exact"], pooled, arguments.level)
                for levels, change in (
                    (SHIFTS, lambda rows, size, _: shifted(rows, size)),
                    (SHARES, drawn_apart),
                )
            ]
            print(
                f"{name:28}"
                + "".join(f"{tests[mode].p_value:8.4f}" for mode in p_values)
                + "".join(f"{power:>8}" for power in powers)
                + f"{time.process_time() - began:8.1f}",
                flush=True,
            )
    for mode, found in p_values.items():
        rejected = sum(p <= arguments.level for p in holm.adjusted(found))
        below = sum(p < 0.05 for p in found)
        print(
            f"{mode}: {len(found)} tests, {below} below 0.05, "
            f"{rejected} rejected at family-wise level {arguments.level} (Holm)"
        )


if __name__ == "__main__":
    main()
