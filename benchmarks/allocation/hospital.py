"""The AWS hospital with each allocator: expected against actual deliveries.

python -m benchmarks.allocation.hospital [--allocators A,B] [--engine kinematic]
"""

from __future__ import annotations

import argparse
import json
import re

import numpy as np

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import Ledger
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import simulate

HERE = "mrta_falsify.stack.allocation"
ALLOCATORS = {
    "chain": "chain:Chain",
    "insertion": "insertion:Insertion",
    "exact": "exact:Exact",
    "auction": "auction:Auction",
    "nearest": "nearest:Nearest",
    "tsp": "tsp:Tsp",
    "smt": "smt:Smt",
}


class Deliveries:
    """Notes when tasks were expected, when they came, and whether they were late."""

    def __init__(self) -> None:
        self.expected: dict[int, float] = {}

    def start(self, world: World, dt: float) -> None:
        self.deadline = [task.deadline for task in world.tasks]
        self._ledger = Ledger(world)
        self.actual = self._ledger.delivered

    def update(self, frame: Frame) -> None:
        self._ledger.enter(frame.confirmed, frame.sensed.time)
        for event in frame.events:
            if event.kind == "assigned" and event.task not in self.expected:
                found = re.search(r"expected at ([\d.e+]+) s", event.detail)
                if found:
                    self.expected[event.task] = float(found[1])

    def verdict(self) -> Verdict:
        return Verdict(spec="deliveries", robustness=0.0, violated=False)


def measure(name: str, engine: str) -> dict:
    world = load_world("aws_hospital_day")
    seen = Deliveries()
    config = StackConfig(allocator=Choice(f"{HERE}.{ALLOCATORS[name]}"), engine=Choice(engine))
    outcome = simulate(world, config, specifications=[seen], keep_trace=False)
    errors = [seen.actual[k] - seen.expected[k] for k in sorted(seen.actual)]
    return {
        "ended": outcome.ended,
        "delivered": len(seen.actual),
        "late": sum(seen.actual[k] > seen.deadline[k] for k in seen.actual),
        "sum_of_completion_s": round(sum(seen.actual.values()), 1),
        "expected_s": [seen.expected[k] for k in sorted(seen.actual)],
        "actual_s": [round(seen.actual[k], 1) for k in sorted(seen.actual)],
        "actual_minus_expected_s": {
            "mean": round(float(np.mean(errors)), 1),
            "min": round(min(errors), 1),
            "max": round(max(errors), 1),
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--allocators", default=",".join(ALLOCATORS))
    parser.add_argument("--engine", default="kinematic")
    options = parser.parse_args()
    for name in options.allocators.split(","):
        print(json.dumps({name: measure(name, options.engine)}), flush=True)


if __name__ == "__main__":
    main()
