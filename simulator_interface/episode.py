"""An episode in progress: engine, people and stack exchange values, one frame a control tick."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Generator
from typing import Any

import numpy as np

from mrta_falsify.core import registry, seeding
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.fleet import SENSED, Command, FleetState, Frame, Sensed, Tells, no_intent
from mrta_falsify.core.protocols import CostmapSource, Engine, FleetStack
from mrta_falsify.core.stack_failure import DeterminismCheck, StackFailed
from mrta_falsify.core.steadiness import Memory, memory_of
from mrta_falsify.core.world import Blockage, HumanSpec, World
from mrta_falsify.specs.books import Books
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker
from mrta_falsify.specs.stops_served import StopsServed
from mrta_falsify.stack.pipeline import Stack
from mrta_falsify.stack.timers import LONGEST_OF_PUSHING, longest_timer, looks_at_plan
from simulator_interface.determinism_check import ask_again
from simulator_interface.engines.sensing import fill_rest
from simulator_interface.external.stack import ProcessStack
from simulator_interface.external.transcript import Transcript
from simulator_interface.observing import AllocatorMeter, TellsFilter
from simulator_interface.people.crowd import Crowd
from simulator_interface.people.walking import PEOPLES_RADIUS
from simulator_interface.stack_calls import Answer, OpenDoor, StackCalls
from simulator_interface.staging import (
    ForgettingPart,
    ReadableEngine,
    RemovingEngine,
    ShiftingEngine,
    StagedEngine,
    StagedSource,
    needs_stage,
)

#: people need more room than a robot's disc; they see every object
PEOPLES_MAP = Choice("layered", {"robot_radius": PEOPLES_RADIUS})

#: measurements that a stack is told, by name
_TOLD = tuple(name for name in SENSED if name != "time" and name in FleetState.__slots__)

NUDGE = 0.002  # m, spread of small differences along each axis: less than any localisation's noise
NUDGE_ROOM = 0.02  # m; a robot with something nearer than this is not moved into it


class _Localisation:
    """Turns ground truth into the fleet state that the stack sees."""

    def __init__(self, world: World, human_radius: Array) -> None:
        robots = world.robots
        self._spread = np.array(
            [[r.position_noise, r.position_noise, r.heading_noise] for r in robots]
        ).reshape(-1, 3)
        self._is_noisy = bool(self._spread.any())
        self._random = seeding.stream(world.seed, "localisation")
        self._human_radius = human_radius
        self._anchor = np.full((len(robots), 2), np.inf)
        self._since = np.zeros(len(robots))

    def reseed(self, random: np.random.Generator) -> None:
        """Draw all further noise from ``random``."""
        self._random = random

    def fleet(self, sensed: Sensed) -> FleetState:
        """Tell the stack about ``sensed``: poses with localisation noise, and rests."""
        fill_rest(sensed.pose, sensed.time, self._anchor, self._since)
        # a stack that writes into its input changes no truth
        told = {name: getattr(sensed, name).copy() for name in _TOLD}
        if self._is_noisy:
            told["pose"] += self._random.normal(size=told["pose"].shape) * self._spread
        return FleetState(
            tick=sensed.tick,
            time=sensed.time,
            human_radius=self._human_radius.copy(),
            parked_for=sensed.time - self._since,
            **told,
        )


class Episode:
    """An episode in progress: iterate it for its frames, or fork its stack on the way.

    Args:
        world: what to simulate.
        config: the stack under test.
        transcript: answers of an earlier run of a foreign stack; None: it is asked.
    """

    def __init__(
        self, world: World, config: StackConfig, transcript: Transcript | None = None
    ) -> None:
        self.world = world
        self.config = config
        self.dt = 1.0 / config.control_rate
        self.state: Any = None  #: memory of the stack
        self.tick = 0  #: of the last frame
        self.books = Books(world)  #: deliveries that motion confirms, the last frame included
        self._served = StopsServed(world)
        self.repeats: Callable[[int], bool] = lambda tick: False  #: ticks that are asked again
        self.at_end = contextlib.ExitStack()  #: what is closed with the episode
        self._meter = AllocatorMeter()
        self._calls = StackCalls(world, config) if config.stack is None else OpenDoor()
        self._answers = transcript
        self._engine: Engine = registry.build("engine", config.engine)
        self._unbuilt: StackFailed | None = None
        try:
            self._source, self.stack = self._calls.ask(self._build, 0, 0.0)
        except StackFailed as failed:
            self._unbuilt = failed  # the episode ends at its first tick
        tells = self.outside.tells if self.outside else Tells()
        self._told = TellsFilter(config.withheld, len(world.robots), tells)
        if needs_stage(world) and self._unbuilt is None:
            self._check_stage()
        self.crowd = self._new_crowd()
        self._resting: tuple[int, ...] | None = None
        self._removed: list[int] = []
        self._sensed: Sensed | None = None  # of the last tick, as measured
        self._tracker = BlockedByTracker(world, self.dt)
        self._localisation = _Localisation(world, np.array([h.radius for h in world.humans]))

    @property
    def outside(self) -> ProcessStack | None:
        """The stack, if it runs in a process of its own."""
        stack = getattr(self, "stack", None)
        return stack if isinstance(stack, ProcessStack) else None

    @property
    def can_copy(self) -> bool:
        """Whether a copy of the run can go on, as far as the stack is concerned."""
        return self.outside is None or self.outside.can_branch

    def become_copy(self) -> None:
        """Take a stack of its own; call it in a copy of the process before it goes on.

        Raises:
            CannotBranch: there is none to be had.
        """
        if self.outside is not None:
            self.outside.branch()

    def close(self) -> None:
        """End the stack's process, and what else is to end; may be called twice."""
        self.at_end.close()
        if self.outside is not None:
            self.outside.close()

    def _build(self, source: CostmapSource | None = None) -> tuple[CostmapSource, FleetStack]:
        config = self.config
        if source is None:
            layer = registry.build("costmap", config.costmap, defects=config.defects)
            source = layer.bind(self.world)
        if config.stack is not None:
            return source, ProcessStack(self.world, config, source, self.books, self._answers)
        return source, Stack(self.world, config, source, metered=self._meter.around)

    def _new_crowd(self) -> Crowd:
        # People plan on the true map, whatever the stack's own map leaves out.
        true_map = registry.build("costmap", PEOPLES_MAP).bind(self.world)
        # Where nobody walks, it does not matter whether an old record's model is still there.
        choice = self.config.human_model if self.world.humans else StackConfig().human_model
        model = registry.build("human_model", choice)
        planner = registry.build("planner", StackConfig().planner)
        return Crowd(world=self.world, model=model, planner=planner, source=true_map, dt=self.dt)

    def _check_stage(self) -> None:
        """Refuse components for which the building never changes.

        Raises:
            ConfigError: names the component.
        """
        parts = (
            ("engine", self.config.engine, isinstance(self._engine, StagedEngine)),
            ("costmap", self.config.costmap, isinstance(self._source, StagedSource)),
        )
        for layer, choice, is_able in parts:
            if not is_able:
                raise ConfigError(
                    f"{layer}={choice.name} cannot run a world with directives or movable "
                    "furniture; see simulator_interface/staging.py for what it needs"
                )

    def add_blockage(self, name: str, polygon: Array, *, height: float, end: float) -> Blockage:
        """Put something down; it stands from the next tick to ``end`` [s].

        Raises:
            ConfigError: engine or costmap cannot take it.
        """
        self._check_stage()
        assert isinstance(self._source, StagedSource)
        blockage = Blockage(
            name=name,
            polygon=polygon,
            height=height,
            start=(self.tick + 1) * self.dt,
            end=max(end, (self.tick + 1) * self.dt),
        )
        self.crowd.add_blockage(blockage)
        self._source.add_blockage(blockage)
        self.world = self.crowd.world
        return blockage

    def replace_person(self, person: int, spec: HumanSpec) -> None:
        """Replace a person who has not appeared yet."""
        self._check_stage()
        self.crowd.replace_person(person, spec)
        self.world = self.crowd.world

    def frames(self) -> Generator[Frame, None, None]:
        """Yield frames from time 0 on, without end.

        Raises:
            StackFailed: the stack does not answer this tick, or not properly.
        """
        try:
            human_position = self.crowd.start()
            sensed = self._engine.start(self.world, self.dt, human_position)
            while True:
                self.tick, self._sensed = sensed.tick, sensed
                measured = sensed
                try:
                    sensed = self._as_staged(sensed)
                    frame = self._answered(sensed)
                except StackFailed:
                    if self.tick == 0:
                        yield self._unanswered(sensed)  # no trace is without a tick
                    raise
                yield frame
                command = frame.command
                if self._removed:
                    command = self._without_removed(command)
                human_velocity = self.crowd.velocities(measured)
                stage = self.crowd.stage()
                if stage is not None:
                    assert isinstance(self._engine, StagedEngine)
                    self._engine.arrange(stage)
                sensed = self._engine.step(command, human_velocity)
        finally:
            self._engine.close()
            self.close()

    def _answered(self, sensed: Sensed) -> Frame:
        """Let the stack take the tick of ``sensed``."""
        if self._unbuilt is not None:
            raise self._unbuilt
        if self.state is None:
            self.state = self._calls.ask(self.stack.start, sensed.tick, sensed.time)
        seen = self._without_absent(sensed) if self.world.humans else sensed
        fleet = self._localisation.fleet(seen)
        determinism = self._ask_again(fleet) if self.repeats(sensed.tick) else None
        answer = self._calls.step(self.stack, self.state, fleet)
        self.state, command, intent, events = answer
        if self._told.keeps_back:
            intent, events = self._told.of(intent, events)
        confirmed, refused = self.books.update(sensed, events)
        served = self._served.update(sensed, intent.goal, confirmed)
        return Frame(
            sensed=sensed,
            command=command,
            intent=intent,
            events=events,
            served=served,
            confirmed=confirmed,
            refused=refused,
            blocked_by=self._tracker.update(seen, intent, served, self._told.tells, events),
            signals=self.outside.signals if self.outside else self._meter.signals,
            tells=self._told.tells,
            determinism=None if determinism is None else determinism(answer),
        )

    def _ask_again(self, fleet: FleetState) -> Callable[[Answer], DeterminismCheck | None]:
        """Ask a copy of the stack a tick that the stack itself has not been asked yet."""
        if self.outside is not None:
            ask = functools.partial(self.stack.step, self.state, fleet)
            asked = self.outside.talk.ask_copy(ask)
            return lambda answer: asked()
        names = [robot.name for robot in self.world.robots]
        return ask_again(self.stack, self.state, fleet, names)

    def _unanswered(self, sensed: Sensed) -> Frame:
        """Make a frame in which every robot rests, for a stack that fails at once."""
        robots = len(self.world.robots)
        return Frame(
            sensed=sensed,
            command=Command(twist=np.zeros((robots, 3))),
            intent=no_intent(robots),
            events=(),
            served=np.zeros(robots, dtype=np.int64),
        )

    def swap(self, config: StackConfig) -> None:
        """Let another stack continue from the same memory; call it between two frames.

        Everything but engine, people and control rate may differ. A controller that differs
        starts anew; all other layers keep their memory in the stack's state. At the first tick
        all of it starts anew, so that nothing is left of what the replaced stack had decided.

        Raises:
            StackFailed: the other stack cannot be built.
        """
        assert self.state is not None, "the episode has not begun"
        assert self.outside is None, "a foreign stack has no layers to swap"
        is_defective = config.defects != self.config.defects
        kept = None if is_defective or config.costmap != self.config.costmap else self._source
        has_other = is_defective or config.controller != self.config.controller
        self.config = config
        time = self.tick * self.dt
        built = self._calls.ask(functools.partial(self._build, kept), self.tick, time)
        self._source, self.stack = built
        if has_other or self.tick == 0:
            started = self._calls.ask(self.stack.start, self.tick, time)
            if self.tick == 0:
                self.state = started
            else:
                self.state.controller = started.controller

    def forget_events(self) -> None:
        """Let nothing new come from outside any more; call it between two frames.

        No task arrives any more, and no blockage or outage begins. Engines and costmap sources
        that are not :class:`~simulator_interface.staging.ForgettingPart` keep theirs.
        """
        assert self.state is not None, "the episode has not begun"
        time = self.tick * self.dt
        self.books.forget_after(time)
        self.stack.forget_after(self.state, time)
        self.crowd.forget_after(time)
        for part in (self._engine, self._source, self.crowd.source):
            if isinstance(part, ForgettingPart):
                part.forget_after(time)

    @functools.cached_property
    def longest_timer(self) -> float:
        """The longest time for which stack or people wait by a clock [s]; inf: it is not known.

        It is known of stacks all of whose layers are ours, in this process, on an engine that has
        no state but what can be read.
        """
        if self.outside is not None or not isinstance(self._engine, ReadableEngine):
            return math.inf
        people = range(len(self.world.humans))
        pushing = LONGEST_OF_PUSHING if any(self.crowd.script_of(i) for i in people) else 0.0
        return max(longest_timer(self.config, people=bool(people)), pushing)

    def memory(self) -> Memory:
        """Read all that decides the next ticks of stack, engine and people."""
        return memory_of(self.state, self._engine, self.crowd, self._localisation)

    def planned_times(self) -> tuple[float, ...]:
        """Moments at which the stack may decide anew by its own plan, past ones too [s]."""
        plans = [mission.itinerary for mission in self.state.missions if mission.itinerary]
        return tuple(time for plan in plans for time in looks_at_plan(plan, self.world.tasks))

    @property
    def can_remove(self) -> bool:
        """Whether robots can be taken away."""
        return isinstance(self._engine, RemovingEngine)

    def remove(self, robot: int) -> None:
        """Take a robot out of the building; call it between two frames.

        The stack sees it stand far outside the map.
        """
        assert isinstance(self._engine, RemovingEngine)
        self._engine.remove(robot)
        self._removed.append(robot)

    def remove_person(self, person: int) -> None:
        """Let a person leave the building for good; call it between two frames.

        Raises:
            ConfigError: engine or costmap cannot take it.
        """
        self._check_stage()
        self.crowd.remove(person)

    @property
    def can_nudge(self) -> bool:
        """Whether robots can be moved a little."""
        return isinstance(self._engine, ShiftingEngine)

    def nudge(self, number: int) -> None:
        """Make a copy of the run differ a little; call it between two frames.

        Robots that touch nothing are moved by a few millimetres, and localisation noise falls
        otherwise.

        Args:
            number: of the copy; the same number makes the same difference.
        """
        assert isinstance(self._engine, ShiftingEngine)
        assert self._sensed is not None, "the episode has not begun"
        random = seeding.stream(self.world.seed, f"nudge {number}")
        offset = random.normal(size=(len(self.world.robots), 2)) * NUDGE
        gaps = (self._sensed.gap_robot, self._sensed.gap_human, self._sensed.gap_static)
        offset[np.min(gaps, axis=0) < NUDGE_ROOM] = 0.0
        self._engine.shift(offset)
        self._localisation.reseed(random)

    def _without_removed(self, command: Command) -> Command:
        twist = np.array(command.twist)
        twist[self._removed] = 0.0
        return Command(twist=twist)

    def _as_staged(self, sensed: Sensed) -> Sensed:
        """Add what the crowd knows: people who have left, and where furniture stands."""
        player = self.crowd.player
        things = player.furnishings
        if things.pieces:
            resting = things.at_rest(sensed.time)
            if resting != self._resting and self._unbuilt is None:
                self._resting = resting
                assert isinstance(self._source, StagedSource)
                outlines = tuple(things.outline(k) for k in resting)
                furnish = functools.partial(self._source.furnish, outlines)
                self._calls.ask(furnish, sensed.tick, sensed.time)
            sensed = dataclasses.replace(sensed, furniture_pose=things.pose)
        if all(player.inside.tolist()):
            return sensed
        position = np.where(player.inside[:, None], sensed.human_position, np.nan)
        return dataclasses.replace(sensed, human_position=position)

    def _without_absent(self, sensed: Sensed) -> Sensed:
        """Leave out the people who are not in the building."""
        present = self.crowd.present(sensed.time)
        if all(present.tolist()):
            return sensed
        seen = np.where(present[:, None], sensed.human_position, np.inf)
        return dataclasses.replace(sensed, human_position=seen)

    @property
    def all_done(self) -> bool:
        """Whether everything that can still arrive has been delivered, as the books say."""
        return self.books.closed
