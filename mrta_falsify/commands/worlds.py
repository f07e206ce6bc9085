"""Worlds by name: a file, a shipped name, or a sample of a Scenic program."""

from __future__ import annotations

import dataclasses
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrta_falsify.commands.folders import Place, located
from mrta_falsify.core.errors import FormatError, UnknownNameError
from mrta_falsify.core.world import World, read_world
from scenic_worlds import layouts, variation, zoo
from scenic_worlds.shipped import scenario_names
from simulator_interface import starts
from simulator_interface.formats import mrta_sim

if TYPE_CHECKING:
    from scenic_worlds.program import Realised


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundWorld:
    """What a run begins with."""

    world: World
    scene: Any = None  #: Scenic's, if the world was sampled from a program


def find_world(
    name: World | Place,
    *,
    seed: int | None = None,
    tasks: Place | None = None,
    robots: Place | None = None,
    humans: Place | None = None,
) -> World:
    """Load a world by file or shipped name, or sample one from a Scenic program, ready to run.

    Args:
        name: a world file (``.json``), a Scenic program (``.scenic``), a shipped name of either,
            a scene of the zoo (``zoo/NAME``), or a world.
        seed: varies a fixed world (see :func:`scenic_worlds.variation.vary_world`) or
            samples a program; without, a fixed world is taken as it is and a program
            is sampled with seed 0.
        tasks: MRTA-Sim testcase that replaces the tasks; its ``agents`` place the robots,
            unless ``robots`` is given.
        robots: MRTA-Sim robot setup that replaces the robots.
        humans: MRTA-Sim waypoint file that replaces the people.

    Returns:
        A world whose robots all start on free floor.

    Raises:
        InputError: no such file or name, a file that is not what it should be, files that
            contradict each other, a robot start that is taken.
    """
    return find_world_and_scene(name, seed=seed, tasks=tasks, robots=robots, humans=humans).world


def find_world_and_scene(
    name: World | Place,
    *,
    seed: int | None = None,
    tasks: Place | None = None,
    robots: Place | None = None,
    humans: Place | None = None,
) -> FoundWorld:
    """Find a world as :func:`find_world` does, with the scene it was sampled from, if it was."""
    scene = None
    if isinstance(name, World):
        world, name, fixed = name, name.name, True
    elif (name := str(name)) in layouts.world_names():
        world, fixed = layouts.load_world(name), True
    elif name.startswith(zoo.PREFIX):
        world, fixed = zoo.load_scene(name.removeprefix(zoo.PREFIX)).world, True
    elif name.endswith(".scenic") or name in scenario_names():
        sampled = _sample_program(name, seed or 0)
        world, scene, fixed = sampled.world, sampled.scene, False
    elif name.endswith(".json") or Path(name).exists():
        world, fixed = read_world(Path(name)), True
    else:
        here = (path.name for ending in ("json", "scenic") for path in Path().glob(f"*.{ending}"))
        raise UnknownNameError("world", name, (*layouts.world_names(), *scenario_names(), *here))
    world = _with_inputs(world, tasks, robots, humans)
    with located(name):
        starts.check_starts(world)
        if fixed and seed is not None:
            world = variation.vary_world(world, seed)
    return FoundWorld(world=world, scene=scene)


def _sample_program(name: str, seed: int) -> Realised:
    if name.endswith(".scenic") and not Path(name).is_file():
        raise FormatError(f"{name}: cannot be read: no such file")
    # Scenic takes two seconds to import; only this road needs it.
    program = importlib.import_module("scenic_worlds.program")
    compiled = program.compile_program(program.scenario_path(name))
    realised: Realised = compiled.realise(compiled.candidate(seed))
    return realised


def _with_inputs(
    world: World, tasks: Place | None, robots: Place | None, humans: Place | None
) -> World:
    if robots is not None:
        found = mrta_sim.robots_from_setup(world.robots, mrta_sim.read_robot_setup(Path(robots)))
        with located(str(robots)):
            world = dataclasses.replace(world, robots=found)
            starts.check_starts(world)
    if tasks is not None:
        stream = mrta_sim.read_task_stream(Path(tasks), rooms=len(world.rooms))
        placed = world.robots
        if stream.agents and robots is None:
            placed = mrta_sim.robots_at_rooms(world.robots, stream.agents, world.rooms)
        with located(str(tasks)):
            world = dataclasses.replace(world, tasks=stream.tasks, robots=placed)
            starts.check_starts(world)
    if humans is not None:
        with located(str(humans)):
            world = dataclasses.replace(world, humans=mrta_sim.read_human_routes(Path(humans)))
    return world
