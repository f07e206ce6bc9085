"""Does a uniform point of the unit cube reproduce the distribution that Scenic itself samples?

Run: ``python experiments/scenic/distribution.py [PROGRAM ...] [--count 400] [--level 0.01]``

Every random primitive of every program, with what it depends on, is sampled ``count`` times by
Scenic (its own generators) and by the driver (uniform coordinates); one two-sample test per
coordinate of its value:
Kolmogorov-Smirnov, or chi-square on the contingency table where the values are few. The level is
that of the whole family of tests over all programs, by Holm's procedure.
"""

from __future__ import annotations

import argparse
import random
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scenic
from scenic.core.distributions import RejectionException, Samplable
from scipy.stats import chi2_contingency, ks_2samp

from experiments import holm
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.seeding import stream
from scenic_worlds.primitives import randomness
from scenic_worlds.primitives.driver import Driver
from scenic_worlds.primitives.naming import Found, find_primitives, roots_of
from scenic_worlds.primitives.plan import NodeRejected
from scenic_worlds.shipped import scenario_names, scenario_path

FEW = 12  # different values up to which a primitive counts as discrete


def numbers_of(value: Any) -> list[float]:
    """A sampled value as coordinates."""
    if isinstance(value, (int, float, np.number)):
        return [float(value)]
    return [float(part) for part in value]


def native_samples(path: Path, count: int) -> tuple[tuple[Found, ...], list[list[list[float]]]]:
    """Primitives of a program, and ``count`` values of each as Scenic samples them."""
    with randomness.seeded(1, "benchmark"):
        scenario = scenic.scenarioFromFile(str(path))
        primitives = find_primitives(roots_of(scenario))
        rows: list[list[list[float]]] = []
        random.seed(1)
        while len(rows) < count:
            try:
                values = Samplable.sampleAll([entry.value for entry in primitives])
            except RejectionException:
                continue
            rows.append([numbers_of(values[entry.value]) for entry in primitives])
    return primitives, rows


def driven_samples(path: Path, count: int) -> list[list[list[float]]]:
    """The same from uniform coordinates."""
    with randomness.seeded(2, "benchmark"):
        scenario = scenic.scenarioFromFile(str(path))
        primitives = find_primitives(roots_of(scenario))
        driver = Driver(scenario)
        steps = driver.steps([entry.value for entry in primitives], driver.all_units)
        draws = stream(0, f"benchmark/distribution/{path.stem}")
        sample = driver.begin()
        rows: list[list[list[float]]] = []
        while len(rows) < count:
            driver.source.set(draws.random(len(driver.space)))
            try:
                sample.nudge([], [], steps)
            except NodeRejected:
                continue
            rows.append([numbers_of(sample.values[entry.value]) for entry in primitives])
    return rows


def p_value(ours: Array, theirs: Array) -> float | None:
    """Of the hypothesis that both come from one distribution; None for a constant."""
    seen = np.unique(np.concatenate([ours, theirs]))
    if len(seen) == 1:
        return None
    if len(seen) > FEW:
        return float(ks_2samp(ours, theirs).pvalue)
    table = [[np.count_nonzero(side == value) for value in seen] for side in (ours, theirs)]
    return float(chi2_contingency(table).pvalue)


def main() -> None:
    """Print the smallest p-values, and whether the family of tests rejects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", nargs="*")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--level", type=float, default=0.01)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    own = Path(__file__).parent / "programs" / "primitives.scenic"
    named = [scenario_path(name) for name in arguments.programs or scenario_names()]
    found: list[tuple[float, str]] = []
    for path in named if arguments.programs else [own, *named]:
        began = time.process_time()
        primitives, theirs = native_samples(path, arguments.count)
        ours = driven_samples(path, arguments.count)
        tests = 0
        for i, entry in enumerate(primitives):
            a, b = (np.array([row[i] for row in rows]) for rows in (ours, theirs))
            for j in range(a.shape[1]):
                p = p_value(a[:, j], b[:, j])
                if p is not None:
                    found.append((p, f"{path.stem}: {entry.name}.{j}"))
                    tests += 1
        took = time.process_time() - began
        print(
            f"{path.stem:24} {len(primitives):4} primitives {tests:4} tests {took:6.1f} s of CPU",
            flush=True,
        )
    found.sort()
    rejected = sum(p <= arguments.level for p in holm.adjusted([p for p, _ in found]))
    below = np.mean([p < 0.05 for p, _ in found])
    print(f"{len(found)} tests, {100 * below:.1f} % below 0.05, smallest:")
    for p, name in found[:5]:
        print(f"  {p:.2g}  {name}")
    print(f"rejected at family-wise level {arguments.level} (Holm): {rejected}")


if __name__ == "__main__":
    main()
