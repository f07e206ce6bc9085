"""A Scenic program as a family of worlds; compiled once per process."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scenic
from scenic.core.distributions import RejectionException
from scenic.core.errors import ScenicError
from scenic.core.scenarios import Scenario

from mrta_falsify.core.errors import FormatError, UnknownNameError, WorldError
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import World
from simulator_interface.world_from_scene import world_from_scene

SCENARIO_DIR = Path(__file__).parent / "scenarios"
MAX_ITERATIONS = 2000


def scenario_names() -> tuple[str, ...]:
    """Names of the shipped programs."""
    return tuple(sorted(path.stem for path in SCENARIO_DIR.glob("*.scenic")))


def scenario_path(name_or_path: str) -> Path:
    """File of a shipped program's name, or of a path the user gave.

    Raises:
        UnknownNameError: neither a shipped program nor a file.
    """
    path = Path(name_or_path)
    if path.suffix == ".scenic" and path.is_file():
        return path
    if name_or_path in scenario_names():
        return SCENARIO_DIR / f"{name_or_path}.scenic"
    raise UnknownNameError("scenario", name_or_path, scenario_names())


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A compiled Scenic program."""

    name: str
    scenario: Scenario

    def sample(self, seed: int) -> World:
        """World drawn from the program's own distribution.

        Args:
            seed: decides everything random, >= 0.

        Raises:
            WorldError: no scene was accepted in 2000 attempts, or the scene is no world.
        """
        with _seeded(seed):
            try:
                scene, _ = self.scenario.generate(maxIterations=MAX_ITERATIONS)
            except RejectionException as error:
                raise WorldError(
                    f"{self.name}: no scene accepted in {MAX_ITERATIONS} attempts; "
                    f"last rejected by: {error}"
                ) from None
        return world_from_scene(scene, name=self.name, seed=seed)


def compile_program(path: Path, params: dict[str, Any] | None = None) -> Program:
    """Compile a Scenic file. It is code, and runs with the rights of whoever calls this.

    Args:
        path: a ``.scenic`` file over ``scenic_worlds.model``.
        params: global parameters to override.

    Raises:
        FormatError: the program does not compile; names file and line where Scenic does.
    """
    try:
        with _seeded(0):
            scenario = scenic.scenarioFromFile(str(path), params=params or {})
    except ScenicError as error:
        line = getattr(error, "lineno", None)
        where = f"{path}:{line}" if line else str(path)
        raise FormatError(f"{where}: {error}") from None
    if "_places" not in scenario.params:
        raise FormatError(f"{path}: has no `model scenic_worlds.model` at its top")
    return Program(name=path.stem, scenario=scenario)


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """Scenic draws from global generators: seed them inside its door, restore them after."""
    before = random.getstate(), np.random.get_state()  # noqa: NPY002
    numbers = stream(seed, "scenic")
    random.seed(int(numbers.integers(2**63)))
    np.random.seed(int(numbers.integers(2**32)))  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(before[0])
        np.random.set_state(before[1])  # noqa: NPY002
