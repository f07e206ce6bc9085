"""How alike the engines move, and what a tick costs on each.

    python -m experiments.engine.agree [--seconds 20] [--rounds 3]

Motion of one Waffle alone, the same commands on every engine:

- straight: way after 4 s at 1 m/s from a standstill;
- turn: angle after 4 s at 1.5 rad/s;
- stop: way from the command to stop at 1 m/s to rest;
- wall: how deep it is in a wall that it meets at 1.5 m/s, at worst.

Cost: CPU time of a tick of the engine alone (6 robots on circles among 8 people and the solids of
the hospital day), and of the whole stack on the same day without copies, in turn; the least of the
rounds.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import RobotSpec, Wall, World
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.commands.bench.bench_worlds import fleet_world
from scenic_worlds.layouts import load_world
from simulator_interface.simulate import EpisodeRun

TICK = 0.05  # s
WARM = 40  # ticks that are not counted: kernels are loaded, all robots set out

ENGINES = ("kinematic", "bullet", "mujoco")
CIRCLE = (0.3, 0.0, 0.9)
NOBODY = np.zeros((0, 2))


def course(engine: str, parts: list[tuple[float, float, float]], *, wall: bool) -> list[Sensed]:
    """Drive (seconds, forward [m/s], turn [rad/s]) one after the other."""
    robot = RobotSpec(name="robot1", pose=frozen_array([0.0, 0.0, 0.0]))
    walls = (Wall(name="wall", polygon=rectangle(0.2, 6.0, (4.0, 0.0))),) if wall else ()
    bounds = frozen_array([-30, -30, 30, 30])
    built = registry.build("engine", Choice(engine))
    seen = [built.start(World(name="c", bounds=bounds, robots=(robot,), walls=walls), TICK, NOBODY)]
    for seconds, forward, turn in parts:
        command = Command(twist=np.array([[forward, 0.0, turn]]))
        seen += [built.step(command, NOBODY) for _ in range(round(seconds / TICK))]
    built.close()
    return seen


def motion(engine: str) -> dict[str, float]:
    """Measure the four figures of one engine."""
    straight = course(engine, [(4.0, 1.0, 0.0)], wall=False)
    turned = course(engine, [(4.0, 0.0, 1.5)], wall=False)
    stopped = course(engine, [(3.0, 1.0, 0.0), (3.0, 0.0, 0.0)], wall=False)
    hit = course(engine, [(4.5, 1.5, 0.0)], wall=True)
    angle = np.unwrap([sensed.pose[0, 2] for sensed in turned])
    return {
        "straight m": straight[-1].pose[0, 0],
        "turn rad": angle[-1],
        "stop m": stopped[-1].pose[0, 0] - stopped[round(3.0 / TICK)].pose[0, 0],
        "wall mm": -1e3 * min(sensed.gap_static[0] for sensed in hit),
    }


def engine_tick(engine: str, ticks: int) -> tuple[float, float]:
    """CPU time of the start and of a tick [s], six robots on circles on the hospital day."""
    world = load_world("aws_hospital_day")
    built = registry.build("engine", Choice(engine))
    people = np.array([human.route[0] for human in world.humans])
    walk = np.tile([0.3, 0.0], (len(people), 1))
    command = Command(twist=np.tile(CIRCLE, (len(world.robots), 1)))
    began = time.process_time()
    built.start(world, TICK, people)
    start = time.process_time() - began
    for _ in range(WARM):
        built.step(command, walk)
    began = time.process_time()
    for k in range(ticks):
        built.step(command, walk if k // 40 % 2 else -walk)
    spent = (time.process_time() - began) / ticks
    built.close()
    return start, spent


def stack_tick(engine: str, ticks: int) -> float:
    """CPU time of a tick of the whole stack with all judges [s]."""
    config = StackConfig(engine=Choice(engine))
    world = fleet_world(load_world("aws_hospital_day"), config, 6)
    judges = build_specifications()
    run = EpisodeRun(world, config, specifications=judges, keep_trace=False, copies=False)
    for _ in range(WARM):
        run.advance()
    began = time.process_time()
    for _ in range(ticks):
        run.advance()
    spent = (time.process_time() - began) / ticks
    run.close()
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated, per run")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    ticks = round(options.seconds / TICK)
    moved = {engine: motion(engine) for engine in ENGINES}
    print("| engine | " + " | ".join(moved["bullet"]) + " |\n|---|" + "---|" * 4)
    for engine, found in moved.items():
        print(f"| {engine} | " + " | ".join(f"{value:.4f}" for value in found.values()) + " |")
    alone = {engine: [] for engine in ENGINES}
    whole = {engine: [] for engine in ENGINES}
    for _ in range(options.rounds):
        for engine in ENGINES:
            alone[engine].append(engine_tick(engine, ticks))
            whole[engine].append(stack_tick(engine, ticks))
    print("\n| engine | start ms | tick ms | x real time | whole stack ms | x real time |")
    print("|---|---|---|---|---|---|")
    for engine in ENGINES:
        start, tick = np.min(alone[engine], axis=0)
        stack = min(whole[engine])
        print(
            f"| {engine} | {1e3 * start:.0f} | {1e3 * tick:.2f} | {TICK / tick:.0f} | "
            f"{1e3 * stack:.2f} | {TICK / stack:.0f} |"
        )


if __name__ == "__main__":
    main()
