"""What a launch file says: the programs of a stack, for each robot, and its topics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.core import codec
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError
from simulator_interface.foreign.robot_topics import ROBOT, Topics
from simulator_interface.foreign.ros_nodes.ros_programs import Launch

ROBOTS, OTHERS = "{robots}", "{others}"  # stand for the names of all robots, or of all others


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramEntry:
    """A program as the file describes it; ``{robot}`` in any text: one program for each robot."""

    name: str
    target: str  #: ``module:function``
    arguments: tuple[str, ...] = ()
    parameters: dict[str, Any] = quantity(default=dict)
    remappings: dict[str, str] = field(default_factory=dict)
    namespace: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchFile:
    """The whole file."""

    name: str = "nodes"  #: of the stack, for reports
    folders: tuple[str, ...] = (".",)  #: the user's modules are under, relative to the file
    interfaces: tuple[str, ...] = ()  #: with .msg, .srv and .action files, relative to the file
    programs: tuple[ProgramEntry, ...] = ()
    topics: Topics = field(default_factory=Topics)
    drives: Literal["nodes", "harness"] = "nodes"  #: harness: to each robot's goal or path
    says: tuple[Literal["deliveries", "goals", "paths"], ...] = ()  #: beside twists
    #: whether copies are made by fork; threads of a library do not survive it
    forks: bool = True


def read_launch(path: Path) -> LaunchFile:
    """Read a launch file.

    Raises:
        InputError: it cannot be read, or says what is not known.
    """
    launch = codec.decode(LaunchFile, codec.read_yaml(path) or {}, where=str(path))
    if not launch.programs:
        raise ConfigError(
            f"{path}: programs is empty; each has a name and a target MODULE:FUNCTION"
        )
    for program in launch.programs:
        if program.target.count(":") != 1:
            raise ConfigError(
                f"{path}: programs: {program.name}: target is {program.target!r}; it must be "
                "MODULE:FUNCTION"
            )
    return launch


def launches_of(programs: Sequence[ProgramEntry], robots: Sequence[str]) -> list[Launch]:
    """Give the programs to start, one for each robot where ``{robot}`` stands in it.

    Raises:
        ConfigError: two have one name.
    """
    made = [
        _launch(program, robot, robots)
        for program in programs
        for robot in (robots if ROBOT in repr(program) else [""])
    ]
    names = [launch.name for launch in made]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"programs: {names.count(name)} are named {name!r}")
    return made


def _launch(program: ProgramEntry, robot: str, robots: Sequence[str]) -> Launch:
    def filled(value: Any) -> Any:
        if value == ROBOTS:
            return list(robots)
        if value == OTHERS:
            return [name for name in robots if name != robot]
        if isinstance(value, str):
            return value.replace(ROBOT, robot)
        if isinstance(value, Mapping):
            return {filled(key): filled(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [filled(item) for item in value]
        return value

    return Launch(
        name=filled(program.name),
        target=program.target,
        arguments=tuple(filled(program.arguments)),
        parameters=filled(program.parameters),
        remappings=filled(program.remappings),
        namespace=filled(program.namespace),
    )
