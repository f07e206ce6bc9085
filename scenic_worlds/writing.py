"""A world as a Scenic program that gives it back.

Every thing of the world becomes one line or block with exact numbers, so that the program's only
scene is the world, bit for bit where Scenic's arithmetic can reach it. What a program cannot say
(walls, rooms, roadways, footprints that are no rectangle) is the layout: a shipped one by its
name, any other one in a file beside the program.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrta_falsify.core import codec, geometry
from mrta_falsify.core.directives import (
    Appear,
    Directive,
    FollowRoute,
    Leave,
    Push,
    StandStill,
    Wait,
    WaitUntil,
    WalkTo,
)
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    Event,
    Furniture,
    HumanSpec,
    RobotSpec,
    Task,
    World,
    without_actors,
    write_world,
)
from scenic_worlds.exact_numbers import Box, box_of, heading_text, number_text, point_text
from scenic_worlds.layouts import layout_names, load_layout

LIBRARY = Path(__file__).parent
CLOSE = 1e-6  # m from its corners that a blockage may be written off by
PLACED = "with allowCollisions True, with regionContainedIn everywhere"


@dataclass(frozen=True, slots=True, eq=False)
class WrittenProgram:
    """A world in Scenic's language."""

    text: str
    layout: World | None  #: to lie beside the program as NAME.layout.json; None: a shipped one


def write_program(world: World, path: Path, *, comment: str = "") -> tuple[Path, ...]:
    """Write ``world`` as a Scenic program.

    Args:
        world: any that does not need its own program.
        path: the ``.scenic`` file; its layout goes beside it if it is none of the shipped ones.
        comment: begins the program, for example where the world comes from.

    Returns:
        The files written, the program first.

    Raises:
        WorldError: the world has something that no program can say.
    """
    beside = path.with_suffix(".layout.json")
    written = program_of(world, layout_file=beside.name, comment=comment)
    files = (path,) if written.layout is None else (path, beside)
    if written.layout is not None:
        write_world(written.layout, beside)
    path.write_text(written.text, encoding="utf-8")
    return files


def program_of(world: World, *, layout_file: str, comment: str = "") -> WrittenProgram:
    """The program of a world (see :func:`write_program`).

    Args:
        world: to write.
        layout_file: name of the file beside the program, if it needs one.
        comment: begins the program.

    Raises:
        WorldError: the world has something that no program can say.
    """
    if world.scripted:
        raise WorldError(
            f"{world.name}: needs {world.scripted} of its program, so it cannot be written as "
            "another one; use the program itself"
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
        [_furniture(piece) for piece in world.furniture[kept:]],
        [_robot(robot) for robot in world.robots],
        [_human(human) for human in world.humans],
        [_event(event) for event in world.events],
        [_tasks(world.tasks)],
    )
    text = "\n\n".join("\n".join(block) for block in blocks if block) + "\n"
    return WrittenProgram(text, None if name else own)


def _docstring(world: World, comment: str) -> str:
    said = comment.strip() or f"The world {world.name}, written as a program: it has one scene."
    safe = said.replace("\\", "/").replace('"""', "'''")
    end = "\n" if "\n" in safe or safe.endswith('"') else ""
    return f'"""{safe}{end}"""'


# --- the floor -------------------------------------------------------------------------------


def _shipped_layout(world: World) -> str:
    """Name of the shipped layout with the same building, empty if there is none."""
    for name in layout_names():
        layout = load_layout(name)
        if np.array_equal(layout.bounds, world.bounds) and _is_layout(world, name, bare=True):
            return name
    return ""


def _is_layout(world: World, name: str, *, bare: bool = False) -> bool:
    """Whether the building of ``world`` is a shipped one; ``bare``: apart from the furniture."""
    first, second = (_building(w, bare=bare) for w in (world, load_layout(name)))
    return codec.digest(first) == codec.digest(second)


