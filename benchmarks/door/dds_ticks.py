"""How much time does a bridge to ROS 2's topics add to a tick?

    python -m benchmarks.door.dds_ticks

A stack that does nothing is asked over the door alone, and nodes that let all robots stand are
asked by the bridge, coupled `stepped`: in Python on Cyclone DDS, and in C++ on Fast DDS if that is
installed (`libfastrtps-dev`). Each tick carries odometry, scans, transforms and the clock out and
commands back. Rounds of all follow each other, so that they have the same machine; p50 is the
median of the rounds. The CPU time is that of the bridge and of all nodes.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
import yaml

from benchmarks.door.ticks import HERE
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.world import World
from mrta_falsify.verbs.bench.bench_worlds import fleet_world
from mrta_falsify.verbs.door_test.episodes import TIMED_TICKS, WARM_TICKS
from mrta_falsify.verbs.door_test.testing import WORLD
from scenic_worlds.layouts import load_world
from simulator_interface.episode import Episode

ROOT = HERE.parents[1]
FAST_NODE = ROOT / "tests" / "foreign" / "dds" / "fast_node.cpp"
FLEETS = (6, 24)


def nodes(folder: Path, robots: int) -> dict[str, list[str]]:
    """Give the commands of the nodes, by what they are."""
    driving = [sys.executable, "-m", "tests.foreign.dds.driving_node", "stepped", "-1e9"]
    found = {"bridge, Python node": [*driving, str(robots)]}
    if Path("/usr/include/fastrtps").exists() and shutil.which("g++"):
        program = folder / "fast_node"
        if not program.exists():
            libraries = ["-lfastrtps", "-lfastcdr", "-lpthread"]
            flags = ["-std=c++17", "-O2", str(FAST_NODE), "-o", str(program), *libraries]
            subprocess.run(["g++", *flags], check=True)
        shell = f'exec {program} "$ROS_DOMAIN_ID" {robots} still'
        found["bridge, C++ node on Fast DDS"] = ["sh", "-c", shell]
    return found


def stack(command: tuple[str, ...]) -> StackConfig:
    """Configure a stack in a process of its own."""
    env = {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    external = ExternalStack(command=command, env=env, folder=str(ROOT), branch="never")
    return dataclasses.replace(StackConfig(), stack=external, engine=Choice("kinematic"))


def numbered(world: World) -> World:
    """Name the robots as the nodes do, and leave out tasks, which name some of them."""
    robots = tuple(
        dataclasses.replace(robot, name=f"robot{i + 1}") for i, robot in enumerate(world.robots)
    )
    return dataclasses.replace(world, robots=robots, tasks=())


class Cost(NamedTuple):
    p50_us: float  #: of the time to ask a tick
    cpu_us: float  #: of the stack's processes, mean of a tick


def measured(config: StackConfig, world: World) -> Cost:
    """Run some ticks."""
    episode = Episode(world, config)
    ask, spent, before = episode.outside.talk.ask, [], 0.0

    def timed(*arguments):
        began = perf_counter()
        answer = ask(*arguments)
        spent.append(perf_counter() - began)
        return answer

    episode.outside.talk.ask = timed
    frames = episode.frames()
    try:
        for number in range(WARM_TICKS + TIMED_TICKS):
            if number == WARM_TICKS:
                before = cpu_of(episode)
            next(frames)
        cpu = cpu_of(episode) - before
    finally:
        frames.close()
    p50 = float(np.percentile(spent[WARM_TICKS:], 50.0))
    return Cost(p50 * 1e6, cpu / TIMED_TICKS * 1e6)


def cpu_of(episode: Episode) -> float:
    """Sum the CPU time that the stack's processes have taken [s]."""
    ticks = 0
    for process in episode.outside.talk._process._keeper.kept():
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])  # user and system, of proc(5)
    return ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="+", default=FLEETS)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for robots in arguments.robots:
            world = numbered(fleet_world(load_world(WORLD), StackConfig(), robots))
            stacks = {"door alone": (sys.executable, str(HERE / "ticks.py"), "--serve")}
            for label, command in nodes(folder, robots).items():
                settings = folder / f"{robots}-{len(stacks)}.yaml"
                settings.write_text(yaml.safe_dump({"commands": [command]}))
                bridge = ("-m", "simulator_interface.foreign.dds", str(settings))
                stacks[label] = (sys.executable, *bridge)
            spent: dict[str, list[Cost]] = {label: [] for label in stacks}
            for _ in range(arguments.rounds):
                for label, command in stacks.items():
                    spent[label].append(measured(stack(command), world))
            for label, rows in spent.items():
                found = Cost(
                    *(round(statistics.median(column)) for column in zip(*rows, strict=True))
                )
                print(json.dumps({"robots": robots, "stack": label, **found._asdict()}), flush=True)


if __name__ == "__main__":
    main()
