"""The tick loop: engine and stack exchange values until the episode ends.

``episode`` yields one :class:`Frame` per control tick; ``simulate`` folds the frames into a
trace and verdicts. Both are functions of (world, configuration): same input, same digest.
"""

from __future__ import annotations

import dataclasses
import time as wall_clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core import registry, seeding
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.fleet import FleetState, Frame, Sensed, StackEvent
from mrta_falsify.core.protocols import Engine, Specification
from mrta_falsify.core.trace import Trace, TraceRecorder
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.blocked_by import BlockedByTracker
from mrta_falsify.specs.library import ContactCounter
from mrta_falsify.stack.stack import Stack, StackState
from simulator_interface.crowd import Crowd, present_humans

#: people need more room than a robot's disc; they see every object
PEOPLES_MAP = Choice("layered", {"robot_radius": 0.3})
MOVED = 0.05  # m; a robot that stays within this of its place counts as parked


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskCount:
    """How the tasks fared."""

    total: int
    completed: int
    late: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcome:
    """One finished episode."""

    trace: Trace  #: without columns if the trace was not kept; the digest is always there
    verdicts: tuple[Verdict, ...]
    contacts: dict[str, int]  #: robot_robot, robot_human, robot_static, robot_human_at_rest
    tasks: TaskCount
    robots_finished: int  #: robots that served all their stops
    ended: str  #: why the episode ended
    sim_time: float  #: simulated [s]
    wall_s: float  #: measured; never part of a digest


class _Localisation:
    """Turns ground truth into what the stack is told."""

    def __init__(self, world: World, human_radius: Array) -> None:
        robots = world.robots
        self._spread = np.array(
            [[r.position_noise, r.position_noise, r.heading_noise] for r in robots]
        ).reshape(-1, 3)
        self._random = seeding.stream(world.seed, "localisation")
        self._human_radius = human_radius
        self._anchor = np.full((len(robots), 2), np.inf)
        self._since = np.zeros(len(robots))

    def fleet(self, sensed: Sensed) -> FleetState:
        """What the stack is told about ``sensed``."""
        position = sensed.pose[:, :2]
        moved = ~(np.hypot(*(position - self._anchor).T) <= MOVED)
        self._anchor[moved] = position[moved]
        self._since[moved] = sensed.time
        pose = sensed.pose
        if self._spread.any():
            pose = pose + self._random.normal(size=pose.shape) * self._spread
        return FleetState(
            tick=sensed.tick,
            time=sensed.time,
            pose=pose,
            velocity=sensed.velocity,
            human_position=sensed.human_position,
            human_velocity=sensed.human_velocity,
            human_radius=self._human_radius,
            obstacle_points=sensed.obstacle_points,
            parked_for=sensed.time - self._since,
        )


class Episode:
    """An episode in progress: iterate it for its frames, or fork its stack on the way."""

    def __init__(self, world: World, config: StackConfig) -> None:
        self.world = world
        self.config = config
        self.dt = 1.0 / config.control_rate
        self.state: StackState | None = None
        source = registry.build("costmap", config.costmap, defects=config.defects).bind(world)
        self._engine: Engine = registry.build("engine", config.engine)
        self.stack = Stack(world, config, source)
        self._crowd = self._new_crowd()
        self._tracker = BlockedByTracker(world, self.dt)
        self._localisation = _Localisation(world, np.array([h.radius for h in world.humans]))

    def _new_crowd(self) -> Crowd:
        # People find their way on the true map, whatever the stack's own map leaves out.
        true_map = registry.build("costmap", PEOPLES_MAP).bind(self.world)
        model = registry.build("human_model", self.config.human_model)
        planner = registry.build("planner", StackConfig().planner)
        return Crowd(world=self.world, model=model, planner=planner, source=true_map, dt=self.dt)

    def frames(self) -> Iterator[Frame]:
        """Frames from time 0 on, for as long as they are asked for."""
        try:
            human_position = self._crowd.start()
            sensed = self._engine.start(self.world, self.dt, human_position)
            self.state = self.stack.start()
            while True:
                seen = self._without_absent(sensed)
                fleet = self._localisation.fleet(seen)
                self.state, command, intent, events = self.stack.step(self.state, fleet)
                edges = self._tracker.update(seen, command, intent, events)
                yield Frame(
                    sensed=sensed, command=command, intent=intent, events=events, blocked_by=edges
                )
                human_velocity = self._crowd.velocities(sensed)
                sensed = self._engine.step(command, human_velocity)
        finally:
            self._engine.close()

    def _without_absent(self, sensed: Sensed) -> Sensed:
        """What can be perceived: people who are not in the building are nowhere."""
        present = present_humans(self.world, sensed.time)
        if present.all():
            return sensed
        seen = np.where(present[:, None], sensed.human_position, np.inf)
        return dataclasses.replace(sensed, human_position=seen)

    @property
    def all_done(self) -> bool:
        """Whether every task is delivered and none is to come."""
        return self.state is not None and self.stack.all_done(self.state)


