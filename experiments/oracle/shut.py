"""Rooms that a person shuts by pushing a bed before the door, wholly, in part, or for a time."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapely import unary_union
from shapely.geometry import box

from experiments.oracle.sampled import Scene
from experiments.oracle.stacks import any_stack, outside
from mrta_falsify.core.directives import Directive, Leave, Push, StandStill, Wait, WaitUntil
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Furniture, HumanSpec, Task, World
from mrta_falsify.testing.floors import floor, robot
from mrta_falsify.testing.stacks import IN_TURN

DEADLINE = 900.0  # s; ``worlds.case`` moves it beyond all continuations
WIDE = 2.8  # m of corridor: who drives there passes a bed
WALL = 0.15  # m


def _ward(random: np.random.Generator) -> World:
    """A corridor and a room north of it; a bed rolls along the corridor to its door.

    It stops before the door, or so far to one side that 0.3 to 0.7 m of the door stay open, or
    moves on after 20 to 200 s. One robot wants in, another one maybe out, a third one past.
    """
    door = float(random.choice([0.9, 1.1]))
    x = float(random.uniform(-0.5, 1.0))
    free = [box(-6.5, 0.0, 6.5, WIDE), box(x - 2.2, WIDE + WALL, x + 2.2, 6.4)]
    free.append(box(x - door / 2, WIDE - 0.01, x + door / 2, WIDE + WALL + 0.01))
    points = np.array([[5.5, 0.8], [-5.6, 0.8], [x, 4.8]])
    world = floor(unary_union(free), points)
    length, wide = float(random.uniform(1.9, 2.2)), 0.9
    beside = WIDE - wide / 2 - 0.08
    bed = Furniture(
        name="bed", kind="bed", movable=True, polygon=rectangle(length, wide, (-3.2, beside - 0.1))
    )
    gap = 0.0 if random.random() < 0.65 else float(random.uniform(0.3, 0.7))
    at = x + (length / 2 + gap - door / 2 if gap else float(random.uniform(-0.2, 0.2)))
    steps: list[Directive] = [WaitUntil(time=float(random.uniform(0.0, 20.0)))]
    steps.append(Push(furniture="bed", point=np.array([at, beside])))
    moves_on = float(random.uniform(20.0, 200.0)) if random.random() < 0.35 else 0.0
    if moves_on:
        steps += [Wait(duration=moves_on), Push(furniture="bed", point=np.array([4.3, beside]))]
    steps.append(Leave() if random.random() < 0.8 else StandStill())
    person = HumanSpec(
        name="porter", route=np.array([[-3.2 - length / 2 - 0.6, beside]]), directives=tuple(steps)
    )
    robots = [robot(0, 4.6, 0.8, np.pi), robot(1, x + 1.0, 5.2)]
    service = float(random.uniform(25.0, 60.0))
    tasks = [
        Task(
            arrival=0.2,
            start=0,
            end=2,
            deadline=DEADLINE,
            pickup_time=float(random.uniform(5.0, 40.0)),
            robot="robot1",
        ),
        Task(arrival=0.3, start=2, end=0, deadline=DEADLINE, pickup_time=service, robot="robot2"),
    ]
    if random.random() < 0.5:
        robots, tasks = robots[:1], tasks[:1]
    if random.random() < 0.4:
        name = f"robot{len(robots) + 1}"
        robots.append(robot(len(robots), 2.6, 0.6, np.pi))
        tasks.append(Task(arrival=0.4, start=0, end=1, deadline=DEADLINE, robot=name))
    return dataclasses.replace(
        world,
        robots=tuple(robots),
        tasks=tuple(tasks),
        humans=(person,),
        furniture=(bed,),
        horizon=110.0 + moves_on,
    )


def bed_shuts(random: np.random.Generator) -> Scene:
    """The shipped stack where a bed shuts a room."""
    return _ward(random), any_stack(random, allocator=IN_TURN)


def bed_shuts_outside(random: np.random.Generator) -> Scene:
    """A foreign stack there."""
    return _ward(random), outside(random, "lanes")
