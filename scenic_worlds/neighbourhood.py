"""A world as a Scenic program of its neighbourhood: every range has the world in its middle."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import RobotSpec, Task, World, without_actors, write_world
from scenic_worlds.exact_numbers import heading_text, number_text
from scenic_worlds.statements import comment_text, event_text, human_text, robot_values

WHERE = 0.4  # m that a start lies off, at most
TURN = 0.3  # rad that a start is turned, at most
WHEN = 5.0  # s that a task comes earlier or later, at most
KEPT = 4  # times as often as the neighbour: the goal of a task


def write_neighbourhood(world: World, path: Path, *, comment: str) -> tuple[Path, Path]:
    """Write the worlds near ``world`` as a Scenic program, with its floor beside it.

    Starts, headings, arrivals and goals vary. With ``-p spread=0`` the program gives ``world``.

    Args:
        world: any that does not need its own program.
        path: the ``.scenic`` file; the floor goes beside it as ``.layout.json``.
        comment: begins the program.

    Returns:
        The program and its floor.

    Raises:
        WorldError: the world has something that a program cannot express.
    """
    if world.scripted:
        raise WorldError(
            f"{world.name}: needs {world.scripted} of its program, so its neighbourhood cannot be "
            "written; campaign on the program itself"
        )
    beside = path.with_suffix(".layout.json")
    text = neighbourhood_text(world, layout_file=beside.name, comment=comment)
    write_world(without_actors(world), beside)
    write_atomically(path, text.encode())
    return path, beside


def neighbourhood_text(world: World, *, layout_file: str, comment: str) -> str:
    """Write the program of :func:`write_neighbourhood`."""
    blocks = [
        f'"""{comment_text(comment.strip())}\n"""',
        f"param layout = localPath({layout_file!r})\nparam spread = 1\nmodel scenic_worlds.model",
        _HELPERS,
        f"param horizon = {number_text(world.horizon)}",
        *(_robot_text(robot) for robot in world.robots),
        *(human_text(human) for human in world.humans),
        *(event_text(event) for event in world.events),
        _tasks_text(world),
    ]
    return "\n\n".join(blocks) + "\n"


_HELPERS = f"""# spread: how far from the incident, 0: the incident itself.
spread = globalParameters.spread

def near(value, most):
    return Range(value - spread * most, value + spread * most) if spread else value

def goal(room, neighbour):
    return Discrete({{room: {KEPT}, neighbour: 1}}) if spread else room"""


def _robot_text(robot: RobotSpec) -> str:
    x, y = (number_text(float(value)) for value in robot.pose[:2])
    heading = heading_text(float(robot.pose[2]))
    given = "".join(f", with {name} {value}" for name, value in robot_values(robot))
    return (
        f"new Robot at (near({x}, {WHERE:g}), near({y}, {WHERE:g}), 0.075), "
        f"facing near({heading}, {TURN:g}),\n    with name {robot.name!r}{given}"
    )


def _tasks_text(world: World) -> str:
    lines = [f"    {_task_text(task, world)},\n" for task in world.tasks]
    return f"param tasks = [\n{''.join(lines)}]"


def _task_text(task: Task, world: World) -> str:
    end = str(task.end)
    neighbour = _neighbour(task, world)
    if neighbour is not None:
        end = f"goal({task.end}, {neighbour})"
    values = [
        _when(task.arrival),
        str(task.start),
        end,
        number_text(task.deadline),
        number_text(task.pickup_time),
        number_text(task.dropoff_time),
        "True",
    ]
    if task.robot:
        values.append(repr(task.robot))
    return f"({', '.join(values)})"


def _neighbour(task: Task, world: World) -> int | None:
    """Find the room nearest to a task's goal that is neither its goal nor its start."""
    others = [k for k in range(len(world.rooms)) if k not in (task.start, task.end)]
    if not others:
        return None
    goal = world.rooms[task.end].point
    return min(others, key=lambda k: float(np.hypot(*(world.rooms[k].point - goal))))


def _when(arrival: float) -> str:
    """Write a time near ``arrival`` [s]; what is there from the beginning stays so."""
    return f"near({number_text(arrival)}, {number_text(min(WHEN, arrival))})" if arrival else "0"
