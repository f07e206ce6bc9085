"""Compiling the kernels once, half by each of the first two workers of a test run.

On a clean clone numba compiles for about 100 s of CPU. Two workers that begin their tests at once
compile the same kernels side by side. Here one compiles those of control and allocation, and the
other all the rest; then both read them from the cache on disk.
"""

from __future__ import annotations

import dataclasses
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FEW = 500  # tests; a smaller selection compiles what it needs, and no more
PATIENCE = 240.0  # s to wait for the other half; after that, compiling it twice is no harm


class Still:
    """A controller without kernels: every robot stands."""

    @dataclass(frozen=True)
    class Options:
        """It has none."""

    def __init__(self, options: Options) -> None:
        pass

    def control(self, view):
        from mrta_falsify.core.fleet import Command
        from mrta_falsify.core.protocols import ControlResult

        robots = len(view.pose)
        return ControlResult(
            command=Command(twist=np.zeros((robots, 3))),
            cluster=np.arange(robots),
            leader=np.arange(robots),
            slack=np.zeros(robots),
            fallback=np.zeros(robots, dtype=bool),
        )


def warm_kernels(selected: int, shared: Path) -> None:
    """Compile this worker's half and wait for the other; does nothing in other processes.

    Args:
        selected: number of tests to be run.
        shared: folder of this test run that both workers see.
    """
    halves = {"gw0": _warm_deciding, "gw1": _warm_the_rest}
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if worker not in halves or workers < len(halves) or selected < FEW:
        return
    flags = {name: shared / f"kernels-{name}" for name in halves}
    halves[worker]()
    flags[worker].touch()
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and not all(flag.exists() for flag in flags.values()):
        time.sleep(0.1)


def _warm_deciding() -> None:
    from mrta_falsify.core import registry
    from mrta_falsify.core.config import Choice, StackConfig
    from tests.stack.allocation_cases import problem
    from tests.stack.control_course import Course, line

    paths = [line((0.0, 0.0), (3.0, 0.0)), line((3.0, 0.0), (0.0, 0.0))]
    pose = [[0.0, 0.0, 0.0], [3.0, 0.0, np.pi]]
    person = {"humans": [[1.5, 1.5]], "human_velocity": [[0.0, -0.2]]}
    wall = [(-1.0, 1.0, 4.0, 1.0)]
    course = Course(pose=pose, paths=paths, walls=wall, **person)
    course.run(registry.build("controller", StackConfig().controller), 0.2)
    for name in ("auction", "chain", "exact"):
        registry.build("allocator", Choice(name)).allocate(problem(0, robots=2, tasks=2))


def _warm_the_rest() -> None:
    from mrta_falsify.core.config import Choice, StackConfig
    from mrta_falsify.trial import Job, judge
    from tests.scenes.worlds import cluttered_ward

    world = dataclasses.replace(cluttered_ward(), horizon=1.0)
    for engine in ("kinematic", "bullet"):
        config = StackConfig(engine=Choice(engine), controller=Choice(f"{__name__}:Still"))
        judge(Job(world=world, config=config))
