"""Small worlds for the mission layer, and a run of one with its invariants checked each tick."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import Frame, StackEvent
from mrta_falsify.core.world import Resource, RobotSpec, Task, World
from mrta_falsify.stack.mission import StackState
from mrta_falsify.testing.wards import ward_layout
from simulator_interface.episode import Episode

KINEMATIC = StackConfig(engine=Choice("kinematic"))


def ward(
    places: Sequence[object],
    tasks: Sequence[tuple[float, int, int]],
    *,
    robot: dict[str, object] | None = None,
    horizon: float = 240.0,
    layout: World | None = None,
    **lengths: object,
) -> World:
    """A ward with robots in rooms (numbers) or at points, and tasks (arrival, start, end)."""
    layout = layout or ward_layout(**lengths)  # type: ignore[arg-type]
    robots = []
    for number, place in enumerate(places):
        x, y = layout.rooms[place].point if isinstance(place, int) else place
        pose = frozen_array([x, y, -np.pi / 2])
        robots.append(RobotSpec(name=f"robot{number}", pose=pose, **(robot or {})))
    return dataclasses.replace(
        layout,
        robots=tuple(robots),
        tasks=tuple(
            Task(arrival=arrival, start=start, end=end, deadline=arrival + 900.0)
            for arrival, start, end in tasks
        ),
        horizon=horizon,
    )


@dataclass
class Run:
    """What became of a world."""

    events: list[StackEvent]
    time: float
    done: bool
    state: StackState
    last: Frame
    pose: np.ndarray  #: (K, N, 3)

    def kinds(self, robot: int | None = None) -> list[str]:
        return [e.kind for e in self.events if robot is None or e.robot == robot]

    def at(self, kind: str, **fields: object) -> list[StackEvent]:
        return [
            e
            for e in self.events
            if e.kind == kind and all(getattr(e, name) == value for name, value in fields.items())
        ]


def run(
    world: World,
    config: StackConfig = KINEMATIC,
    *,
    watch: Callable[[Episode, Frame], None] | None = None,
    exclusive: bool = True,
) -> Run:
    """Run ``world`` until its tasks are done; every tick keeps the invariants."""
    episode = Episode(world, config)
    events, poses = [], []
    frames = episode.frames()
    for frame in frames:
        events.extend(frame.events)
        poses.append(frame.sensed.pose)
        assert episode.state is not None
        check_tasks(world, episode.state, frame.sensed.time)
        if exclusive:
            check_queues(world, episode.state)
        if watch is not None:
            watch(episode, frame)
        if (episode.all_done and world.tasks) or frame.sensed.time >= world.horizon:
            break
    frames.close()
    return Run(events, frame.sensed.time, episode.all_done, episode.state, frame, np.stack(poses))


def check_tasks(world: World, state: StackState, time: float) -> None:
    """Every task that arrived is in exactly one place, and in order."""
    dispatcher, missions = state.dispatcher, state.missions
    arrived = sum(task.arrival <= time for task in world.tasks)
    assert dispatcher.known == arrived
    assert len(dispatcher.open) + dispatcher.delivered == arrived
    pickups = Counter(s.task for m in missions for s in m.itinerary if s.action == "pickup")
    dropoffs = Counter(s.task for m in missions for s in m.itinerary if s.action == "dropoff")
    onboard = Counter(task for m in missions for task in m.onboard)
    waiting = Counter(dispatcher.waiting)
    assert pickups + onboard + waiting == Counter(dispatcher.open)
    assert dropoffs == pickups + onboard
    for robot, mission in zip(world.robots, missions, strict=True):
        load = set(mission.onboard)
        assert len(load) <= robot.capacity
        for stop in mission.itinerary:
            if stop.action == "pickup":
                load.add(stop.task)
            else:
                load.remove(stop.task)
            assert len(load) <= robot.capacity
        assert not load


def check_queues(world: World, state: StackState) -> None:
    """Never more holders than places, nobody twice, nobody both holds and waits."""
    for resource, memory in zip(world.resources, state.queues, strict=True):
        waiting = [waiter.robot for waiter in memory.waiters]
        assert len(memory.holders) <= resource.capacity, resource.name
        assert len(set(memory.holders + waiting)) == len(memory.holders) + len(waiting)


def area(kind: str, corners: tuple[float, float, float, float], **fields: object) -> Resource:
    """An area resource over a box (x1, y1, x2, y2), asked for from 3 m around it."""
    x1, y1, x2, y2 = corners
    box = frozen_array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])
    wide = frozen_array([[x1 - 3, y1 - 3], [x2 + 3, y1 - 3], [x2 + 3, y2 + 3], [x1 - 3, y2 + 3]])
    return Resource(
        **{"name": kind, "kind": kind, "request_area": wide, "release_area": box, **fields}
    )


def with_resources(world: World, *resources: Resource) -> World:
    return dataclasses.replace(world, resources=world.resources + resources)
