"""The zoo: small scenes from published deadlocks, each with a known answer.

A scene is a file ``NAME.yaml`` beside this module (fields: :class:`SceneFile`). Its floor is a
floor file without walls: whatever is not a box of ``free`` is solid.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import FormatError, UnknownNameError
from mrta_falsify.core.world import RobotSpec, Task, World
from scenic_worlds.layouts.assembly import MARGIN, solid_boxes
from scenic_worlds.layouts.derivation import derive_layout
from simulator_interface.formats.floor_yaml import floor_of_data

PREFIX = "zoo/"  #: before the name of a scene where worlds of all kinds are named
FOLDER = Path(__file__).parent

#: what is known of a scene: a good stack passes; even a good one fails
Answer: TypeAlias = Literal["passes", "fails"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneRobot:
    """A robot: in a room, or at a pose."""

    name: str
    room: str = ""
    at: Array = quantity(shape=("P",), unit="m, m, rad", default=[])  #: x, y, yaw


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneTask:
    """A delivery of one robot, between rooms by name."""

    robot: str
    start: str
    end: str
    arrival: float = quantity(low=0.0, unit="s", default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneFile:
    """The fields of a scene's file."""

    title: str
    source: str  #: address of the thread or paper, or a page of this project
    published: str  #: what is told of another stack there
    answer: Answer
    why: str  #: what a good stack does, or why none can
    free: Array = quantity(shape=("B", 4), unit="m")  #: boxes of floor: x min, y min, x max, y max
    floor: dict[str, Any]  #: fields of a floor file, without walls
    robots: tuple[SceneRobot, ...]
    tasks: tuple[SceneTask, ...]
    horizon: float = quantity(above=0.0, unit="s")  #: also the deadline of each task


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """A scene of the zoo."""

    name: str
    title: str
    source: str
    published: str
    answer: Answer
    why: str
    world: World


def scene_names() -> tuple[str, ...]:
    """List the scenes."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


@functools.cache
def load_scene(name: str) -> Scene:
    """Load a scene.

    Args:
        name: of the scene, without ``zoo/``.

    Raises:
        UnknownNameError: no such scene.
    """
    if name not in scene_names():
        raise UnknownNameError("scene of the zoo", name, scene_names())
    return read_scene(FOLDER / f"{name}.yaml")


def read_scene(path: Path) -> Scene:
    """Read a scene from its file.

    Raises:
        InputError: the file breaks the format; the message names the field.
    """
    file = codec.decode(SceneFile, codec.read_yaml(path), where=str(path))
    return Scene(
        name=path.stem,
        title=file.title,
        source=file.source,
        published=file.published,
        answer=file.answer,
        why=file.why,
        world=_world(file, path),
    )


def _world(file: SceneFile, path: Path) -> World:
    low, high = file.free[:, :2].min(axis=0), file.free[:, 2:].max(axis=0)
    bounds = np.concatenate([low - MARGIN, high + MARGIN])
    walls = [{"box": list(box)} for box in solid_boxes(bounds, file.free)]
    data = {**file.floor, "name": path.stem, "bounds": bounds.tolist(), "walls": walls}
    layout = derive_layout(floor_of_data(data, path), off_ways=False)
    rooms = {room.name: number for number, room in enumerate(layout.rooms)}

    def room(name: str, where: str) -> int:
        if name not in rooms:
            raise UnknownNameError("room", name, rooms, where=f"{path}: {where}")
        return rooms[name]

    robots = []
    for i, robot in enumerate(file.robots):
        pose = robot.at
        if robot.room:
            pose = frozen_array([*layout.rooms[room(robot.room, f"robots[{i}]")].point, 0.0])
        if len(pose) != 3:
            raise FormatError(f"{path}: robots[{i}] must have a room, or at: [x, y, yaw]")
        robots.append(RobotSpec(name=robot.name, pose=pose, capacity=1))
    tasks = [
        Task(
            arrival=task.arrival,
            start=room(task.start, f"tasks[{i}].start"),
            end=room(task.end, f"tasks[{i}].end"),
            deadline=file.horizon,
            robot=task.robot,
        )
        for i, task in enumerate(file.tasks)
    ]
    return dataclasses.replace(
        layout, robots=tuple(robots), tasks=tuple(tasks), horizon=file.horizon
    )
