"""How long do STL formulas take, and are they right?

    python -m benchmarks.campaign.formulas --pairs 10000

Ten formulas over one 600 s run at 20 Hz: CPU time of their verdicts at its end, and of taking in
a tick. Then random formulas on random traces: robustness at every tick against the plain
numpy evaluator (bit for bit), and no verdict of "violated for good" on a prefix of a run that
satisfies the formula after all.
"""

from __future__ import annotations

import argparse
import json
import time
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import sentil

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from mrta_falsify.specs.stl import StlSpecification
from tests.specs import stl_reference
from tests.specs.stl_reference import Junction, Node, Not, Predicate, Temporal, Until

DT = 0.05  # s
SECONDS = 600.0
FORMULAS = (
    "always (gap > 0.2)",
    "always (gap > 0.5 or speed < 0.2)",
    "always (longest_stop < 60)",
    "eventually (left < 0.5)",
    "always (speed > 0.3 -> eventually[0, 20] (speed < 0.1))",
    "always (stopped > 0.5 -> eventually[0, 30] (stopped < 0.5))",
    "always[0, 300] (distance < 30)",
    "(speed > -1) until[0, 100] (left < 3)",
    "always (historically[0, 5] (speed < 0.05) -> longest_stop < 40)",
    "eventually[100, 500] (always[0, 10] (gap > 0.5))",
)


def scoring(repeats: int) -> dict[str, Any]:
    """CPU time of ten verdicts on one run."""
    ticks = round(SECONDS / DT)
    random = stream(0, "formulas")
    walk = np.abs(np.cumsum(random.normal(0.0, 0.05, size=(ticks, 6)), axis=0)) + 0.3
    names = ("gap", "speed", "longest_stop", "left", "stopped", "distance")
    rows = [dict(zip(names, row, strict=True)) for row in walk.tolist()]
    world = cast(World, SimpleNamespace(robots=(), horizon=SECONDS))
    specifications = []
    began = time.process_time()
    for text in FORMULAS:
        specification = StlSpecification(StlSpecification.Options(formula=text))
        specification.start(world, DT)
        for k, row in enumerate(rows):
            frame = SimpleNamespace(signals=row, sensed=SimpleNamespace(time=k * DT))
            specification.update(cast(Frame, frame))
        specifications.append(specification)
    per_tick = (time.process_time() - began) / ticks
    spent = []
    for _ in range(repeats):
        began = time.process_time()
        for specification in specifications:
            specification.verdict()
        spent.append(time.process_time() - began)
    return {
        "formulas": len(FORMULAS),
        "ticks": ticks,
        "verdicts_cpu_ms": round(1e3 * float(np.median(spent)), 2),
        "best_cpu_ms": round(1e3 * min(spent), 2),
        "taking_in_a_tick_cpu_us": round(1e6 * per_tick, 1),
    }


def random_formula(random: np.random.Generator, depth: int) -> Node:
    if depth == 0 or random.random() < 0.2:
        signal, relation = random.choice(["x", "y"]), random.choice(["<", "<=", ">", ">="])
        return Predicate(str(signal), cast(Any, str(relation)), int(random.integers(-20, 21)) / 8)
    inner = random_formula(random, depth - 1)
    low = int(random.integers(0, 5))
    high: int | None = None
    if random.random() < 0.3:
        low = 0
    else:
        high = low + int(random.integers(0, 9))
    kind = int(random.integers(4))
    if kind == 0:
        return Not(inner)
    if kind == 1:
        operator = str(random.choice(["always", "eventually", "historically", "once"]))
        return Temporal(cast(Any, operator), low, high, inner)
    other = random_formula(random, depth - 1)
    if kind == 2:
        return Junction(cast(Any, str(random.choice(["and", "or", "->"]))), inner, other)
    return Until(low, high, inner, other)


def agreement(pairs: int) -> dict[str, Any]:
    """Random pairs on which the engine differs, or decides too early."""
    different = decided = too_early = 0
    began = time.process_time()
    for number in range(pairs):
        random = stream(number, "formulas/pair")
        node = random_formula(random, 3)
        table = random.integers(-24, 25, size=(int(random.integers(1, 41)), 2)) / 8.0
        columns = {"x": table[:, 0].copy(), "y": table[:, 1].copy()}
        expected = stl_reference.robustness(node, columns)
        text = stl_reference.to_text(node)
        trace = sentil.Trace(np.arange(len(table), dtype=np.float64), cast(Any, columns))
        engine = sentil.Formula.parse(text).robustness_signal(trace)
        different += int(not np.array_equal(engine, expected))
        at = first_decision(text, table)
        decided += int(at is not None)
        too_early += int(at is not None and expected[0] >= 0.0)
    return {
        "pairs": pairs,
        "different": different,
        "decided_before_the_end": decided,
        "decided_wrongly": too_early,
        "cpu_s": round(time.process_time() - began, 1),
    }


def first_decision(text: str, table: np.ndarray) -> float | None:
    """Time at which the specification says "violated for good", on the way."""
    specification = StlSpecification(StlSpecification.Options(formula=text))
    specification.start(cast(World, SimpleNamespace(robots=(), horizon=1e9)), 1.0)
    for k, (x, y) in enumerate(table.tolist()):
        frame = SimpleNamespace(signals={"x": x, "y": y}, sensed=SimpleNamespace(time=float(k)))
        specification.update(cast(Frame, frame))
    return specification.verdict().violated_at


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=15)
    arguments = parser.parse_args()
    print(json.dumps(scoring(arguments.repeats)), flush=True)
    print(json.dumps(agreement(arguments.pairs)))


if __name__ == "__main__":
    main()
