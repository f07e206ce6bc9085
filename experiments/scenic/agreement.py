"""Does FastChecker accept and reject what Scenic's own BasicChecker does?

    python experiments/scenic/agreement.py [--samples N] [--seed S] [--json FILE]

Samples every program of tests/scenic_worlds/checker_programs (boxes, cylinders, cones,
spheroids, meshes that are not convex, tilted boxes, L-shaped regions, holes, random
containers, mutation, soft requirements, lines of sight) and every shipped program. Both
checkers judge each sample and, after it, a mixture of it and the sample before it: there
half of the objects are the same as in the last call, as in local resampling. Random draws
depend on the seed only, so the table is the same each time but for the times.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scenic
from scenic.core.distributions import RejectionException, Samplable
from scenic.core.sample_checking import BasicChecker

from mrta_falsify.core.seeding import stream
from scenic_worlds.checking import FastChecker
from scenic_worlds.shipped import SCENARIO_DIR

PROGRAMS = Path(__file__).parents[2] / "tests" / "scenic_worlds" / "checker_programs"


@dataclass(slots=True)
class Tally:
    program: str
    objects: int = 0
    checks: int = 0
    accepted: int = 0
    rejected: int = 0
    disagreements: int = 0
    basic_ms: float = 0.0  #: CPU time per check
    fast_ms: float = 0.0


def compare(path: Path, samples: int, seed: int) -> Tally:
    """Judge ``samples`` samples of a program, and as many mixtures, by both checkers."""
    numbers = stream(seed, f"agreement/{path.stem}")
    random.seed(int(numbers.integers(2**63)))
    np.random.seed(int(numbers.integers(2**32)))  # noqa: NPY002 - Scenic uses it
    scenario = scenic.scenarioFromFile(str(path))
    requirements = scenario.defaultRequirements + scenario.userRequirements
    basic, fast = BasicChecker(initialCollisionCheck=False), FastChecker()
    basic.setRequirements(requirements)
    fast.setRequirements(requirements)
    tally = Tally(path.stem, objects=len(scenario.objects))
    before = None
    while tally.checks < samples:
        for requirement in scenario.userRequirements:
            requirement.active = numbers.random() <= requirement.prob
        try:
            sample = Samplable.sampleAll(scenario.dependencies)
        except RejectionException:
            continue
        judge(sample, basic, fast, tally)
        if before is not None:
            judge(Mixture(scenario, before, sample, numbers), basic, fast, tally)
        before = sample
    tally.basic_ms = round(1e3 * tally.basic_ms / tally.checks, 3)
    tally.fast_ms = round(1e3 * tally.fast_ms / tally.checks, 3)
    return tally


def judge(sample: Any, basic: BasicChecker, fast: FastChecker, tally: Tally) -> None:
    # Whoever comes first pays for outlines that objects keep: take turns.
    order = [("basic_ms", basic), ("fast_ms", fast)]
    answers = {}
    for field, checker in order if tally.checks % 2 else order[::-1]:
        began = time.process_time()
        answers[field] = checker.checkRequirements(sample) is None
        setattr(tally, field, getattr(tally, field) + time.process_time() - began)
    tally.checks += 1
    tally.accepted += answers["basic_ms"]
    tally.rejected += not answers["basic_ms"]
    if answers["basic_ms"] != answers["fast_ms"]:
        tally.disagreements += 1
        print(f"{tally.program}, check {tally.checks}: {answers}, {fast.last}", file=sys.stderr)


class Mixture:
    """A sample with some objects of another one; reads like Scenic's mapping."""

    def __init__(self, scenario: Any, old: Any, new: Any, numbers: np.random.Generator) -> None:
        self._new, self._old = new, old
        self._kept = {id(item) for item in scenario.objects if numbers.random() < 0.5}

    def __getitem__(self, key: Any) -> Any:
        return (self._old if id(key) in self._kept else self._new)[key]

    def __contains__(self, key: Any) -> bool:
        return key in self._new


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=600, help="checks per test program")
    parser.add_argument("--shipped", type=int, default=60, help="checks per shipped program")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    jobs = [(path, args.samples) for path in sorted(PROGRAMS.glob("*.scenic"))]
    jobs += [(path, args.shipped) for path in sorted(SCENARIO_DIR.glob("*.scenic"))]
    rows = []
    print(
        f"{'program':24}{'objects':>8}{'checks':>8}{'accept':>8}{'reject':>8}{'differ':>8}"
        f"{'Scenic ms':>11}{'ours ms':>9}"
    )
    for path, samples in jobs:
        if not samples:
            continue
        row = compare(path, samples, args.seed)
        rows.append(row)
        print(
            f"{row.program:24}{row.objects:8}{row.checks:8}{row.accepted:8}{row.rejected:8}"
            f"{row.disagreements:8}{row.basic_ms:11.2f}{row.fast_ms:9.2f}",
            flush=True,
        )
    total = {
        name: sum(getattr(row, name) for row in rows)
        for name in ("checks", "accepted", "rejected", "disagreements")
    }
    print(f"total: {total}")
    if args.json:
        data = {"seed": args.seed, "total": total, "programs": [asdict(row) for row in rows]}
        args.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return 1 if total["disagreements"] else 0


if __name__ == "__main__":
    sys.exit(main())
