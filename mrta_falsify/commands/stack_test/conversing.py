"""Checks of a stack that talk to its process, message by message."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from mrta_falsify.commands.stack_test.episodes import Failed
from mrta_falsify.core import registry
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.fleet import FleetState
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.world import World
from simulator_interface.external.answers import Reader, Ready, Wrong
from simulator_interface.external.messages import Message, tick_message, world_message
from simulator_interface.external.process import StackProcess
from simulator_interface.external.services import Services
from simulator_interface.external.wire import Closed, Late, LateByWallClock, Unreadable

TICKS = 5
ENDS_WITHIN = 2.0  # s
RAYS = 12


class Messages:
    """Talks to a stack's process in a world in which nothing moves."""

    def __init__(self, config: StackConfig, world: World) -> None:
        assert config.stack is not None
        self._limit = config.stack.start_limit
        self._world = world
        costmaps = registry.build("costmap", config.costmap).bind(world)
        self._services = Services(world, config, costmaps)
        self._opening = world_message(
            world, 1.0 / config.control_rate, costmaps.costmap(0.0, NO_POINTS), config.stack.params
        )
        self.process = StackProcess(config.stack)

    def open(self, **more: Any) -> None:
        """Tell the world, with further fields."""
        heard = self._ask({**self._opening, **more})
        if heard["type"] != "ready":
            raise Failed(f"`world` was answered by {heard['type']!r}")

    def tick(self, number: int, **more: Any) -> Message:
        """Ask a tick in which all robots stand, with further fields."""
        robots, people = self._world.robots, self._world.humans
        fleet = FleetState(
            tick=number,
            time=0.1 * number,
            pose=np.array([robot.pose for robot in robots]),
            velocity=np.zeros((len(robots), 3)),
            human_position=np.array([human.route[0] for human in people]).reshape(-1, 2),
            human_velocity=np.zeros((len(people), 2)),
            human_radius=np.array([human.radius for human in people]),
            obstacle_points=np.full((len(robots), RAYS, 2), np.inf),
            parked_for=np.full(len(robots), 0.1 * number),
        )
        return self._ask({**tick_message(fleet, (), (), None, closed=False), **more})

    def _ask(self, message: Message) -> Message:
        wire = self.process.wire
        wire.allow(self._limit)
        wire.send(message)
        while True:
            heard = wire.receive()
            if heard["type"] not in self._services.known:
                return heard
            wire.send(self._services.answer(heard, 0.0))


@contextmanager
def talking(config: StackConfig, world: World) -> Iterator[Messages]:
    """Start a stack and end it."""
    talk = Messages(config, world)
    try:
        yield talk
    except (Closed, Late, LateByWallClock, Unreadable, Wrong) as error:
        code, lines = talk.process.last_words()
        said = f"; it printed last: {lines[-1]}" if lines else ""
        how = f"exit code {code}" if code is not None else str(error) or type(error).__name__
        raise Failed(f"it stopped answering ({how}){said}") from None
    finally:
        talk.process.close()


def handshake(config: StackConfig, world: World) -> tuple[Ready, str]:
    """Start a stack up to its first tick; who it is, and how long that took.

    Raises:
        InputError: it cannot be started, does not shake hands, or refuses the world.
    """
    began = time.perf_counter()
    talk = Messages(config, world)
    try:
        with talk.process.starting():
            talk.open()
        took = time.perf_counter() - began
        return talk.process.ready, f"ready for the first tick after {took:.2f} s"
    finally:
        talk.process.close()


def ignores_new_fields(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Tell it fields of a later version of the protocol."""
    del can
    robots = tuple(robot.name for robot in world.robots)
    with talking(config, world) as talk:
        talk.open(of_a_later_version={"a": [1, 2.5, None]})
        for number in range(TICKS):
            heard = talk.tick(number, of_a_later_version=[b"bytes", "text"])
            Reader(robots, len(world.tasks)).read(heard, number, 0.1 * number)
    return f"in `world` and {TICKS} ticks"


def ends_on_bye(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Say bye; it must end by itself."""
    del can
    with talking(config, world) as talk:
        talk.open()
        talk.tick(0)
        talk.process.wire.say_bye()
        return _ends(talk, "bye")


def ends_with_the_connection(config: StackConfig, world: World, can: tuple[str, ...]) -> str:
    """Close the connection without a word; it must end by itself."""
    del can
    with talking(config, world) as talk:
        talk.open()
        talk.tick(0)
        talk.process.wire.close()
        return _ends(talk, "the end of the connection")


def _ends(talk: Messages, after: str) -> str:
    if not talk.process.is_kept:
        return "not looked at: it runs already and is to run on"
    began = time.monotonic()
    while time.monotonic() - began < ENDS_WITHIN:
        code, _ = talk.process.last_words()
        if code is not None:
            return f"with exit code {code}"
    raise Failed(f"it still runs {ENDS_WITHIN:g} s after {after}")
