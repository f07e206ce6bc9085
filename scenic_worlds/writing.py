"""A world as a Scenic program that gives it back.

Each thing of the world becomes one statement with exact numbers. The program's only scene is
the world, bit for bit where Scenic's arithmetic can reach it. What a program cannot express
(walls, rooms, roadways, footprints other than rectangles) is the layout. A shipped layout goes
by its name, any other one into a file beside the program.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import Resource, Task, World, without_actors, write_world
from scenic_worlds.exact_numbers import box_of, number_text
from scenic_worlds.layouts import layout_names, load_layout
from scenic_worlds.statements import (
    comment_text,
    event_text,
    furniture_text,
    human_text,
    resource_text,
    robot_text,
)


@dataclass(frozen=True, slots=True, eq=False)
class WrittenProgram:
    """A world in Scenic's language."""

    text: str
    layout: World | None  #: to lie beside the program as NAME.layout.json; None: a shipped one


def write_program(world: World, path: Path, *, comment: str = "") -> tuple[Path, ...]:
    """Write ``world`` as a Scenic program.

    Args:
        world: any that does not need its own program.
        path: the ``.scenic`` file; a layout that is not shipped goes beside it.
        comment: begins the program, for example where the world comes from.

    Returns:
        The files written, the program first.

    Raises:
        WorldError: the world has something that a program cannot express.
    """
    beside = path.with_suffix(".layout.json")
    written = program_of(world, layout_file=beside.name, comment=comment)
    files = (path,) if written.layout is None else (path, beside)
    if written.layout is not None:
        write_world(written.layout, beside)
    write_atomically(path, written.text.encode())
    return files


def program_of(world: World, *, layout_file: str, comment: str = "") -> WrittenProgram:
    """Write a world in Scenic's language (see :func:`write_program`).

    Args:
        world: to write.
        layout_file: name of the file beside the program, if it needs one.
        comment: begins the program.

    Raises:
        WorldError: the world has something that a program cannot express.
    """
    if world.scripted:
        raise WorldError(
            f"{world.name}: needs {world.scripted} of its program, so it cannot be written as "
            "another program; use the program itself"
        )
    shipped = _shipped_layout(world)
    kept = _layout_pieces(world, shipped)
    own = dataclasses.replace(without_actors(world), furniture=world.furniture[:kept])
    name = shipped if shipped and _is_layout(own, shipped) else ""
    blocks = (
        [_docstring(world, comment)],
        [f"param layout = {name!r}" if name else f"param layout = localPath({layout_file!r})"],
        ["model scenic_worlds.model"],
        list(_params(world)),
        [resource_text(item) for item in (_changed_resources(world, name) or () if name else ())],
        [furniture_text(piece) for piece in world.furniture[kept:]],
        [robot_text(robot) for robot in world.robots],
        [human_text(human) for human in world.humans],
        [event_text(event) for event in world.events],
        [_tasks(world.tasks)],
    )
    text = "\n\n".join("\n".join(block) for block in blocks if block) + "\n"
    return WrittenProgram(text, None if name else own)


def _docstring(world: World, comment: str) -> str:
    said = comment.strip() or f"The world {world.name}, written as a program: it has one scene."
    safe = comment_text(said)
    end = "\n" if "\n" in safe or safe.endswith('"') else ""
    return f'"""{safe}{end}"""'


# --- the floor -------------------------------------------------------------------------------


def _shipped_layout(world: World) -> str:
    """Find the shipped layout with the same building; empty if there is none."""
    for name in layout_names():
        layout = load_layout(name)
        if np.array_equal(layout.bounds, world.bounds) and _is_layout(world, name, bare=True):
            return name
    return ""


def _is_layout(world: World, name: str, *, bare: bool = False) -> bool:
    """Whether the building of ``world`` is a shipped one; ``bare``: apart from the furniture."""
    first, second = (_building(w, bare=bare) for w in (world, load_layout(name)))
    same = codec.digest(first) == codec.digest(second)
    return same and _changed_resources(world, name) is not None


def _building(world: World, *, bare: bool) -> World:
    """Leave out what the program itself gives."""
    named = dataclasses.replace(
        without_actors(world),
        name="",
        horizon=1.0,
        ray_noise=0.0,
        seed=0,
        scripted="",
        resources=(),
    )
    return dataclasses.replace(named, furniture=()) if bare else named


def _changed_resources(world: World, name: str) -> list[Resource] | None:
    """List the resources that a program must give beside those of a shipped layout.

    None if statements cannot give them: one of the layout's is missing, or another one guards a
    room that the layout guards.
    """
    layout = load_layout(name)
    own, added = world.resources[: len(layout.resources)], world.resources[len(layout.resources) :]
    if len(own) < len(layout.resources) or any(
        (ours.name, ours.kind, ours.room) != (theirs.name, theirs.kind, theirs.room)
        for ours, theirs in zip(own, layout.resources, strict=True)
    ):
        return None
    changed = [
        ours
        for ours, theirs in zip(own, layout.resources, strict=True)
        if codec.digest(ours) != codec.digest(theirs)
    ]
    if any(resource.kind != "room" for resource in changed):
        return None
    if any(resource.kind == "room" or len(resource.entry) for resource in added):
        return None
    return [*changed, *added]


def _layout_pieces(world: World, shipped: str) -> int:
    """Count the pieces of furniture, from the first on, that belong to the layout.

    These are the shipped layout's, traced ones, and what a program cannot place exactly. What
    stands before such a piece stays with it, since a layout's furniture comes first.
    """
    fixed: set[str] = set()
    if shipped:
        fixed = {codec.digest(piece) for piece in load_layout(shipped).furniture}
    for number in reversed(range(len(world.furniture))):
        piece = world.furniture[number]
        is_fixed = piece.traced or codec.digest(piece) in fixed
        if is_fixed or not box_of(piece.polygon).is_exact:
            return number + 1
    return 0


# --- parameters ------------------------------------------------------------------------------


def _params(world: World) -> Iterator[str]:
    yield f"param horizon = {number_text(world.horizon)}"
    if world.ray_noise:
        yield f"param ray_noise = {number_text(world.ray_noise)}"
    yield f"param noise_seed = {world.seed}"
    if world.stack_params:
        pairs = (
            f"({name!r}, {number_text(number)})" for name, number in world.stack_params.items()
        )
        yield f"param stack_params = [{', '.join(pairs)}]"


def _tasks(tasks: Iterable[Task]) -> str:
    lines = [f"    {_task(task)},\n" for task in tasks]
    return "param tasks = [\n" + "".join(lines) + "]"


def _task(task: Task) -> str:
    values = [number_text(task.arrival), str(task.start), str(task.end), number_text(task.deadline)]
    if task.pickup_time or task.dropoff_time or task.robot:
        values += [number_text(task.pickup_time), number_text(task.dropoff_time)]
    if task.robot:
        values += ["True", repr(task.robot)]
    return f"({', '.join(values)})"