def episode(world: World, config: StackConfig) -> Iterator[Frame]:
    """Frames of an episode until all tasks are done or the horizon is reached.

    Args:
        world: what to simulate.
        config: the stack under test.

    Yields:
        One frame per control tick, the first at time 0.

    Raises:
        InputError: the world cannot be run (a start inside a wall) or a layer is unknown.
    """
    running = Episode(world, config)
    for frame in running.frames():
        yield frame
        if _end_of(running, frame):
            return


def _end_of(running: Episode, frame: Frame) -> str:
    if running.world.tasks and running.all_done:
        return "all-tasks-done"
    if frame.sensed.time >= running.world.horizon - 0.5 * running.dt:
        return "horizon"
    return ""


def simulate(
    world: World,
    config: StackConfig,
    *,
    specifications: Sequence[Specification] = (),
    keep_trace: bool = True,
    on_progress: Callable[[float], None] | None = None,
    stop: Callable[[Frame], str] | None = None,
) -> Outcome:
    """Run one episode to its end.

    Args:
        world: what to simulate.
        config: the stack under test.
        specifications: folds that score the run; they are started here.
        keep_trace: keep columns and tables; without, the trace has only its digest.
        on_progress: called about once per simulated second with the time [s].
        stop: ends the episode at the first frame for which it returns a reason.

    Returns:
        Trace, verdicts and counts. Ctrl-C ends the episode as "interrupted" and returns
        what was seen until then.

    Raises:
        InputError: as in :func:`episode`.
    """
    began = wall_clock.perf_counter()
    running = Episode(world, config)
    recorder = TraceRecorder(
        world_digest=world.digest(),
        dt=running.dt,
        robots=tuple(robot.name for robot in world.robots),
        humans=tuple(human.name for human in world.humans),
        keep=keep_trace,
    )
    contacts = ContactCounter()
    contacts.start(world, running.dt)
    for specification in specifications:
        specification.start(world, running.dt)
    ledger = _TaskLedger(world)
    ended, last_time, per_second = "interrupted", 0.0, config.control_rate
    frames = running.frames()
    try:
        for frame in frames:
            recorder.add(frame)
            contacts.update(frame)
            ledger.update(frame.events)
            for specification in specifications:
                specification.update(frame)
            last_time = frame.sensed.time
            if on_progress is not None and frame.sensed.tick % per_second == 0:
                on_progress(last_time)
            reason = _end_of(running, frame) or (stop(frame) if stop is not None else "")
            if reason:
                ended, left = reason, frame.intent.tasks_left
                break
    except KeyboardInterrupt:
        left = np.ones(len(world.robots), dtype=np.int64)
    finally:
        frames.close()  # type: ignore[attr-defined]
    return Outcome(
        trace=recorder.finish(ended),
        verdicts=tuple(specification.verdict() for specification in specifications),
        contacts=contacts.totals(),
        tasks=ledger.count(),
        robots_finished=int((left == 0).sum()),
        ended=ended,
        sim_time=last_time,
        wall_s=wall_clock.perf_counter() - began,
    )


class _TaskLedger:
    """Counts deliveries from the event table."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._delivered: dict[int, float] = {}

    def update(self, events: Sequence[StackEvent]) -> None:
        for event in events:
            if event.kind == "dropped-off":
                self._delivered.setdefault(event.task, event.time)

    def count(self) -> TaskCount:
        tasks = self._world.tasks
        late = sum(time > tasks[number].deadline for number, time in self._delivered.items())
        missing = len(tasks) - len(self._delivered)
        return TaskCount(total=len(tasks), completed=len(self._delivered), late=late + missing)
