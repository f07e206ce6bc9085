"""The guard: runs that survive whatever the stack under test does.

Inside ``with guarded():`` each episode runs in a fork of this process
(:mod:`mrta_falsify.process.supervisor`). A stack that hangs, ends the process or takes too much
memory costs the fork. If it does so in two runs, a third ends at that tick with the verdict: the
trace and the other verdicts are as if the stack had raised an exception there. What happens in one
of two runs is an error of no known cause.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.stack_failure import StackFailure, StackLimits
from mrta_falsify.process.budget import Budget
from mrta_falsify.process.child import can_fork
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import Request, Supervisor
from mrta_falsify.process.watch import current_watch
from simulator_interface import stack_calls
from simulator_interface.failing_layer import (
    dumped_places,
    layer_of_places,
    shared_places,
    texts_of,
)
from simulator_interface.warm_up import warm_up

T = TypeVar("T")

DOOR = stack_calls.__file__  #: what calls the stack, whose own frames are not told
MAX_RUNS = 6  # of one episode: a stack that fails at another tick each time


class Guard:
    """Runs episodes in a copy of this process; the copy is kept from one to the next.

    Args:
        on_lost: called after a run in which the stack brought the copy down, before the next one.
    """

    def __init__(self, on_lost: Callable[[], None] = lambda: None) -> None:
        self._on_lost = on_lost
        self._copy: Supervisor | None = None
        self._limits: StackLimits | None = None

    def run(
        self,
        call: Callable[[], T],
        *,
        config: StackConfig,
        limits: StackLimits,
        portable: bool,
        on_time: Callable[[float], None] = lambda time: None,
    ) -> T:
        """Run one episode.

        Args:
            call: runs it; a function of a module with values that can be pickled, if portable.
            config: the stack under test.
            limits: of the stack.
            portable: whether ``call`` and what it needs can be sent to another process.
            on_time: called with the simulated time [s] as it goes on.

        Raises:
            HarnessError: the stack failed in one of two runs only, or the toolkit did.
            Exception: what ``call`` raised.
        """
        if not portable or limits != self._limits:
            self.close()
        if config.stack is None:
            warm_up()
        self._limits = limits
        seen: list[Ending] = []
        ending: StackFailure | None = None
        while len(seen) < MAX_RUNS:
            try:
                answer: T = self._ask(Request(call, ending, True), limits, on_time)
            except Ending as ending_seen:
                self._on_lost()
                seen.append(ending_seen)
                if len(seen) > 1:
                    ending = _failure(seen, config)
                continue
            if len(seen) == 1 and not self._says_so_itself(seen[0]):
                raise HarnessError(f"{_what(seen[0])}; in a second run it did not happen again")
            return answer
        raise HarnessError(f"{_what(seen[-1])}; it failed elsewhere in {len(seen)} runs")

    def __del__(self) -> None:
        """End the copy with the last one who could use it."""
        self.close()

    def close(self) -> None:
        """End the copy; the next run makes another."""
        if self._copy is not None:
            self._copy.close()
            self._copy = None

    def _says_so_itself(self, seen: Ending) -> bool:
        """Whether the run that was answered last has measured what one before was ended for.

        Memory is measured within a call of the stack from outside, and after it by the run.
        """
        return seen.kind == "memory" and self._copy is not None and self._copy.is_too_large

    def _ask(self, request: Request, limits: StackLimits, on_time: Callable[[float], None]) -> Any:
        copy, self._copy = self._copy or Supervisor(Budget.of_stack(limits)), None
        is_sound = False
        try:
            if not copy.ask(request):
                copy.close()
                copy = Supervisor(Budget.of_stack(limits))
                copy.ask(request)
            answer = copy.answer(on_time)
            is_sound = True
        except Exception as error:
            is_sound = not isinstance(error, Ending | HarnessError)
            raise
        finally:
            if is_sound:
                self._copy = copy
            else:  # it failed, or Ctrl-C
                copy.close()
        return answer


def _what(ending: Ending) -> str:
    return f"{ending} at tick {ending.tick} ({ending.time:.2f} s)"


def _failure(seen: list[Ending], config: StackConfig) -> StackFailure:
    """Say how the stack fails, from all runs in which it did: at the earliest tick."""
    first = min(seen, key=lambda ending: ending.tick)
    alike = [dumped_places(one.where, DOOR) for one in seen if one.tick == first.tick]
    places = functools.reduce(shared_places, alike[1:], alike[0])
    return first.failure(layer=layer_of_places(places, config), frames=texts_of(places))


# --- who is guarded ------------------------------------------------------------------------

_guards: list[Guard | None] = [None]  # the last one counts


def current_guard() -> Guard | None:
    """Give the guard of this process, None: episodes run in this process itself."""
    is_watched = current_watch().heartbeat is not None  # then the guard is outside
    return None if is_watched else _guards[-1]


@contextmanager
def guarded(guard: Guard | None = None) -> Iterator[None]:
    """Guard all episodes that are run inside; within another guard, by that one.

    Args:
        guard: whose copy is used and kept; by default one that ends with this block.
    """
    if not can_fork() or _guards[-1] is not None or current_watch().heartbeat is not None:
        yield
        return
    own = guard or Guard()
    _guards.append(own)
    try:
        yield
    finally:
        _guards.pop()
        if guard is None:
            own.close()
