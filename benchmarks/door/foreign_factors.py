"""What a second of simulated time costs with a foreign stack, and where the time goes.

``python -m benchmarks.door.foreign_factors STACK.yaml WORLD [--horizon 30] [--seed 0] [--people N]
[--engine NAME]``: runs once, unjudged and without copies. It prints the CPU time of the stack's
processes (from ``/proc``), of the harness inside the call of the stack (the door, and questions
that it answers), and of the rest of the harness (engine, people, books). Start-up is apart.

The factor is simulated seconds by seconds of CPU of both, start-up left out: harness and stack take
turns, so it is what one quiet core would give. Other work on the machine shows in caches only.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.world import World
from mrta_falsify.verbs.stacks import load_stack
from mrta_falsify.verbs.worlds import find_world
from simulator_interface.episode import Episode

WARM = 2.0  # s of simulated time before anything is measured
TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Spent:
    """CPU time to a moment [s]."""

    harness: float
    in_step: float  #: the part of it inside the call of the stack
    stack: float  #: its processes

    def since(self, before: Spent) -> Spent:
        """Give what was spent after ``before``."""
        return Spent(
            self.harness - before.harness,
            self.in_step - before.in_step,
            self.stack - before.stack,
        )


def cpu_of_children(process: int) -> float:
    """Sum the CPU time of all that a process has started, theirs included [s]."""
    task = Path(f"/proc/{process}/task/{process}")
    total = 0.0
    for child in map(int, (task / "children").read_text().split()):
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        # utime, stime, and those of children that have ended
        total += sum(map(int, fields[11:15])) / TICKS_PER_SECOND + cpu_of_children(child)
    return total


class Clock:
    """Reads what was spent; times the calls of the stack."""

    def __init__(self, running: Episode) -> None:
        self._in_step = 0.0
        running.stack.step = self._timed(running.stack.step)  # type: ignore[method-assign]

    def _timed(self, step: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            began = process_time()
            try:
                return step(*arguments)
            finally:
                self._in_step += process_time() - began

        return timed

    def read(self) -> Spent:
        """Read what was spent to date."""
        return Spent(process_time(), self._in_step, cpu_of_children(os.getpid()))


def measure(world: World, config: StackConfig) -> dict[str, float]:
    """Run a world; give seconds of CPU a simulated second, by where they go."""
    began, children = process_time(), cpu_of_children(os.getpid())
    running = Episode(world, config)
    clock = Clock(running)
    frames = running.frames()
    try:
        next(frames)
        first = clock.read()
        time = 0.0
        for frame in frames:
            time = frame.sensed.time
            if time >= world.horizon - 0.5 * running.dt:
                break
        spent = clock.read().since(first)
    finally:
        frames.close()
        running.close()
    parts = {
        "stack": spent.stack if config.stack is not None else spent.in_step,
        "door": spent.in_step if config.stack is not None else 0.0,
        "engine_people_books": spent.harness - spent.in_step,
    }
    return {
        "simulated_s": round(time, 2),
        "start_harness_s": round(first.harness - began, 2),
        "start_stack_s": round(first.stack - children, 2),
        "real_time_factor": round(time / sum(parts.values()), 2),
        "ms_a_tick": round(1e3 * sum(parts.values()) * running.dt / time, 2),
        **{f"{name}_percent": round(100 * s / sum(parts.values())) for name, s in parts.items()},
    }


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stack", type=Path, help="YAML, or - for the shipped stack")
    parser.add_argument("world")
    parser.add_argument("--horizon", type=float, default=30.0)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--people", type=int)
    parser.add_argument("--engine", default="kinematic")
    options = parser.parse_args()
    world = find_world(options.world, seed=options.seed)
    world = dataclasses.replace(
        world, horizon=options.horizon, humans=world.humans[: options.people]
    )
    engine = Choice(options.engine)
    shipped = dataclasses.replace(load_stack(), engine=engine)
    measure(dataclasses.replace(world, horizon=WARM), shipped)  # kernels are compiled or loaded
    config = shipped if str(options.stack) == "-" else load_stack(options.stack)
    found = measure(world, dataclasses.replace(config, engine=engine))
    print(json.dumps({"stack": str(options.stack), "world": world.name, **found}))


if __name__ == "__main__":
    main()
