"""One test world per planted defect, and the specification that catches it.

Every builder makes ``world(seed)``: a small ward in which the default stack keeps the
specification and the stack with the defect breaks it. The seed varies what the comment of
each builder says (starts, times, widths, speeds); nothing is tuned per seed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.seeding import stream
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    Furniture,
    HumanSpec,
    RobotSpec,
    Task,
    World,
)
from mrta_falsify.testing.wards import ward_layout

SPEED = 0.69  # m/s, mean speed of MRTA-Sim's travel times; deadlines are made from it
#: ``no_deadlock`` by one continuation of half a minute: enough where a robot stands for good, at a
#: tenth of the time
STANDS = "no_deadlock{copies: 1, look_ahead: 30}"
#: the same by a minute: enough where two robots creep until they stand
CREEPS = "no_deadlock{copies: 1, look_ahead: 60}"


@dataclass(frozen=True)
class Plant:
    """A planted defect and where it shows."""

    defect: str
    specification: str  #: registered name, or module:Class
    world: Callable[[int], World]
    scene: str  #: what happens, in a sentence


EXCLUSIVE_USE = "exclusive_use"


def _robot(number: int, place: Array | Sequence[float], yaw: float = 0.0) -> RobotSpec:
    return RobotSpec(name=f"robot{number + 1}", pose=np.array([place[0], place[1], yaw]))


def _near(random: np.random.Generator, place: Array | Sequence[float], reach: float = 0.2) -> Array:
    """``place`` moved by up to ``reach`` [m] per axis."""
    return np.asarray(place) + random.uniform(-reach, reach, 2)


def _yaw(random: np.random.Generator) -> float:
    return float(random.uniform(-np.pi, np.pi))


def _world(
    layout: World,
    seed: int,
    *,
    robots: Sequence[RobotSpec],
    tasks: Sequence[Task],
    horizon: float,
    **more: Any,
) -> World:
    return dataclasses.replace(
        layout,
        robots=tuple(robots),
        tasks=tuple(tasks),
        horizon=horizon,
        seed=seed,
        **more,
    )


def _reaching(layout: World, start: int, end: int) -> float:
    """Time [s] that the dispatcher's table gives for the way between two rooms."""
    return float(layout.travel_times[start, end])


# --- controller ------------------------------------------------------------------------


def _someone_comes_the_other_way(
    seed: int, name: str, *, bystanders: int, companion: bool
) -> World:
    """A robot drives east on its lane; a person who does not react walks west on it.

    Varied: where robot and person begin, how fast the person walks, when the task comes, the
    width of the corridor; the companion's distance behind.
    """
    random = stream(seed, f"defects/{name}")
    width = float(random.uniform(3.2, 4.2))
    layout = ward_layout(rooms=5, corridor_width=width)
    lane = width / 2.0 - 0.5
    start = np.array([float(random.uniform(3.0, 4.0)), lane])
    robots = [_robot(0, start, float(random.uniform(-0.3, 0.3)))]
    arrival = float(random.uniform(0.0, 2.0))
    tasks = [Task(arrival=arrival, start=4, end=3, deadline=110.0)]
    if companion:
        # Behind it, on the same way; the last of the cluster, whose state the defect takes.
        behind = start - np.array([float(random.uniform(1.5, 2.4)), 0.0])
        robots.append(_robot(1, behind, float(random.uniform(-0.3, 0.3))))
        tasks.append(Task(arrival=arrival, start=3, end=2, deadline=110.0))
    people = [
        HumanSpec(name=f"bystander{i + 1}", route=room.point[None, :] + np.array([1.2, 0.8]))
        for i, room in enumerate(layout.rooms[:bystanders])
    ]
    x = float(random.uniform(12.0, 17.0))
    route = np.array([[x, lane + random.uniform(-0.15, 0.15)], [0.6, lane]])
    people.append(
        HumanSpec(
            name="walker",
            route=route,
            repeat=False,
            speed=float(random.uniform(0.6, 1.3)),
            reacts_to_robots=False,
        )
    )
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=90.0, humans=tuple(people))


def cluster_rows_wrong_robot(seed: int) -> World:
    """Two robots in one cluster, and a person ahead of the one that is not last in it."""
    return _someone_comes_the_other_way(
        seed, "cluster_rows_wrong_robot", bystanders=0, companion=True
    )


