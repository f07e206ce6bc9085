"""Right messages of both sides for a hall with two robots; the fuzzer garbles them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.world import HumanSpec, RobotSpec, Room, Task, World
from simulator_interface.external.messages import (
    hello,
    plain,
    task_message,
    tick_message,
    world_message,
)

Message = dict[str, Any]
ROBOTS = ("robot1", "robot2")
TASKS = 2
RAYS = 12
DT = 0.05  # s


def hall() -> World:
    """Build a small hall with two rooms, two tasks and a person."""
    rooms = tuple(Room(name=f"room{i + 1}", point=np.array([4.0 * i, 2.0])) for i in range(2))
    return World(
        name="hall",
        bounds=np.array([-3.0, -3.0, 8.0, 5.0]),
        robots=tuple(
            RobotSpec(name=name, pose=np.array([2.0 * i, 0.0, 0.0]))
            for i, name in enumerate(ROBOTS)
        ),
        humans=(HumanSpec(name="visitor", route=np.array([[0.0, -2.0], [6.0, -2.0]]), speed=1.0),),
        rooms=rooms,
        travel_times=np.array([[0.0, 8.0], [8.0, 0.0]]),
        tasks=tuple(Task(arrival=0.1 * i, start=i, end=1 - i, deadline=60.0) for i in range(TASKS)),
        horizon=2.0,
    )


# --- of the stack ----------------------------------------------------------------------------


def ready_message() -> Message:
    return {
        "type": "ready",
        "protocol": [1, 0],
        "encoding": "msgpack",
        "name": "fuzzed",
        "version": "1",
        "says": ["deliveries", "goals", "paths"],
        "can": ["branch"],
    }


def command_message(random: np.random.Generator, *, binary: bool, tick: int = 3) -> Message:
    """Make a `command` with all fields."""
    robots = len(ROBOTS)
    message = {
        "type": "command",
        "tick": tick,
        "twist": random.normal(size=(robots, 3)),
        "goal": random.normal(size=(robots, 2)),
        "stops_left": [1, 0],
        "paths": [[0, random.normal(size=(5, 2))]],
        "waits_for": [[1, "robot1"]],
        "events": [
            {"kind": "picked-up", "robot": 0, "task": 0},
            {"kind": "granted", "robot": 1, "resource": "door", "other": -1, "detail": "x"},
        ],
        "took": 0.05,
        "signals": {"gain": 1.0},
        "phase": [1, 2],
        "waypoint": random.normal(size=(robots, 2)),
        "cluster": [0, 1],
        "leader": [0, 0],
        "slack": [1.5, 2.5],
        "queue": [-1, 0],
        "x_own": "free",
    }
    made: Message = plain(message, binary=binary)
    return made


def question_messages() -> tuple[Message, ...]:
    ends = {"start": [0.0, 0.0], "goal": [3.0, 2.0]}
    return (
        {"type": "plan", **ends, "avoid": [[1.0, 1.0]]},
        {"type": "travel_time", **ends, "robot": 1},
        {"type": "visible", **ends},
        {"type": "map", "avoid": [[1.0, 1.0]], "known": 0},
    )


# --- of the harness -------------------------------------------------------------------------


def opening() -> tuple[Message, Message]:
    """Make `hello` and `world`, as they are packed."""
    world, config = hall(), StackConfig()
    costmap = registry.build("costmap", config.costmap).bind(world).costmap(0.0, NO_POINTS)
    told: Message = plain(world_message(world, DT, costmap, {"gain": 1.0}), binary=True)
    return hello("0"), told


def tick(number: int) -> Message:
    """Make a `tick`, as it is packed."""
    world, robots = hall(), len(ROBOTS)
    fleet = FleetState(
        tick=number,
        time=DT * number,
        pose=np.array([robot.pose for robot in world.robots]),
        velocity=np.zeros((robots, 3)),
        human_position=np.array([human.route[0] for human in world.humans]),
        human_velocity=np.zeros((1, 2)),
        human_radius=np.array([0.3]),
        obstacle_points=np.full((robots, RAYS, 2), np.inf),
        parked_for=np.zeros(robots),
    )
    tasks = [task_message(k, task) for k, task in enumerate(world.tasks)]
    refused = [{"kind": "picked-up", "robot": 0, "task": 0, "why": "it moves"}]
    links = {"states": [True, True]}
    made: Message = plain(tick_message(fleet, tasks, refused, links, closed=False), binary=True)
    return made
