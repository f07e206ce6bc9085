"""Compile the kernels into numba's cache on disk, so that no test and no first run waits for it.

    python -m tools.compile_kernels STAMP

The Makefile runs it after an installation and after an edit of a source. ``STAMP`` holds the
digest of the kernels that are compiled; nothing is done if it is that of the sources. Two processes
compile at the same time, each what the other does not: the controller, and the rest in runs whose
robots stand. (numba does not lock its cache: two processes that need a kernel both compile it.)
What only a deadlock needs follows.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import itertools
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np

from mrta_falsify.commands.bench.bench_worlds import fleet_world
from mrta_falsify.commands.bench.controller_speed import time_controller
from mrta_falsify.core.compiled import PACKAGES, ROOT, digest_of_module
from mrta_falsify.core.config import Choice, StackConfig, default_engine
from mrta_falsify.core.fleet import Command
from mrta_falsify.core.protocols import ControlResult, ControlView
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.trial import Job, judge
from scenic_worlds.layouts import load_world
from scenic_worlds.zoo import load_scene
from simulator_interface.simulate import EpisodeRun

#: those whose libraries are installed
ENGINES = tuple(
    engine
    for engine in dict.fromkeys(("kinematic", "mujoco", default_engine()))
    if engine != "mujoco" or importlib.util.find_spec("mujoco")
)
ALLOCATORS = ("exact", "chain", "auction")
TICKS = 20  # of each run


class Still:
    """A controller without kernels: every robot stands."""

    @dataclass(frozen=True)
    class Options:
        """It has none."""

    def __init__(self, options: Options) -> None:
        pass

    def control(self, view: ControlView) -> ControlResult:
        robots = len(view.pose)
        return ControlResult(
            command=Command(twist=np.zeros((robots, 3))),
            cluster=np.arange(robots),
            leader=np.arange(robots),
            slack=np.zeros(robots),
            fallback=np.zeros(robots, dtype=bool),
        )


def compile_controller() -> None:
    """Compile what the controller calls."""
    time_controller(StackConfig(), 3)


def compile_runs() -> None:
    """Compile what allocators, planner, people, engines and specifications call."""
    standing = Choice(f"{__name__}:Still")
    for engine, allocator in zip(itertools.cycle(ENGINES), ALLOCATORS, strict=False):
        config = StackConfig(
            engine=Choice(engine), allocator=Choice(allocator), controller=standing
        )
        world = fleet_world(load_world("aws_hospital_day"), config, 3)
        judges = build_specifications()
        run = EpisodeRun(world, config, specifications=judges, keep_trace=False, copies=False)
        with contextlib.closing(run):
            for _ in range(TICKS):
                run.advance()


def compile_deadlock() -> None:
    """Compile what is called when robots wait for each other; the rest is in the cache."""
    world = load_scene("ring_of_six_areas_full").world
    judge(Job(world=world, config=StackConfig(), early_stop=True))


PARTS = {
    "controller": compile_controller,
    "runs": compile_runs,
    "deadlock": compile_deadlock,
}
ORDER = (("controller", "runs"), ("deadlock",))  # of one group at the same time


def digest_of_kernels() -> str:
    """Hash the modules with kernels, numba's version and this module."""
    modules = [
        module
        for package in PACKAGES
        for module in sorted((ROOT / package).rglob("*.py"))
        if "mrta_falsify.core.compiled import" in module.read_text(encoding="utf-8")
    ]
    parts = [numba.__version__, sys.version, Path(__file__).read_text(encoding="utf-8")]
    parts += [digest_of_module(module) for module in modules]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def compile_all() -> None:
    """Compile every part in a process of its own."""
    for group in ORDER:
        words = [[sys.executable, "-m", "tools.compile_kernels", "--part", part] for part in group]
        running = [subprocess.Popen(command, cwd=ROOT) for command in words]
        codes = [process.wait() for process in running]
        if any(codes):
            sys.exit(f"compiling failed: {', '.join(group)}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Compile the kernels into numba's cache.")
    parser.add_argument("stamp", nargs="?", type=Path, help="file with the digest of the kernels")
    parser.add_argument("--part", choices=tuple(PARTS), help="only this, in this process")
    options = parser.parse_args()
    if options.part:
        PARTS[options.part]()
        return
    digest = digest_of_kernels()
    if not (options.stamp.exists() and options.stamp.read_text() == digest):
        print("compiling the kernels (a minute, once)", flush=True)
        compile_all()
    options.stamp.write_text(digest)


if __name__ == "__main__":
    main()