def humans_unseen_beyond_two(seed: int) -> World:
    """Two people stand in rooms; the third walks towards the robot."""
    return _someone_comes_the_other_way(
        seed, "humans_unseen_beyond_two", bystanders=2, companion=False
    )


def follower_zero_command(seed: int) -> World:
    """Three robots drive down the corridor one behind the other, in one cluster.

    Each follower falls back until it is out of the cluster, and the next one behind it.
    Varied: starts, headings, the corridor's width, service times. Deadlines come from the
    dispatcher's own table of travel times, 8 s less (robots are faster than it says).
    """
    random = stream(seed, "defects/follower_zero_command")
    width = float(random.uniform(3.6, 4.4))
    layout = ward_layout(rooms=8, two_sided=True, room_width=9.0, corridor_width=width)
    lane = width / 2.0 - 0.5
    gap = float(random.uniform(0.9, 1.2))
    robots = [
        _robot(i, (1.5 + i * gap, lane + random.uniform(-0.1, 0.1)), random.uniform(-0.2, 0.2))
        for i in range(3)
    ]
    service = float(random.uniform(0.0, 4.0))
    tasks = [
        Task(
            arrival=0.0,
            start=start,
            end=end,
            deadline=_reaching(layout, 0, start) + service + _reaching(layout, start, end) - 8.0,
            pickup_time=service,
        )
        for start, end in ((2, 3), (4, 5), (6, 7))
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=110.0)


def fixed_priority_starves(seed: int) -> World:
    """The robot that goes first is shut in by an idle one; its neighbour has work elsewhere.

    The idle robot stands in the door and cannot be asked aside while its link to leaders is
    down. Varied: for how long, where and how it stands, starts, door and corridor widths.
    """
    random = stream(seed, "defects/fixed_priority_starves")
    layout = ward_layout(
        rooms=5,
        room_width=3.2,
        spots=1,
        door_width=float(random.uniform(1.0, 1.2)),
        corridor_width=float(random.uniform(3.2, 4.0)),
    )
    door = layout.rooms[3].door.mean(axis=0)
    robots = [
        _robot(0, _near(random, layout.rooms[2].point), _yaw(random)),
        _robot(1, _near(random, layout.rooms[3].point), _yaw(random)),
        _robot(2, _near(random, door, 0.1), _yaw(random)),
    ]
    ends = float(random.uniform(30.0, 45.0))
    outage = CommsOutage(
        name="deaf", robots=("robot3",), links=("leader", "states"), start=0.0, end=ends
    )
    tasks = [
        Task(arrival=0.0, start=3, end=4, deadline=ends + 2.0 * _reaching(layout, 3, 4)),
        Task(arrival=0.0, start=2, end=1, deadline=_reaching(layout, 2, 1) + 10.0),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=120.0, events=(outage,))


# --- queues ----------------------------------------------------------------------------


def queue_release_loses_exclusion(seed: int) -> World:
    """One robot loads in a room, one waits for the room, a third leaves its doorway.

    The third holds the room too, because it stood before the door. Varied: starts, service
    time, when the tasks come.
    """
    random = stream(seed, "defects/queue_release_loses_exclusion")
    layout = ward_layout(rooms=3, door_width=float(random.uniform(1.2, 1.6)))
    room = layout.rooms[0].point
    apron = layout.resources[0].entry[0]
    robots = [
        _robot(0, _near(random, room, 0.15), _yaw(random)),
        _robot(1, _near(random, layout.resources[0].spots[1]), np.pi),
        _robot(2, _near(random, apron, 0.15), _yaw(random)),
    ]
    loading = float(random.uniform(25.0, 40.0))
    tasks = [
        Task(arrival=0.0, start=0, end=2, deadline=200.0, pickup_time=loading),
        Task(arrival=float(random.uniform(1.0, 2.0)), start=0, end=1, deadline=200.0),
        Task(arrival=float(random.uniform(6.0, 9.0)), start=2, end=1, deadline=200.0),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=120.0)


def room_freed_while_parked(seed: int) -> World:
    """A robot unloads its last delivery in a room; another waits before it with the next one.

    Varied: starts, when the second task comes, service times, the door's width.
    """
    random = stream(seed, "defects/room_freed_while_parked")
    layout = ward_layout(rooms=3, door_width=float(random.uniform(1.0, 1.6)))
    robots = [
        _robot(0, _near(random, layout.rooms[1].point), _yaw(random)),
        _robot(1, _near(random, layout.rooms[2].point), _yaw(random)),
    ]
    unloading = float(random.uniform(15.0, 25.0))
    tasks = [
        Task(arrival=0.0, start=1, end=0, deadline=200.0, dropoff_time=unloading),
        Task(arrival=float(random.uniform(0.5, 5.0)), start=2, end=0, deadline=200.0),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=120.0)


