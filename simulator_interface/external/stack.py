"""A foreign stack takes the place of the shipped one in an episode.

It gets one message a tick and answers it. What it says is checked and turned into what the shipped
stack would give. All answers are kept, so that the run can be told again without it.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import (
    Command,
    FleetState,
    Intent,
    Phase,
    StackEvent,
    Tells,
    no_intent,
)
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.protocols import CostmapSource
from mrta_falsify.core.world import LINKS, World
from mrta_falsify.process.ending import Ending
from mrta_falsify.specs.books import STOP_KINDS, Books
from mrta_falsify.stack.comms import LinkTimetable
from mrta_falsify.stack.following import Following
from simulator_interface.external.answers import Answer, Reader, Wrong
from simulator_interface.external.messages import (
    Message,
    task_message,
    tick_message,
    world_message,
)
from simulator_interface.external.orders import ROUNDING, StandingOrders, carry_out, no_orders, take
from simulator_interface.external.services import Services
from simulator_interface.external.session import LiveSession, StackSession, TranscriptSession
from simulator_interface.external.transcript import Transcript

#: bytes that a point of a path costs: twice as numbers, once as text while a trace is written
POINT = 256
ROW = 512  # bytes that an event or a wait costs, beside its text


@dataclass(slots=True)
class ProcessState:
    """What the harness remembers of a stack that is asked over a socket."""

    intent: Intent  #: as last said
    orders: StandingOrders
    told: int = 0  #: tasks that it knows, in the order of their arrival
    closed: bool = False  #: no task is told any more
    epoch: int = -1  #: of the links that it knows
    claimed: tuple[StackEvent, ...] = ()  #: stops, in the last tick
    said: bytes = b""  #: sha256 of all answers to date

    def digest(self) -> str:
        """Hash all that the stack has answered to date."""
        return self.said.hex()


class ProcessStack:
    """The stack of an episode, in a process of its own.

    Args:
        world: it works in.
        config: with ``stack``; its planner and costmap answer the stack's questions.
        costmaps: of the building.
        books: of the episode; they say which claims count.
        transcript: answers of an earlier run that take the stack's place; None: it is asked.

    Raises:
        ConfigError: the process cannot be started or does not shake hands.
    """

    def __init__(
        self,
        world: World,
        config: StackConfig,
        costmaps: CostmapSource,
        books: Books,
        transcript: Transcript | None = None,
    ) -> None:
        assert config.stack is not None
        self._world = world
        self._delay = config.stack.delay
        self._books = books
        self._names = tuple(robot.name for robot in world.robots)
        self._links = LinkTimetable(world)
        self._order = sorted(range(len(world.tasks)), key=lambda k: (world.tasks[k].arrival, k))
        self._reader = Reader(self._names, len(world.tasks))
        self._following = Following(world, config, costmaps)
        self.signals: Mapping[str, float] = {}  #: of the last tick
        self.talk: StackSession
        if transcript is None:
            message = world_message(
                world,
                1.0 / config.control_rate,
                costmaps.costmap(0.0, NO_POINTS),
                {**config.stack.params, **world.stack_params},
                tasks_ahead=config.stack.tasks_ahead,
            )
            self.talk = LiveSession(config.stack, message, Services(world, config, costmaps))
        else:
            self.talk = TranscriptSession(transcript)
        said = self.talk.ready.says
        self.tells = Tells(
            deliveries="deliveries" in said, goals="goals" in said, paths="paths" in said
        )

    # --- what an episode asks -----------------------------------------------------------------

    def start(self) -> ProcessState:
        """Memory at time 0."""
        intent = no_intent(len(self._names))
        return ProcessState(intent=intent, orders=no_orders(intent))

    def forget_after(self, state: ProcessState, time: float) -> None:
        """Tell of no task any more, and of no outage that begins after ``time`` [s]."""
        state.closed = True
        self._links = LinkTimetable(self._world, until=time)
        state.epoch = -1

    def step(
        self, state: ProcessState, fleet: FleetState
    ) -> tuple[ProcessState, Command, Intent, tuple[StackEvent, ...]]:
        """Ask the stack a tick.

        Raises:
            StackFailed: it did not answer, or not as the protocol says.
        """
        message = self._tick_message(state, fleet)
        heard, body = self.talk.ask(message, fleet.tick, fleet.time)
        try:
            answer = self._reader.read(heard, fleet.tick, fleet.time)
            answer = dataclasses.replace(answer, took=answer.took + self._delay)
            before = state.intent
            state.intent = self._intent(state.intent, answer, fleet.time)
            take(state.orders, answer, state.intent, fleet.time, self._names)
        except Wrong as wrong:
            ending = Ending("answer", str(wrong), cause=wrong.field).at(fleet.tick, fleet.time)
            raise self.talk.failed(ending) from None
        state.said = hashlib.sha256(state.said + body).digest()
        self.talk.note_kept(_kept_of(answer, before, state.intent))
        return self._taken(state, answer, fleet)

    @property
    def can_branch(self) -> bool:
        """Whether a copy of the run can have a copy of the stack."""
        return self.talk.can_branch

    def branch(self) -> None:
        """Go on with a copy of the stack; call it in a copy of the run, before anything else.

        Raises:
            CannotBranch: there is none to be had.
        """
        self.talk.branch()

    def close(self) -> None:
        """End the process; may be called twice."""
        self.talk.close()

    # --- a tick ------------------------------------------------------------------------------

    def _tick_message(self, state: ProcessState, fleet: FleetState) -> Message:
        tasks, new = self._world.tasks, []
        while not state.closed and state.told < len(self._order):
            number = self._order[state.told]
            if tasks[number].arrival > fleet.time + ROUNDING:
                break
            new.append(task_message(number, tasks[number]))
            state.told += 1
        links, epoch = None, self._links.epoch_at(fleet.time)
        if epoch != state.epoch:
            state.epoch = epoch
            up = self._links.links(epoch)
            links = {name: getattr(up, name).tolist() for name in LINKS}
        return tick_message(fleet, new, self._refused(state), links, closed=state.closed)

    def _refused(self, state: ProcessState) -> list[Message]:
        """List the claims of the last tick that the books do not bear out."""
        refused = []
        for claim in state.claimed:
            is_pickup = claim.kind == STOP_KINDS[0]
            known = self._books.picked if is_pickup else self._books.delivered
            if claim.task in known and self._books.by.get(claim.task) == claim.robot:
                continue
            why = next(
                (
                    row.reason
                    for row in reversed(self._books.refused.rows)
                    if row.task == claim.task and row.robot == self._names[claim.robot]
                ),
                "it does not count",
            )
            refused.append(
                {"kind": claim.kind, "robot": claim.robot, "task": claim.task, "why": why}
            )
        return refused

    def _taken(
        self, state: ProcessState, answer: Answer, fleet: FleetState
    ) -> tuple[ProcessState, Command, Intent, tuple[StackEvent, ...]]:
        state.claimed = tuple(event for event in answer.events if event.kind in STOP_KINDS)
        self.signals = answer.signals
        links = self._links.links(state.epoch)
        command, intent, driven = carry_out(
            state.orders, self._following, state.intent, fleet, links
        )
        return state, command, intent, (*answer.events, *driven)

    def _intent(self, before: Intent, answer: Answer, time: float) -> Intent:
        """Bring what the stack intends up to date; what it does not say anew stays."""
        said: dict[str, Any] = dict(answer.intent)
        if answer.goal is not None:
            said["goal"] = answer.goal
        if answer.paths:
            said["path"] = tuple(answer.paths.get(i, p) for i, p in enumerate(before.path))
        if answer.waits_for is not None:
            waits = answer.waits_for
            said["waits_for"] = tuple(waits.get(i, "") for i in range(len(self._names)))
        if "phase" not in said:
            said["phase"] = self._phase(said.get("goal", before.goal), time)
        return dataclasses.replace(before, **said)

    def _phase(self, goal: Array, time: float) -> IntArray:
        """Derive what each robot is doing, ``(N,)``, from whether it wants to be anywhere."""
        wants = np.isfinite(goal[:, 0])
        phase = np.where(wants, int(Phase.DRIVING), int(Phase.IDLE))
        phase[[robot.joins_at > time for robot in self._world.robots]] = int(Phase.OFF)
        return phase


def _kept_of(answer: Answer, before: Intent, now: Intent) -> int:
    """Count the bytes that traces and orders keep of an answer for the rest of the run."""
    points = sum(
        len(path)
        for robot, path in answer.paths.items()
        if not np.array_equal(path, before.path[robot])
    )
    rows = len(answer.events)
    text = sum(len(e.kind) + len(e.resource) + len(e.detail) for e in answer.events)
    for new, old in zip(now.waits_for, before.waits_for, strict=False):
        if new != old:
            rows, text = rows + 1, text + len(new)
    return POINT * points + ROW * rows + 2 * text
