"""A Scenic program as a family of worlds; compiled once per process."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from scenic.core.pruning import matchInRegion
from scenic.core.scenarios import Scenario, Scene

from mrta_falsify.core.candidate import Candidate, SearchSpace, candidate_of
from mrta_falsify.core.errors import (
    ConfigError,
    FormatError,
    InputError,
    UnknownNameError,
    WorldError,
)
from mrta_falsify.core.world import World
from scenic_worlds.checking import FastChecker
from scenic_worlds.compile_errors import scenic_line
from scenic_worlds.compiling import check_tasks, compile_scenario
from scenic_worlds.origins import origin_of
from scenic_worlds.primitives import randomness
from scenic_worlds.primitives.driver import Driver
from scenic_worlds.primitives.plan import NodeRejected
from scenic_worlds.repair import MAX_ATTEMPTS, RejectedScene, SceneSearch
from scenic_worlds.shipped import scenario_path
from scenic_worlds.sources import sources_digest
from scenic_worlds.validity import WorldValidity
from simulator_interface.scenic_bridge.world_from_scene import world_from_scene

__all__ = [
    "Mode",
    "Program",
    "Realised",
    "RejectedScene",
    "compile_program",
    "scenario_path",
]

#: ``exact``: whole-scene rejection, Scenic's distribution; ``repair``: local resampling
Mode = Literal["repair", "exact"]


@dataclass(frozen=True, slots=True)
class Outside:
    """A thing that lies outside its region in one draw; names are empty where there are none."""

    name: str
    region: str  #: that should contain it
    placed: str  #: that its position is drawn from
    where: str  #: ``file:line`` that makes it


@dataclass(frozen=True, slots=True, eq=False)
class Realised:
    """A candidate that became a world."""

    world: World
    scene: Scene  #: Scenic's, for programs that are simulated by Scenic
    candidate: Candidate  #: gives the world by itself, in one attempt
    attempts: int  #: scenes tried until one was accepted
    rejections: dict[str, int]  #: how often each rejecter rejected


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Program:
    """A compiled Scenic program; every random choice is a coordinate of its search space."""

    name: str
    path: Path
    params: dict[str, Any]  #: global parameters that were overridden
    space: SearchSpace
    scenario: Scenario  #: Scenic's, with every random primitive driven
    sources_digest: str  #: of the program's files and layout
    search: SceneSearch = field(repr=False)
    validity: WorldValidity = field(repr=False)

    def realise(
        self, candidate: Candidate, mode: Mode = "repair", *, max_attempts: int = MAX_ATTEMPTS
    ) -> Realised:
        """Make the world of a candidate, or of the nearest one that is valid.

        Args:
            candidate: ``u`` ``(k,)``, and the seed of what u does not cover: which soft
                requirements hold, and where to look if the scene at u is not valid.
            mode: ``repair`` redraws what belongs to the objects to blame; ``exact`` draws
                whole scenes, so that a uniform u gives Scenic's conditional distribution.
            max_attempts: scenes to try, >= 1.

        Returns:
            The world, and the candidate that gives it by itself.

        Raises:
            RejectedScene: no scene was accepted; says who rejected how often.
            InputError: the candidate does not belong to this program, or the accepted scene
                has a value that no world can have: a fault of the program, so the scene is
                not replaced by another one. Commands refuse a program whose first candidate
                is such, and count later ones as rejected.
        """
        self._check(candidate, mode)

        def accept(sample: Any) -> tuple[Scene, World]:
            scene = self.scenario._makeSceneFromSample(sample)
            return scene, world_from_scene(scene, name=self.name, seed=candidate.seed)

        find = self.search.exact if mode == "exact" else self.search.repair
        try:
            found = find(candidate.u, candidate.seed, accept, max_attempts=max_attempts)
        except InputError:
            raise
        except Exception as error:
            where = scenic_line(error.__traceback__, self.path)
            raise WorldError(
                f"{where}: a scene cannot be computed: {type(error).__name__}: {error}"
            ) from error
        scene, world = found.value
        self.validity.check(world)
        return Realised(
            world=world,
            scene=scene,
            candidate=dataclasses.replace(candidate, u=found.u, params=self.params),
            attempts=found.attempts,
            rejections=found.rejections,
        )

    def candidate(self, seed: int, number: int = 0) -> Candidate:
        """Draw candidate ``number`` of a random campaign with ``seed`` on this program."""
        candidate = candidate_of(seed, number, len(self.space))
        return dataclasses.replace(candidate, params=self.params)

    def values_of(self, candidate: Candidate) -> tuple[float | None, ...]:
        """Compute the values of all coordinates of a realised candidate, in the program's units.

        Returns:
            A number each; None for other values, such as a direction or an opaque choice.
        """
        driver = self.search.driver
        sample = driver.begin()
        sample.move(candidate.u, driver.all_units)
        return tuple(driver.value_of(sample, place) for place in range(len(self.space)))

    def outside(self, candidate: Candidate) -> tuple[Outside, ...]:
        """List what lies outside its region where a candidate asks for it, before any repair."""
        driver = self.search.driver
        sample = driver.begin()
        try:
            with randomness.seeded(candidate.seed, "scene"):
                sample.move(candidate.u, driver.all_units)
        except NodeRejected:
            return ()
        found = self.search.checker.all_outside(sample.values)
        return tuple(
            Outside(
                name=driver.names[thing],
                region=_name_of(region),
                placed=_region_of_position(thing),
                where=_line_of(thing),
            )
            for thing, region in found.items()
        )

    def sample(self, seed: int, mode: Mode = "repair") -> World:
        """Make the world of candidate 0 of a campaign with ``seed``.

        Raises:
            RejectedScene: no scene was accepted.
        """
        return self.realise(self.candidate(seed), mode).world

    def _check(self, candidate: Candidate, mode: str) -> None:
        if mode not in get_args(Mode):
            raise ConfigError(f"mode is {mode!r}; it must be repair or exact")
        shape, k = np.shape(candidate.u), len(self.space)
        if shape != (k,):
            raise ConfigError(
                f"candidate.u has shape {shape}; {self.name} has {k} dimensions, so it must be "
                f"({k},)"
            )
        if k and not (np.min(candidate.u) >= 0.0 and np.max(candidate.u) <= 1.0):
            raise ConfigError("candidate.u has values outside [0, 1]")
        if candidate.params and candidate.params != self.params:
            raise ConfigError(
                f"candidate.params is {candidate.params}; {self.name} was compiled with "
                f"{self.params}"
            )


def _region_of_position(thing: Any) -> str:
    region, _, _ = matchInRegion(thing.position)
    return _name_of(region)


def _name_of(region: Any) -> str:
    name = getattr(region, "name", None)  # of a random region the name is random, too
    return name if isinstance(name, str) else ""


def _line_of(thing: Any) -> str:
    origin = origin_of(thing)
    return "" if origin is None else f"{origin[0]}:{origin[1]}"


def compile_program(
    path: Path, params: dict[str, Any] | None = None, *, needs_tasks: bool = True
) -> Program:
    """Compile a Scenic file. It is code, and runs with the rights of whoever calls this.

    Args:
        path: a ``.scenic`` file over ``scenic_worlds.model``.
        params: global parameters to override.
        needs_tasks: refuse a program without tasks.

    Raises:
        FormatError: the program does not compile, or has no robots or tasks; names file and
            line where they are known.
    """
    params = dict(params or {})
    path = Path(path)
    scenario = compile_scenario(path, params)
    if needs_tasks:
        check_tasks(scenario, path)
    driver = Driver(scenario)
    checker = FastChecker()
    scenario.setSampleChecker(checker)
    driver.restrict(_restriction(scenario, driver.space, path))
    return Program(
        name=path.stem,
        path=path,
        params=params,
        space=driver.space,
        scenario=scenario,
        sources_digest=sources_digest(path, getattr(scenario.params["_places"], "layout", None)),
        search=SceneSearch(driver, checker, path.stem),
        validity=WorldValidity(str(path)),
    )


def _restriction(
    scenario: Scenario, space: SearchSpace, path: Path
) -> dict[int, tuple[float, float]]:
    """Read ``param restrict = {'bed1.position.0': (0.2, 0.4)}`` as intervals by coordinate.

    The names are those of the search dimensions (see ``check``), the numbers shares of each
    one's range.

    Raises:
        FormatError: it is not of that form, or names what the program does not have.
    """
    given = scenario.params.get("restrict", {})
    form = "it must read {'DIMENSION': (low, high)} with 0 <= low <= high <= 1"
    if not isinstance(given, dict):
        raise FormatError(f"{path}: param restrict is {given!r}; {form}")
    numbers = {dimension.name: i for i, dimension in enumerate(space.dimensions)}
    found = {}
    for name, pair in given.items():
        if name not in numbers:
            error = UnknownNameError("dimension", str(name), tuple(numbers))
            raise FormatError(f"{path}: param restrict: {error}")
        try:
            low, high = (float(value) for value in pair)
        except (TypeError, ValueError):
            low, high = 1.0, 0.0
        if not 0.0 <= low <= high <= 1.0:
            raise FormatError(f"{path}: param restrict has {name!r}: {pair!r}; {form}")
        found[numbers[name]] = (low, high)
    return found
