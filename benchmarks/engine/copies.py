"""What copies of a run cost: a whole run with them and without, in turn.

    python -m benchmarks.engine.copies --world aws_hospital_day --engine kinematic --rounds 3

CPU time is that of all processes. Copies are those that the oracle and `repeatable` ask for.
"""

from __future__ import annotations

import argparse
import functools
import json
import os

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.process_clock import cpu_of_tree
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.verbs.bench.fleet_speed import NO_LIMITS
from scenic_worlds.layouts import load_world
from simulator_interface.guard import Guard
from simulator_interface.simulate import EpisodeRun


def whole_run(world: World, config: StackConfig, *, copies: bool) -> dict[str, float]:
    """Run a world to its end: simulated time and CPU time [s]."""
    run = EpisodeRun(
        world,
        config,
        specifications=build_specifications(),
        keep_trace=False,
        copies=copies,
        speculates=True,
    )
    root = os.getpid()
    before = cpu_of_tree(root)
    try:
        while not run.ended:
            run.advance()
        sim_time = run.outcome().sim_time
    finally:
        run.close()
    return {"sim_s": sim_time, "cpu_s": cpu_of_tree(root) - before}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", default="aws_hospital_day")
    parser.add_argument("--engine", default="kinematic")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    world, config = load_world(options.world), StackConfig(engine=Choice(options.engine))
    guard = Guard()
    try:
        for number in range(-1, options.rounds):  # the first round loads what is compiled
            for copies in (True, False):
                call = functools.partial(whole_run, world, config, copies=copies)
                done = guard.run(call, config=config, limits=NO_LIMITS, portable=True)
                factor = done["sim_s"] / done["cpu_s"]
                if number >= 0:
                    print(
                        json.dumps({"copies": copies, **done, "factor": round(factor, 1)}),
                        flush=True,
                    )
    finally:
        guard.close()


if __name__ == "__main__":
    main()
