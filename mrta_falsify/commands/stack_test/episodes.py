"""Checks of a stack that run episodes, and the time that its ticks take."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any, cast

import numpy as np

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.difference import first_difference
from mrta_falsify.core.external import Branching
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.process.supervisor import run_supervised
from simulator_interface.episode import Episode
from simulator_interface.external.branching import CannotBranch
from simulator_interface.external.messages import Message
from simulator_interface.external.session import StackSession
from simulator_interface.simulate import Outcome, simulate

SECONDS = 20.0  # s of the runs that are compared
BEFORE, AFTER = 5.0, 5.0  # s of a run until a copy is made, and of the copy
TIMED_TICKS = 400
WARM_TICKS = 20  # that are not timed


class Failed(Exception):  # noqa: N818 - says what was found
    """A check failed; the text says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TickTime:
    """How long it takes to ask a stack a tick, with all that it thinks."""

    robots: int
    p50_us: float
    p95_us: float
    message_bytes: int  #: of its answers, the median


def answers_each_tick(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Run the stack; each answer must be as the protocol says."""
    del can
    outcome = _run(config, world)
    for verdict in outcome.verdicts:
        if verdict.violated:
            at = f"tick {verdict.evidence['tick']}"
            raise Failed(f"{verdict.evidence['kind']} at {at}: {verdict.evidence['message']}")
    return f"{len(outcome.trace)} ticks with {len(world.robots)} robots"


def answers_the_same(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Run the stack twice; its answers must be equal byte for byte."""
    del can
    one, other = _run(config, world), _run(config, world)
    assert one.transcript is not None
    assert other.transcript is not None
    for tick, (first, again) in enumerate(
        zip(one.transcript.answers(), other.transcript.answers(), strict=False)
    ):
        if first != again:
            difference = first_difference(one.trace, other.trace)
            where = str(difference) if difference is not None else f"at tick {tick}"
            raise Failed(f"its answers differ from tick {tick} on; the run differs {where}")
    if one.trace.digest != other.trace.digest:
        raise Failed("its answers end at different ticks")
    return f"{len(one.trace)} answers in two runs, byte for byte"


def goes_on_by_fork(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Let a copy of the run go on with a fork of the stack."""
    return _goes_on(config, world, "fork") if "branch" in can else ""


def goes_on_by_replay(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Let a copy of the run go on with a fresh process that was told everything."""
    del can
    return _goes_on(config, world, "replay")


def time_of_ticks(config: StackConfig, world: World) -> TickTime:
    """Measure the time that it takes to ask a tick, on one core.

    Harness and stack take turns, so they need no more. A process that wakes up on another core
    takes up to 0.1 ms longer, which tells about the machine.
    """
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # the stack's process, too: it is started below
    try:
        return _timed(config, world)
    finally:
        os.sched_setaffinity(0, cores)


def _timed(config: StackConfig, world: World) -> TickTime:
    episode = Episode(world, config)
    assert episode.outside is not None
    clock = _Clock(episode.outside.talk)
    episode.outside.talk = cast(StackSession, clock)
    frames = episode.frames()
    try:
        for _ in range(WARM_TICKS + TIMED_TICKS):
            next(frames)
    finally:
        frames.close()
    p50, p95 = np.percentile(clock.spent[WARM_TICKS:], [50.0, 95.0]) * 1e6
    return TickTime(
        robots=len(world.robots),
        p50_us=round(float(p50), 1),
        p95_us=round(float(p95), 1),
        message_bytes=int(np.median(clock.sizes)),
    )


class _Clock:
    """Times how long it takes to ask, and passes all else on."""

    def __init__(self, talk: StackSession) -> None:
        self._talk = talk
        self.spent: list[float] = []  #: s
        self.sizes: list[int] = []  #: of the answers [bytes]

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        began = perf_counter()
        answer = self._talk.ask(message, tick, time)
        self.spent.append(perf_counter() - began)
        self.sizes.append(len(answer[1]))
        return answer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._talk, name)


def _run(config: StackConfig, world: World) -> Outcome:
    return simulate(dataclasses.replace(world, horizon=SECONDS), config)


def _goes_on(config: StackConfig, world: World, branch: Branching) -> str:
    """Compare a copy of the run with the run itself, some seconds after they part."""
    assert config.stack is not None
    config = dataclasses.replace(config, stack=dataclasses.replace(config.stack, branch=branch))
    episode = Episode(world, config)
    frames = episode.frames()

    def further() -> str:
        _advance(frames, BEFORE + AFTER)
        return str(episode.state.digest())

    def apart() -> str:
        try:
            episode.become_copy()
        except CannotBranch as error:
            return f"!{error}"
        return further()

    try:
        _advance(frames, BEFORE)
        began = perf_counter()
        copied = run_supervised(apart)
        took = perf_counter() - began
        original = further()
    finally:
        frames.close()
    if copied.startswith("!"):
        raise Failed(copied.removeprefix("!"))
    if copied != original:
        raise Failed(f"a copy at {BEFORE:g} s answers otherwise within {AFTER:g} s")
    return f"the same answers {AFTER:g} s later; {took:.2f} s with the copy's run"


def _advance(frames: Iterator[Frame], until: float) -> None:
    for frame in frames:
        if frame.sensed.time >= until - 1e-6:
            return
