"""The door to the stack under test: what fails behind it is the stack's failure, not ours.

Everything that a layer of a user may fail in is called through :class:`StackCalls`. An exception
that is no :class:`~mrta_falsify.core.errors.InputError` becomes a
:class:`~mrta_falsify.core.stack_failure.StackFailed`; so does an answer that no robot can
carry out.
"""

from __future__ import annotations

import itertools
import math
import operator
import re
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.durable import place_error_in
from mrta_falsify.core.errors import InputError, PlaceError
from mrta_falsify.core.fleet import Command, FleetState, Intent, StackEvent
from mrta_falsify.core.interruption import is_interruption
from mrta_falsify.core.protocols import FleetStack
from mrta_falsify.core.stack_failure import StackFailed, StackFailure
from mrta_falsify.core.world import World
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.watch import current_watch
from simulator_interface.external.layers import LayerFailed
from simulator_interface.failing_layer import layer_of_places, places_in, texts_of

T = TypeVar("T")

ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")  # of an object, which differs from run to run
MAX_TEXT = 500  # characters of an exception's message that are kept

#: what a stack answers to a tick
Answer = tuple[Any, Command, Intent, tuple[StackEvent, ...]]

#: shapes of an intent's arrays behind the axis of robots
INTENT_SHAPES: dict[str, tuple[int, ...]] = {
    "phase": (),
    "goal": (2,),
    "waypoint": (2,),
    "cluster": (),
    "leader": (),
    "slack": (),
    "tasks_left": (),
    "queue": (),
}
NUMBERS = frozenset("fiub")  # kinds of arrays
_intent_arrays = operator.attrgetter(*INTENT_SHAPES)
_shape_of = operator.attrgetter("shape")
_kind_of = operator.attrgetter("dtype.kind")

#: layer that gives a part of the answer; the others are the pipeline's own
LAYER_OF_PART = {
    "command": "controller",
    "cluster": "controller",
    "leader": "controller",
    "slack": "controller",
    "path": "planner",
    "waypoint": "waypoint_generator",
}


class StackCalls:
    """Asks the stack of one episode.

    Args:
        world: of the episode.
        config: the stack under test.
    """

    def __init__(self, world: World, config: StackConfig) -> None:
        self._robots = len(world.robots)
        self._names = tuple(robot.name for robot in world.robots)
        self._tasks = len(world.tasks)
        shapes = [*INTENT_SHAPES.values(), (3,)]
        self._shapes = tuple((self._robots, *shape) for shape in shapes)  # the last: of a command
        self._config = config
        self._tick, self._time = 0, 0.0

    def ask(self, question: Callable[[], T], tick: int, time: float) -> T:
        """Call something of the stack at a tick, at ``time`` [s].

        Raises:
            StackFailed: it raised an exception, or took too much memory.
            InputError: it refused its options or the world.
            PlaceError: it met a full disk.
        """
        self._tick, self._time = tick, time
        here = current_watch()
        here.enter(tick, time)
        try:
            answer = question()
        except (InputError, PlaceError, KeyboardInterrupt):
            raise
        except LayerFailed as failed:
            ending = failed.ending.at(tick, time)
            raise StackFailed(ending.failure(who=failed.layer, layer=failed.layer)) from None
        except BaseException as error:  # SystemExit, too
            if is_interruption(error):
                raise KeyboardInterrupt from error
            if place := place_error_in(error):
                raise place from error  # a full disk is no fault of the stack
            raise StackFailed(self._crash(error)) from error
        finally:
            excess = here.leave()
        if excess > 0.0:
            text = f"took up more than {here.budget.memory:g} GiB of memory"
            raise StackFailed(Ending("memory", text).at(tick, time).failure())
        return answer

    def step(self, stack: FleetStack, state: Any, fleet: FleetState) -> Answer:
        """Let the stack take a tick.

        Raises:
            StackFailed: it failed, or its answer cannot be carried out.
            InputError: as in :meth:`ask`.
        """
        answer = self.ask(partial(stack.step, state, fleet), fleet.tick, fleet.time)
        _, command, intent, events = answer
        self._check_command(command)
        self._check_intent(intent)
        if events:
            self._check_events(events)
        return answer

    # --- what is wrong ----------------------------------------------------------------------

    def _crash(self, error: BaseException) -> StackFailure:
        places = places_in(error.__traceback__)
        return StackFailure(
            kind="crash",
            tick=self._tick,
            time=self._time,
            layer=layer_of_places(places, self._config),
            exception=type(error).__name__,
            message=ADDRESS.sub("0x...", str(error))[:MAX_TEXT],
            frames=texts_of(places),
        )

    def _refuse(self, part: str, message: str) -> StackFailed:
        ending = Ending("answer", message, cause=part).at(self._tick, self._time)
        return StackFailed(ending.failure(layer=LAYER_OF_PART.get(part, "")))

    def _check_command(self, command: Command) -> None:
        twist = np.asarray(getattr(command, "twist", None))
        if twist.shape != self._shapes[-1] or twist.dtype.kind not in NUMBERS:
            self._check_shape("command", twist, (3,))
        if math.isfinite(np.vdot(twist, twist)):
            return
        broken = np.flatnonzero(~np.isfinite(twist).all(axis=1))
        if len(broken):
            robot = self._names[int(broken[0])]
            raise self._refuse("command", f"the command of {robot} is not finite")

    def _check_intent(self, intent: Intent) -> None:
        if not self._has_shapes(intent):
            for name, shape in INTENT_SHAPES.items():
                self._check_shape(name, np.asarray(getattr(intent, name)), shape)
        if len(intent.path) != self._robots or len(intent.waits_for) != self._robots:
            raise self._refuse("path", f"paths or waits are not of {self._robots} robots")
        for name, path in zip(self._names, intent.path, strict=True):
            shape = path.shape if isinstance(path, np.ndarray) else np.shape(path)
            if len(shape) != 2 or shape[1] != 2:
                raise self._refuse("path", f"the path of {name} has shape {shape}, not (L, 2)")

    def _has_shapes(self, intent: Intent) -> bool:
        """Whether all arrays of an intent are as they should be, which is what mostly happens."""
        arrays = _intent_arrays(intent)
        if not all(map(isinstance, arrays, itertools.repeat(np.ndarray))):
            return False
        shapes, kinds = tuple(map(_shape_of, arrays)), set(map(_kind_of, arrays))
        return shapes == self._shapes[:-1] and NUMBERS.issuperset(kinds)

    def _check_shape(self, part: str, value: np.ndarray, shape: tuple[int, ...]) -> None:
        wanted = (self._robots, *shape)
        if value.shape != wanted:
            raise self._refuse(part, f"{part} has shape {value.shape}, not {wanted}")
        if value.dtype.kind not in NUMBERS:
            raise self._refuse(part, f"{part} holds {value.dtype}, not numbers")

    def _check_events(self, events: tuple[StackEvent, ...]) -> None:
        for event in events:
            if not (-1 <= event.robot < self._robots and -1 <= event.task < self._tasks):
                raise self._refuse(
                    "events", f"event {event.kind} names robot {event.robot}, task {event.task}"
                )


class OpenDoor:
    """Asks a stack that says itself how it failed: one in a process of its own."""

    def ask(self, question: Callable[[], T], tick: int, time: float) -> T:
        """Call something at a tick, at ``time`` [s]."""
        del tick, time
        return question()

    def step(self, stack: FleetStack, state: Any, fleet: FleetState) -> Answer:
        """Let the stack take a tick.

        Raises:
            StackFailed: it failed, or its answer cannot be carried out.
        """
        return stack.step(state, fleet)
