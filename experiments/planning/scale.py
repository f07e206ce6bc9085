"""What allocation and planning cost with many robots: share of CPU, and goal fields known already.

    python -m experiments.planning.scale [--world NAME] [--seconds S] [--set LAYER=NAME]

Three worlds on the hospital: 24 robots with 96 tasks at once, 100 robots with 200 tasks arriving
over ten minutes, and 24 robots of the long shift. Each is a whole run with all default
specifications on the kinematic engine, without copies; CPU time of one process.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import time
from typing import Any

from experiments.long_shift import shift_world
from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.stack import dispatcher
from mrta_falsify.stack.planning.astar import AStar
from mrta_falsify.stack.planning_service import PlanningService
from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.bench.fleet_speed import Stopwatch
from mrta_falsify.commands.stacks import load_stack
from scenic_worlds.layouts import load_world
from simulator_interface.costmap_layers import BoundCostmap
from simulator_interface.simulate import EpisodeRun

#: stages: (class, method, name); the allocator's class is added
STAGES: tuple[tuple[type, str, str], ...] = (
    (dispatcher.Dispatcher, "dispatch", "dispatcher"),
    (PlanningService, "is_obstructed", "paths checked"),
    (PlanningService, "plan", "plans"),
    (AStar, "_extended_field", "goal fields asked"),
    (AStar, "_new_field", "goal fields begun"),
    (AStar, "use", "maps used"),
    (BoundCostmap, "_overlay", "maps built"),
)
ARRIVE_WITHIN = 600.0  # s


def at_once() -> World:
    """24 robots and 96 tasks, all there at 1 s."""
    world = fleet_world(load_world("aws_hospital_day"), StackConfig(), 24)
    tasks = tuple(dataclasses.replace(task, arrival=1.0) for task in world.tasks)
    return dataclasses.replace(world, tasks=tasks)


def arriving() -> World:
    """100 robots and 200 tasks that arrive over ten minutes."""
    world = fleet_world(load_world("aws_hospital_day"), StackConfig(), 100)
    arrivals = sorted(stream(0, "scale").uniform(0.0, ARRIVE_WITHIN, size=200).tolist())
    tasks = tuple(
        dataclasses.replace(task, arrival=arrival, deadline=arrival + 600.0)
        for task, arrival in zip(world.tasks, arrivals, strict=False)
    )
    return dataclasses.replace(world, tasks=tasks)


def shift() -> World:
    """The first of eight hours with 24 robots, a task a minute."""
    return shift_world(8.0, 60.0, 0, 24)


WORLDS = {"at_once": (at_once, 300.0), "arriving": (arriving, 600.0), "shift": (shift, 1200.0)}


def load_kernels(config: StackConfig) -> None:
    """Run a few seconds of a small fleet, so that nothing is compiled or loaded later."""
    world = fleet_world(load_world("aws_hospital_day"), StackConfig(), 6)
    with contextlib.closing(_run_of(world, config)) as run:
        for _ in range(100):
            run.advance()


def _run_of(world: World, config: StackConfig) -> EpisodeRun:
    judges = build_specifications()
    return EpisodeRun(world, config, specifications=judges, keep_trace=False, copies=False)


def measure(world: World, config: StackConfig, seconds: float) -> dict[str, Any]:
    """Run ``seconds`` of simulation; tell CPU time [s], calls and share of each stage."""
    allocator = type(registry.build("allocator", config.allocator))
    stages = (*STAGES, (allocator, "allocate", "allocator"))
    run = _run_of(world, config)
    watch = Stopwatch(time.process_time)
    with contextlib.closing(run), contextlib.ExitStack() as watched:
        run.advance()
        for owner, method, name in stages:
            watched.enter_context(watch.watching(owner, method, name))
        began, ticks = time.process_time(), 0
        while not run.ended and ticks < seconds * config.control_rate:
            run.advance()
            ticks += 1
        total = time.process_time() - began
        outcome = run.outcome()
    rows = {
        name: {
            "calls": watch.calls[name],
            "cpu_s": round(spent, 3),
            "share": round(spent / total, 4),
        }
        for name, spent in watch.seconds.items()
    }
    asked, begun = watch.calls["goal fields asked"], watch.calls["goal fields begun"]
    return {
        "simulated_s": ticks / config.control_rate,
        "cpu_s": round(total, 2),
        "delivered": outcome.tasks.completed,
        "fields_known": round(1.0 - begun / asked, 3) if asked else None,
        "digest": outcome.trace.digest,
        "stages": rows,
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", choices=sorted(WORLDS), action="append")
    parser.add_argument("--seconds", type=float, help="of simulation; default: by world")
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--format", choices=["text", "json"], default="text")
    arguments = parser.parse_args()
    config = load_stack(settings=["engine=kinematic", *arguments.settings])
    load_kernels(config)
    for name in arguments.world or WORLDS:
        build, seconds = WORLDS[name]
        result = measure(build(), config, arguments.seconds or seconds)
        if arguments.format == "json":
            print(json.dumps({"world": name, **result}), flush=True)
            continue
        stages = result.pop("stages")
        print(name, ", ".join(f"{key} {value}" for key, value in result.items()), flush=True)
        for stage, row in stages.items():
            each = 1e3 * row["cpu_s"] / max(1, row["calls"])
            print(
                f"  {stage:18s} {row['calls']:6d} calls {row['cpu_s']:8.2f} s "
                f"{100.0 * row['share']:5.1f} %  {each:8.3f} ms each"
            )


if __name__ == "__main__":
    main()