def fourth_waiter_dropped(seed: int) -> World:
    """One robot loads for a while; four others come for the same room.

    Varied: starts, service times, the corridor's width.
    """
    random = stream(seed, "defects/fourth_waiter_dropped")
    layout = ward_layout(rooms=6, spots=4, corridor_width=float(random.uniform(3.6, 4.4)))
    places = [np.array([room.point[0], 0.6]) for room in layout.rooms[1:5]]
    robots = [
        dataclasses.replace(_robot(i, _near(random, place, 0.15), _yaw(random)), capacity=1)
        for i, place in enumerate([layout.rooms[0].point, *places])
    ]
    loading = float(random.uniform(30.0, 36.0))
    tasks = [
        Task(
            arrival=0.0 if end == 5 else 0.5,  # the robot in the room gets the first one
            start=0,
            end=end,
            deadline=300.0,
            pickup_time=loading if end == 5 else float(random.uniform(0.0, 2.0)),
        )
        for end in range(1, 6)
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=200.0)


# --- waypoints, costmap, planner -------------------------------------------------------


def same_room_twice_stalls(seed: int) -> World:
    """A robot brings something to a room and takes the next thing from there.

    Varied: start, service times, which rooms.
    """
    random = stream(seed, "defects/same_room_twice_stalls")
    layout = ward_layout(rooms=3)
    first, middle, last = (int(k) for k in random.permutation(3))
    robot = _robot(0, _near(random, layout.rooms[first].point), _yaw(random))
    tasks = [
        Task(
            arrival=0.0,
            start=first,
            end=middle,
            deadline=300.0,
            pickup_time=float(random.uniform(0.0, 3.0)),
            dropoff_time=float(random.uniform(0.0, 3.0)),
        ),
        Task(arrival=0.0, start=middle, end=last, deadline=300.0),
    ]
    return _world(layout, seed, robots=[robot], tasks=tasks, horizon=120.0)


def costmap_blind_to_furniture(seed: int) -> World:
    """A bookshelf stands across the lane, with room to pass north of it.

    Varied: where it stands, its size, the corridor's width, the start.
    """
    random = stream(seed, "defects/costmap_blind_to_furniture")
    width = float(random.uniform(3.6, 4.4))
    layout = ward_layout(rooms=3, corridor_width=width, spots=2)
    depth = float(random.uniform(0.35, 0.6))
    # From the south wall over the lane (0.5 m south of the middle) and well beyond it.
    reach = float(random.uniform(width / 2.0 + 0.3, width - 1.2))
    middle = (float(random.uniform(5.6, 6.4)), reach / 2.0)
    shelf = Furniture(
        name="bookshelf", kind="bookshelf", polygon=rectangle(depth, reach, middle), height=1.8
    )
    robot = _robot(0, _near(random, layout.rooms[0].point), _yaw(random))
    tasks = [Task(arrival=0.0, start=0, end=2, deadline=_reaching(layout, 0, 2) + 5.0)]
    return _world(layout, seed, robots=[robot], tasks=tasks, horizon=100.0, furniture=(shelf,))


def planner_failure_blocks_all(seed: int) -> World:
    """One robot's door is blocked for a while; the others' deliveries are due before that.

    Varied: which robot, for how long, starts, service times, where the blockage stands.
    """
    random = stream(seed, "defects/planner_failure_blocks_all")
    layout = ward_layout(rooms=6, corridor_width=float(random.uniform(3.2, 4.2)))
    rooms = [int(k) for k in random.permutation(6)]
    shut, free, empty = rooms[0], rooms[1:3], rooms[3:]
    robots = [
        _robot(i, _near(random, layout.rooms[room].point), _yaw(random))
        for i, room in enumerate((shut, *free))
    ]
    door = layout.rooms[shut].door.mean(axis=0)
    opens = float(random.uniform(70.0, 85.0))
    bed = Blockage(
        name="bed_in_the_door",
        polygon=rectangle(1.4, 0.6, (door[0], door[1] + float(random.uniform(-0.2, 0.1)))),
        start=0.0,
        end=opens,
    )
    service = float(random.uniform(0.0, 3.0))
    tasks = [
        Task(arrival=0.0, start=shut, end=empty[2], deadline=opens + 60.0),
        *(
            Task(
                arrival=0.0,
                start=room,
                end=end,
                deadline=_reaching(layout, room, end) + 20.0,
                pickup_time=service,
            )
            for room, end in zip(free, empty, strict=False)
        ),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=150.0, events=(bed,))


