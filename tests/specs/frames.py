"""Synthetic frames: robots that follow a script, without simulator or stack."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Command, Frame, StackEvent, no_intent, nothing_sensed
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import (
    Furniture,
    HumanSpec,
    Resource,
    RobotSpec,
    Room,
    Task,
    Wall,
    World,
)
from mrta_falsify.specs.books import Books
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker
from simulator_interface.forecast import discs_of

DT = 0.05
NOWHERE = (np.nan, np.nan)
Track = Callable[[float], tuple[float, float, float]]


@dataclass
class Robot:
    """One scripted robot."""

    at: Track | tuple[float, float]  #: time -> x, y, yaw; or where it stands
    goal: tuple[float, float] | Callable[[float], tuple[float, float]] = NOWHERE
    #: default: straight to the goal
    path: Sequence[tuple[float, float]] | Callable[[float], Sequence] | None = None
    no_path: bool = False
    stops: int | Callable[[float], int] = 1
    waits_for: str = ""  #: as the stack tells


@dataclass
class Human:
    """One scripted person."""

    at: Callable[[float], tuple[float, float]] | tuple[float, float]
    route: Sequence[tuple[float, float]] = ((0.0, 0.0), (9.0, 9.0))


@dataclass
class Script:
    """A world and who does what in it."""

    robots: Sequence[Robot]
    humans: Sequence[Human] = ()
    seconds: float = 30.0
    walls: Sequence[Array] = ()
    furniture: Sequence[Array] = ()
    rooms: Sequence[tuple[float, float]] = ()
    resources: Sequence[Resource] = ()
    parking: Sequence[tuple[float, float]] = ()
    tasks: Sequence[Task] = ()
    events: Sequence = ()
    stack_events: Callable[[int], tuple[StackEvent, ...]] = lambda tick: ()
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0)
    horizon: float = 900.0
    names: Sequence[str] = ()
    command: Callable[[float], Array] | None = None
    signals: Callable[[float], dict[str, float]] = lambda time: {}
    radius: float = 0.22
    _paths: dict = field(default_factory=dict)

    def world(self) -> World:
        names = self.names or [f"robot{i + 1}" for i in range(len(self.robots))]
        rooms = len(self.rooms)
        return World(
            name="script",
            bounds=np.array(self.bounds),
            walls=tuple(Wall(name=f"wall{i}", polygon=p) for i, p in enumerate(self.walls)),
            furniture=tuple(
                Furniture(name=f"bed{i}", kind="bed", polygon=p)
                for i, p in enumerate(self.furniture)
            ),
            rooms=tuple(
                Room(
                    name=f"room{i}", point=np.array(p), door=np.zeros((0, 2)), area=np.zeros((0, 2))
                )
                for i, p in enumerate(self.rooms)
            ),
            resources=tuple(self.resources),
            parking=np.array(self.parking, dtype=float).reshape(-1, 2),
            travel_times=np.ones((rooms, rooms)),
            robots=tuple(
                RobotSpec(name=name, pose=np.array(_pose(robot, 0.0)))
                for name, robot in zip(names, self.robots, strict=True)
            ),
            humans=tuple(
                HumanSpec(name=f"human{i}", route=np.array(human.route, dtype=float))
                for i, human in enumerate(self.humans)
            ),
            tasks=tuple(self.tasks),
            events=tuple(self.events),
            horizon=self.horizon,
        )

    def frames(self, world: World | None = None) -> Iterator[Frame]:
        world = world or self.world()
        tracker, books = BlockedByTracker(world, DT), Books(world)
        previous = None
        for tick in range(round(self.seconds / DT) + 1):
            frame = self._frame(tick, previous)
            previous = frame.sensed.pose
            edges = tracker.update(frame.sensed, frame.intent, frame.served, events=frame.events)
            entries = books.update(frame.sensed, frame.events)
            yield dataclasses.replace(frame, blocked_by=edges, **entries._asdict())

    def _frame(self, tick: int, previous: Array | None) -> Frame:
        time = tick * DT
        pose = np.array([_pose(robot, time) for robot in self.robots]).reshape(-1, 3)
        count = len(pose)
        moved = np.zeros((count, 3)) if previous is None else (pose - previous) / DT
        velocity = np.zeros((count, 3))
        velocity[:, 0] = np.hypot(moved[:, 0], moved[:, 1])
        velocity[:, 2] = moved[:, 2]
        people = np.array([_point(human.at, time) for human in self.humans]).reshape(-1, 2)
        goal = np.array([_point(robot.goal, time) for robot in self.robots]).reshape(-1, 2)
        stops = [r.stops(time) if callable(r.stops) else r.stops for r in self.robots]
        gap_robot, nearest_robot = _gaps(pose[:, :2], pose[:, :2], 2 * self.radius, same=True)
        gap_human, nearest_human = _gaps(pose[:, :2], people, self.radius + 0.25)
        contact = np.stack([gap_robot < 0, gap_human < 0, np.zeros(count, dtype=bool)], axis=1)
        sensed = dataclasses.replace(
            nothing_sensed(count, len(people), rays=12),
            tick=tick,
            time=time,
            pose=pose,
            velocity=velocity,
            human_position=people,
            gap_robot=gap_robot,
            gap_human=gap_human,
            nearest_robot=nearest_robot,
            nearest_human=nearest_human,
            contact=contact,
        )
        twist = velocity if self.command is None else self.command(time)
        intent = dataclasses.replace(
            no_intent(count),
            goal=goal,
            waypoint=goal,
            path=tuple(self._path(i, pose[i], goal[i], time) for i in range(count)),
            tasks_left=np.array(stops, dtype=np.int64),
            waits_for=tuple(robot.waits_for for robot in self.robots),
        )
        return Frame(
            sensed=sensed,
            command=Command(twist=twist),
            intent=intent,
            events=self.stack_events(tick),
            served=9 - np.array(stops, dtype=np.int64),
            signals=self.signals(time),
        )

    def _path(self, i: int, pose: Array, goal: Array, time: float) -> Array:
        robot = self.robots[i]
        if robot.no_path or not np.isfinite(goal).all():
            return np.zeros((0, 2))
        if callable(robot.path):
            return np.array(robot.path(time), dtype=float)
        if robot.path is not None:
            return self._paths.setdefault(i, np.array(robot.path, dtype=float))
        return np.stack([pose[:2], goal])


def _pose(robot: Robot, time: float) -> tuple[float, float, float]:
    return robot.at(time) if callable(robot.at) else (*robot.at, 0.0)


def _point(at, time: float) -> tuple[float, float]:
    return at(time) if callable(at) else at


def _gaps(position: Array, bodies: Array, radii: float, *, same: bool = False):
    count = len(position)
    if not len(bodies) or (same and count < 2):
        return np.full(count, np.inf), np.full(count, -1)
    distance = np.hypot(*(position[:, None] - bodies[None]).transpose(2, 0, 1))
    if same:
        np.fill_diagonal(distance, np.inf)
    nearest = distance.argmin(axis=1)
    return distance[np.arange(count), nearest] - radii, nearest


def drive(
    start: tuple[float, float], end: tuple[float, float], speed: float, leave: float = 0.0
) -> Track:
    """Straight from ``start`` to ``end`` at ``speed``, leaving at time ``leave``."""
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)))
    yaw = float(np.arctan2(*(b - a)[::-1]))

    def at(time: float) -> tuple[float, float, float]:
        share = min(1.0, max(0.0, (time - leave) * speed / length)) if length else 1.0
        x, y = a + share * (b - a)
        return float(x), float(y), yaw

    return at


def stop_at(track: Track, time_of_stop: float) -> Track:
    """``track`` until ``time_of_stop``, at rest after it."""
    return lambda time: track(min(time, time_of_stop))


def corridor(width: float = 1.0, length: float = 12.0) -> list[Array]:
    """Two walls along x, ``width`` apart, closed around by nothing."""
    half = length / 2
    return [
        rectangle(length, 0.2, (0.0, width / 2 + 0.1)) + np.array([0.0, 0.0]),
        rectangle(length, 0.2, (0.0, -width / 2 - 0.1)) + half * np.zeros(2),
    ]


def room_resource(
    room: int, point: tuple[float, float], spots: Sequence[tuple[float, float]], reach: float = 5.0
) -> Resource:
    """A room's queue with a square request and release area."""
    area = rectangle(2 * reach, 2 * reach, point)
    return Resource(
        name=f"room{room}",
        kind="room",
        room=room,
        spots=np.array(spots, dtype=float).reshape(-1, 2),
        entry=np.zeros((0, 2)),
        request_area=area,
        release_area=area,
    )


def judge(specification, script: Script):
    """Verdict of ``specification`` on ``script``."""
    world = script.world()
    specification.start(world, DT)
    for frame in script.frames(world):
        specification.update(frame)
    return specification.verdict()


def offer(specification, world: World, forecast: Callable, *, is_outside: bool = False) -> None:
    """Offer forecasts that ``forecast`` answers."""
    forecast.is_outside, forecast.discs = is_outside, discs_of(world)
    specification.foresee(forecast)