def _building(world: World, *, bare: bool) -> World:
    """``world`` without what a program says itself."""
    named = dataclasses.replace(
        without_actors(world), name="", horizon=1.0, ray_noise=0.0, seed=0, scripted=""
    )
    return dataclasses.replace(named, furniture=()) if bare else named


def _layout_pieces(world: World, shipped: str) -> int:
    """How many pieces of furniture, from the first on, belong to the layout.

    Those of the shipped layout, traced ones, and what no program can place exactly. What
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


# --- things ----------------------------------------------------------------------------------


@functools.cache
def _furniture_classes() -> dict[str, str]:
    """Class of our library for each kind of furniture."""
    text = (LIBRARY / "furniture.scenic").read_text(encoding="utf-8")
    parts = re.split(r"^class (\w+)\(\w+\):", text, flags=re.MULTILINE)[1:]
    found = {}
    for name, body in zip(parts[::2], parts[1::2], strict=True):
        kind = re.search(r"^ {4}kind: '(\w+)'", body, re.MULTILINE)
        if kind:
            found[kind[1]] = name
    return found


def _lines(first: str, *rest: str) -> str:
    return ",\n    ".join([first, *(line for line in rest if line)])


def _withs(pairs: Iterable[tuple[str, str]]) -> str:
    return ", ".join(f"with {name} {value}" for name, value in pairs)


def _box_text(box: Box, height: float) -> str:
    return (
        f"at ({number_text(box.x)}, {number_text(box.y)}, {number_text(height / 2.0)}), "
        f"facing {box.heading}, with width {number_text(box.width)}, "
        f"with length {number_text(box.length)}, with height {number_text(height)}"
    )


def _furniture(piece: Furniture) -> str:
    name = _furniture_classes().get(piece.kind)
    kind = [] if name else [("kind", repr(piece.kind))]
    movable = [("movable", "True")] if piece.movable else []
    return _lines(
        f"new {name or 'Furniture'} with name {piece.name!r}",
        _box_text(box_of(piece.polygon), piece.height),
        _withs([*kind, ("mesh", repr(piece.mesh)), *movable]),
        PLACED,
    )


#: name in the world and in the program, of numbers that are left out at their default
ROBOT_VALUES = {
    "radius": "body_radius",
    "max_speed": "max_speed",
    "max_acceleration": "max_acceleration",
    "max_turn_rate": "max_turn_rate",
    "capacity": "capacity",
    "position_noise": "position_noise",
    "heading_noise": "heading_noise",
    "wheel_slip": "wheel_slip",
    "command_latency": "command_latency",
    "joins_at": "joins_at",
}
HUMAN_VALUES = {
    "speed": "speed",
    "radius": "body_radius",
    "start": "phase",
    "appears_at": "appears_at",
    "leaves_at": "leaves_at",
}


def _changed(item: RobotSpec | HumanSpec, names: dict[str, str]) -> list[tuple[str, str]]:
    """Properties of ``item`` that are not at their default."""
    defaults = {field.name: field.default for field in dataclasses.fields(item)}
    return [
        (theirs, number_text(getattr(item, ours)))
        for ours, theirs in names.items()
        if getattr(item, ours) != defaults[ours]
    ]


def _robot(robot: RobotSpec) -> str:
    x, y, yaw = robot.pose
    model = [("model", repr(robot.model))] if robot.model != "waffle" else []
    return _lines(
        f"new Robot with name {robot.name!r}",
        f"at ({number_text(x)}, {number_text(y)}, 0.075), facing {heading_text(float(yaw))}",
        _withs([*model, *_changed(robot, ROBOT_VALUES)]),
        PLACED,
    )


def _human(human: HumanSpec) -> str:
    if human.directives:
        return _scripted(human)
    route = ", ".join(point_text(point) for point in human.route)
    flags = [("reacts", "False")] * (not human.reacts_to_robots)
    flags += [("repeat", "False")] * (not human.repeat)
    return _lines(
        f"new Human with name {human.name!r}",
        f"with route [{route}]",
        _withs([*_changed(human, HUMAN_VALUES), *flags]),
    )


def _scripted(human: HumanSpec) -> str:
    """A person or a scripted robot with a behaviour of our library."""
    steps = [_directive(step) for step in human.directives]
    behavior = steps[0] if len(steps) == 1 else f"InTurn({', '.join(steps)})"
    place = point_text(human.route[0])
    if human.body == "robot":
        values = [
            ("max_speed", number_text(human.speed)),
            ("body_radius", number_text(human.radius)),
        ]
        first = f"new Robot with name {human.name!r}, at {place}"
        return _lines(first, f"with behavior {behavior}", _withs(values), PLACED)
    flags = [("reacts", "False")] * (not human.reacts_to_robots)
    return _lines(
        f"new Human with name {human.name!r}, at {place}",
        f"with behavior {behavior}",
        _withs([*_changed(human, HUMAN_VALUES), *flags]),
    )


def _pace(speed: float) -> str:
    return f", speed={number_text(speed)}" if speed else ""


#: how each directive is written as a behaviour of behaviors.scenic
_WRITERS: dict[type, Callable[..., str]] = {
    FollowRoute: lambda d: (
        f"FollowRoute([{', '.join(map(point_text, d.route))}], repeat={d.repeat}{_pace(d.speed)})"
    ),
    WalkTo: lambda d: f"WalkTo({point_text(d.point)}{_pace(d.speed)})",
    Wait: lambda d: f"WaitFor({number_text(d.duration)})",
    WaitUntil: lambda d: f"WaitUntil({number_text(d.time)})",
    StandStill: lambda d: "StandStill()",
    Push: lambda d: f"Push({d.furniture!r}, {point_text(d.point)}{_pace(d.speed)})",
    Appear: lambda d: f"Appear({point_text(d.point)})",
    Leave: lambda d: "Leave()",
}


def _directive(directive: Directive) -> str:
    return _WRITERS[type(directive)](directive)


def _event(event: Event) -> str:
    during = f"with during ({number_text(event.start)}, {number_text(event.end)})"
    if isinstance(event, CommsOutage):
        return _lines(
            f"new CommsOutage with name {event.name!r}",
            f"with robots {event.robots!r}, with links {event.links!r}",
            during,
        )
    return _lines(
        f"new Blockage with name {event.name!r}",
        _box_text(_blockage_box(event), event.height),
        during,
    )


def _blockage_box(event: Blockage) -> Box:
    box = box_of(event.polygon)
    if box.is_exact:
        return box
    yaw = math.atan2(*(event.polygon[1] - event.polygon[0])[::-1])
    outline = geometry.rectangle(box.length, box.width)
    moved = geometry.transform(outline, (box.x, box.y, yaw))
    if moved.shape != event.polygon.shape or np.abs(moved - event.polygon).max() > CLOSE:
        raise WorldError(
            f"blockage {event.name!r} is no rectangle; a program's Blockage always is one, so "
            "this world cannot be written as a program"
        )
    return box


# --- parameters ------------------------------------------------------------------------------


def _params(world: World) -> Iterator[str]:
    yield f"param horizon = {number_text(world.horizon)}"
    if world.ray_noise:
        yield f"param ray_noise = {number_text(world.ray_noise)}"
    yield f"param noise_seed = {world.seed}"


def _tasks(tasks: Iterable[Task]) -> str:
    lines = [f"    {_task(task)},\n" for task in tasks]
    return "param tasks = [\n" + "".join(lines) + "]"


def _task(task: Task) -> str:
    values = [number_text(task.arrival), str(task.start), str(task.end), number_text(task.deadline)]
    if task.pickup_time or task.dropoff_time:
        values += [number_text(task.pickup_time), number_text(task.dropoff_time)]
    return f"({', '.join(values)})"