# --- allocator -------------------------------------------------------------------------


def late_feedback_unsat(seed: int) -> World:
    """A robot at half the speed of the dispatcher's table is late when a second batch comes.

    Varied: starts, speed, when the second batch comes, and which rooms are asked for.
    """
    random = stream(seed, "defects/late_feedback_unsat")
    layout = ward_layout(rooms=5)
    slow = float(random.uniform(0.3, 0.4))
    robots = [
        dataclasses.replace(_robot(0, _near(random, layout.rooms[0].point)), max_speed=slow),
        _robot(1, _near(random, layout.rooms[4].point), _yaw(random)),
    ]
    end = int(random.integers(2, 4))
    batch = float(random.uniform(45.0, 60.0))
    tasks = [
        Task(arrival=0.0, start=0, end=end, deadline=400.0),
        Task(arrival=batch, start=4, end=1, deadline=450.0),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=240.0)


def no_plan_when_infeasible(seed: int) -> World:
    """One of two deliveries cannot be in time; both can be made.

    Varied: starts, rooms, and by how much the deadline is missed.
    """
    random = stream(seed, "defects/no_plan_when_infeasible")
    layout = ward_layout(rooms=4)
    robots = [_robot(i, _near(random, layout.rooms[i].point), _yaw(random)) for i in range(2)]
    ends = random.permutation([2, 3])
    tasks = [
        Task(arrival=0.0, start=0, end=int(ends[0]), deadline=float(random.uniform(2.0, 8.0))),
        Task(arrival=0.0, start=1, end=int(ends[1]), deadline=300.0),
    ]
    return _world(layout, seed, robots=robots, tasks=tasks, horizon=180.0)


PLANTS: dict[str, Plant] = {
    plant.defect: plant
    for plant in (
        Plant(
            "cluster_rows_wrong_robot",
            "no_robot_human_contact",
            cluster_rows_wrong_robot,
            "a person walks towards the first of two robots in a cluster",
        ),
        Plant(
            "follower_zero_command",
            "deadlines",
            follower_zero_command,
            "two robots drive side by side",
        ),
        Plant(
            "queue_release_loses_exclusion",
            EXCLUSIVE_USE,
            queue_release_loses_exclusion,
            "a robot leaves a doorway while another one loads inside and a third waits",
        ),
        Plant(
            "room_freed_while_parked",
            EXCLUSIVE_USE,
            room_freed_while_parked,
            "a robot has finished in a room; the next one waits before it",
        ),
        Plant(
            "same_room_twice_stalls",
            "all_tasks_done",
            same_room_twice_stalls,
            "a drop-off and the next pick-up in one room",
        ),
        Plant(
            "costmap_blind_to_furniture",
            "deadlines",
            costmap_blind_to_furniture,
            "a bookshelf across the lane, with a way round it",
        ),
        Plant(
            "humans_unseen_beyond_two",
            "no_robot_human_contact",
            humans_unseen_beyond_two,
            "the third person walks towards the robot",
        ),
        Plant(
            "planner_failure_blocks_all",
            "deadlines",
            planner_failure_blocks_all,
            "one robot is shut in for a minute, the others have deadlines before that",
        ),
        Plant(
            "fourth_waiter_dropped",
            "all_tasks_done",
            fourth_waiter_dropped,
            "four robots come for a room in which a fifth loads",
        ),
        Plant(
            "fixed_priority_starves",
            "deadlines",
            fixed_priority_starves,
            "an idle robot in the door shuts the leader in, a neighbour has work",
        ),
        Plant(
            "late_feedback_unsat",
            "all_tasks_done",
            late_feedback_unsat,
            "a slow robot is late when the second batch of tasks comes",
        ),
        Plant(
            "no_plan_when_infeasible",
            "all_tasks_done",
            no_plan_when_infeasible,
            "one of two deliveries cannot be in time",
        ),
    )
}
