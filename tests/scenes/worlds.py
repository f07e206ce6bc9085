"""The paper's scenes as worlds: small wards in which one thing happens.

The fixed priority order lets the robot with the largest number go first, as MRTA-Sim does, so
the last robot of a world leads wherever it is active. Robots carry one item each, so that who
gets which task follows from where they stand.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    Event,
    Furniture,
    HumanSpec,
    Link,
    RobotSpec,
    Task,
    World,
)
from mrta_falsify.testing.wards import ward_layout
from scenic_worlds.layouts import load_layout

SOUTH = -np.pi / 2  # rad
LATE = 900.0  # s, a deadline that is never missed
OUTAGE = (8.0, 28.0)  # s, from, to: the 20 s of the paper's future work


def _robot(number: int, place: Sequence[float] | Array, yaw: float = 0.0) -> RobotSpec:
    x, y = place
    return RobotSpec(name=f"robot{number + 1}", pose=frozen_array([x, y, yaw]), capacity=1)


def _task(arrival: float, start: int, end: int, *, loading: float = 0.0) -> Task:
    return Task(arrival=arrival, start=start, end=end, deadline=LATE, pickup_time=loading)


def _scene(
    layout: World,
    name: str,
    robots: Sequence[RobotSpec],
    tasks: Sequence[Task],
    *,
    horizon: float,
    furniture: Sequence[Furniture] = (),
    events: Sequence[Event] = (),
) -> World:
    return dataclasses.replace(
        layout,
        name=name,
        robots=tuple(robots),
        tasks=tuple(tasks),
        furniture=layout.furniture + tuple(furniture),
        events=tuple(events),
        horizon=horizon,
    )


def idle_robot_in_a_passage() -> World:
    """Robot 1 has a delivery; robot 2, idle, stands in the only passage, one metre wide."""
    layout = ward_layout(rooms=3, corridor_width=3.0)
    cupboards = [
        Furniture(name=name, kind="cupboard", polygon=rectangle(0.5, 0.95, (5.0, y)))
        for name, y in (("south", 0.475), ("north", 2.525))
    ]
    robots = [_robot(0, (2.5, 1.0)), _robot(1, (5.0, 1.5), 0.8)]
    return _scene(
        layout,
        "idle_robot_in_a_passage",
        robots,
        [_task(1.0, 2, 1)],
        horizon=90.0,
        furniture=cupboards,
    )


def queue_of_an_empty_room() -> World:
    """One robot comes from far for a room that nobody uses."""
    layout = ward_layout(rooms=3)
    return _scene(
        layout,
        "queue_of_an_empty_room",
        [_robot(0, (1.0, 1.5))],
        [_task(0.0, 2, 1)],
        horizon=120.0,
    )


def queue_of_a_busy_room() -> World:
    """Robot 3 loads in a room, robot 2 waits for it, robot 1 comes from far."""
    layout = ward_layout(rooms=3)
    spots = layout.resources[2].spots
    robots = [
        _robot(0, (1.0, 1.5)),
        _robot(1, spots[1], np.pi),
        _robot(2, layout.rooms[2].point, SOUTH),
    ]
    tasks = [
        _task(0.0, 2, 1, loading=22.0),
        _task(0.5, 2, 1, loading=8.0),
        _task(1.0, 2, 0),
    ]
    return _scene(layout, "queue_of_a_busy_room", robots, tasks, horizon=200.0)


def meeting_at_a_door() -> World:
    """Robot 2 drives west past a door; robot 1 comes out of it and wants to go east."""
    layout = ward_layout(rooms=3, corridor_width=2.6)
    robots = [
        _robot(0, layout.rooms[1].point, SOUTH),
        _robot(1, layout.rooms[2].point, SOUTH),
    ]
    tasks = [_task(1.0, 2, 0), _task(1.0, 1, 2, loading=7.0)]
    return _scene(layout, "meeting_at_a_door", robots, tasks, horizon=120.0)


def meeting_in_a_corridor() -> World:
    """Robot 1 drives west in a narrow corridor; robot 2 comes out of a door ahead of it."""
    layout = ward_layout(rooms=3, corridor_width=2.6)
    robots = [
        _robot(0, layout.rooms[2].point, SOUTH),
        _robot(1, layout.rooms[1].point, SOUTH),
    ]
    tasks = [_task(1.0, 2, 0), _task(1.0, 1, 2, loading=8.0)]
    return _scene(layout, "meeting_in_a_corridor", robots, tasks, horizon=120.0)


def three_robots_close_together() -> World:
    """Three robots within a metre or two; the first in rank leaves through a door beside them."""
    layout = ward_layout(rooms=4, two_sided=True, room_width=8.0)
    x = float(layout.rooms[0].point[0])
    robots = [
        _robot(0, (x + 0.3, 3.2)),
        _robot(1, (x - 0.6, 2.2)),
        _robot(2, (x + 0.2, 1.3), SOUTH),
    ]
    tasks = [_task(1.0, 1, 1, loading=5.0), _task(1.2, 3, 3), _task(1.4, 2, 2)]
    return _scene(layout, "three_robots_close_together", robots, tasks, horizon=120.0)


def blocked_corridor(*, gap: float = 0.0) -> World:
    """A bed stands across the only corridor from 7 s to 40 s; one robot has to get past.

    Another robot has its way on the far side. ``gap`` [m] is what the bed leaves free.
    """
    layout = ward_layout(rooms=4, corridor_width=3.0, room_width=4.0)
    robots = [
        _robot(0, layout.rooms[0].point, SOUTH),
        _robot(1, layout.rooms[3].point, SOUTH),
    ]
    tasks = [_task(0.5, 0, 2), _task(0.5, 3, 2)]
    length = 3.0 - gap
    bed = Blockage(
        name="bed", polygon=rectangle(0.9, length, (6.5, length / 2.0)), start=7.0, end=40.0
    )
    return _scene(layout, "blocked_corridor", robots, tasks, horizon=150.0, events=[bed])


def two_robots_in_a_row(link: Link | None, *, who: Sequence[str] = ("robot1",)) -> World:
    """Robot 1 follows robot 2 down a corridor, in its cluster; ``link`` of ``who`` is cut.

    A third task comes during the 20 s of the outage, for the room where robot 1 began.
    """
    layout = ward_layout(rooms=6, room_width=4.0, corridor_width=3.0)
    robots = [_robot(0, (2.0, 1.0)), _robot(1, (3.6, 1.0))]
    tasks = [_task(1.0, 4, 5), _task(1.2, 3, 2), _task(15.0, 0, 1)]
    start, end = OUTAGE
    outages = []
    if link is not None:
        outages.append(
            CommsOutage(name="cut", robots=tuple(who), links=(link,), start=start, end=end)
        )
    return _scene(layout, f"outage_{link}", robots, tasks, horizon=150.0, events=outages)


def full_house(deliveries: Sequence[tuple[int, int]]) -> World:
    """AWS hospital, a robot in each of the six rooms; ``deliveries`` name (start, end) rooms."""
    layout = load_layout("aws_hospital")
    robots = [_robot(i, room.point) for i, room in enumerate(layout.rooms)]
    tasks = [_task(1.0, start, end) for start, end in deliveries]
    return _scene(layout, "full_house", robots, tasks, horizon=300.0)


def cluttered_ward() -> World:
    """A delivery past seven pieces of furniture and a person: something for every verdict."""
    layout = ward_layout(rooms=3)
    places = [(3.9, 0.3), (5.2, 3.7), (6.4, 0.35), (8.6, 0.3), (9.9, 3.6), (11.0, 0.4), (3.4, 6.4)]
    furniture = [
        Furniture(name=f"item_{i}", kind="chair", polygon=rectangle(0.5, 0.5, place))
        for i, place in enumerate(places)
    ]
    world = _scene(
        layout,
        "cluttered_ward",
        [_robot(0, (2.5, 1.5)), _robot(1, layout.rooms[2].point, SOUTH)],
        [_task(1.0, 2, 1), _task(1.0, 0, 1)],
        horizon=60.0,
        furniture=furniture,
    )
    person = HumanSpec(name="person", route=frozen_array([[6.0, 2.6], [12.0, 2.6]]))
    return dataclasses.replace(world, humans=(person,))
