"""The conversation with a stack's process over one episode: questions, failures, copies."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Sequence
from time import monotonic
from typing import Any, Protocol

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.stack_failure import GIB, FailureKind, StackFailed, StackFailure
from simulator_interface.external.answers import Ready, Wrong, shown
from simulator_interface.external.branching import CannotBranch, Exchanges, connect_branch
from simulator_interface.external.messages import Message
from simulator_interface.external.process import StackProcess
from simulator_interface.external.services import Services
from simulator_interface.external.told import Told, ToldRecorder
from simulator_interface.external.wire import Closed, Late, Unreadable, Wire
from simulator_interface.heartbeat import post

MOST_QUESTIONS = 100_000  # in one tick; a fleet of 100 may ask 1000 for each robot
WEIGHED_EVERY = 20  # ticks between two looks at the memory of a stack


class Talk(Protocol):
    """Where the answers of a stack come from."""

    ready: Ready

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """Ask a tick; give the answer, and the bytes of it.

        Raises:
            StackFailed: there is none.
        """

    def failed(
        self, kind: FailureKind, text: str, tick: int, time: float, part: str
    ) -> StackFailed:
        """Say that the stack failed; ``part`` names a field, an exit code, a signal."""

    def told(self) -> Told:
        """Give all that the stack has said; nothing may be asked afterwards."""

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """Keep what was seen in a copy of the run."""

    @property
    def can_branch(self) -> bool:
        """Whether a copy of the run can go on with a copy of the stack."""

    def branch(self) -> None:
        """Go on with a copy of the stack; called in a copy of the run.

        Raises:
            CannotBranch: there is none to be had.
        """

    def close(self) -> None:
        """End it."""


class Conversation:
    """With a process of its own; see :class:`Talk`.

    Args:
        options: of the stack.
        world: message that tells it the world.
        services: answer its questions.

    Raises:
        ConfigError: the process cannot be started, does not shake hands, or refuses the world.
    """

    def __init__(self, options: ExternalStack, world: Message, services: Services) -> None:
        self._options = options
        self._services = services
        self._branch_pid = 0  # of the copy of the stack that this copy talks to
        self._process: StackProcess | None = StackProcess(options)
        self._exchanges = Exchanges(are_kept=self._may_replay())
        self._wire: Wire = self._process.wire
        self.ready = self._process.ready
        self._recorder = ToldRecorder(self.ready)
        try:
            with self._process.starting():
                heard = self._exchange(world, 0.0, options.start_limit)[0]
                if heard["type"] != "ready":
                    raise Unreadable(f"`world` was answered by {shown(heard['type'])}")
        except BaseException:
            self.close()
            raise

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """See :class:`Talk`."""
        limit = self._options.tick_limit
        try:
            heard, body = self._exchange(message, time, limit)
        except Closed:
            raise self._died(tick, time) from None
        except Late:
            text = f"the stack did not answer within {limit:g} s"
            raise self.failed("hang", text, tick, time) from None
        except Unreadable as error:
            raise self.failed("answer", str(error), tick, time, "message") from None
        except Wrong as wrong:
            raise self.failed("answer", str(wrong), tick, time, wrong.field) from None
        if tick % WEIGHED_EVERY == 0:
            self._weigh(tick, time)
        self._recorder.add(body)
        return heard, body

    def _weigh(self, tick: int, time: float) -> None:
        most = post().limits.memory
        if self._process is not None and self._process.resident() > most * GIB:
            text = f"the stack took up more than {most:g} GiB of memory"
            raise self.failed("memory", text, tick, time)

    def failed(
        self,
        kind: FailureKind,
        text: str,
        tick: int,
        time: float,
        part: str = "",
        lines: Sequence[str] | None = None,
    ) -> StackFailed:
        """See :class:`Talk`; ``lines`` are the last that it printed, None: to be asked for."""
        if self._branch_pid and kind == "hang":
            self._exchanges.note_forking_failed()
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._branch_pid, signal.SIGKILL)
        if lines is None:
            lines = self._process.printed() if self._process is not None else ()
        failure = StackFailure(
            kind=kind, tick=tick, time=time, exception=part, message=text, frames=tuple(lines)
        )
        self._recorder.failure = failure
        return StackFailed(failure)

    def told(self) -> Told:
        """See :class:`Talk`."""
        return self._recorder.finish()

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """See :class:`Talk`."""
        self._recorder.forecasts.append(answer)

    def close(self) -> None:
        """See :class:`Talk`; may be called twice."""
        self._let_go()
        self._exchanges.close()

    def _let_go(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None

    def _exchange(self, message: Message, time: float, limit: float) -> tuple[Message, bytes]:
        """Send a message, answer the stack's questions, and give its answer.

        Args:
            message: `world` or `tick`.
            time: simulated [s].
            limit: wall-clock time that the stack has, with all that it asks [s].
        """
        said = self._wire.send(message, limit)
        for _ in range(MOST_QUESTIONS):
            began = monotonic()
            body = self._wire.receive_bytes(limit)
            limit -= monotonic() - began
            self._exchanges.add(said, body)
            heard = self._wire.read(body)
            if heard["type"] not in self._services.known:
                return heard, body
            said = self._wire.send(self._services.answer(heard, time), limit)
        raise Unreadable(f"`{message['type']}` was answered by {MOST_QUESTIONS} questions")

    def _died(self, tick: int, time: float) -> StackFailed:
        code, lines = (None, ()) if self._process is None else self._process.last_words()
        if code is None:
            text = "the stack closed the connection"
            return self.failed("crash", text, tick, time, "closed", lines)
        how = _signal_name(-code) if code < 0 else f"exit code {code}"
        return self.failed("crash", f"the stack ended by {how}", tick, time, how, lines)

    # --- copies -------------------------------------------------------------------------------

    @property
    def can_branch(self) -> bool:
        """See :class:`Talk`."""
        return self._may_fork() or self._may_replay()

    def branch(self) -> None:
        """See :class:`Talk`; by fork if the stack can, else by telling a fresh one everything.

        Raises:
            CannotBranch: it can do neither, or does not answer the same.
        """
        self._exchanges.become_copy()
        if self._may_fork():
            try:
                link, self._branch_pid = connect_branch(self._wire, self._options.tick_limit)
            except (Closed, Late, Unreadable, OSError):
                self._exchanges.note_forking_failed()
            else:
                self._let_go()
                self._wire = link
                self._wire.is_binary = self.ready.encoding == "msgpack"
                return
        if not self._may_replay():
            raise CannotBranch("the stack cannot be copied")
        self._replay()

    def _may_fork(self) -> bool:
        is_able = "branch" in self.ready.can and not self._exchanges.forking_failed
        return is_able and self._options.branch in ("auto", "fork")

    def _may_replay(self) -> bool:
        return self._options.branch in ("auto", "replay")

    def _replay(self) -> None:
        """Say everything again to a fresh process; it must answer the same."""
        self._let_go()
        try:
            self._process = StackProcess(self._options)
            self._say_again(self._process.wire)
        except (Closed, Late, Unreadable, ConfigError) as error:
            text = (
                f"a fresh process of the stack does not go on: {str(error) or type(error).__name__}"
            )
            raise CannotBranch(text) from None
        self._wire = self._process.wire

    def _say_again(self, wire: Wire) -> None:
        limit = self._options.start_limit
        for number, (said, heard) in enumerate(self._exchanges.all()):
            wire.send_bytes(said, limit)
            if wire.receive_bytes(limit) != heard:
                raise CannotBranch(f"the stack gives another answer to message {number}")
            limit = self._options.tick_limit


def _signal_name(number: int) -> str:
    known = {known.value: known.name for known in signal.Signals}
    return known.get(number, f"signal {number}")  # real-time signals have no name


class ToldTalk:
    """Tells again what a stack has said; see :class:`Talk`.

    Args:
        told: what it said.
    """

    can_branch = False

    def __init__(self, told: Told) -> None:
        self.ready = told.ready
        self._told = told
        self._answers = told.answers()

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """See :class:`Talk`."""
        del message
        failure = self._told.failure
        if failure is not None and tick >= failure.tick:
            raise StackFailed(failure)
        body = next(self._answers, None)
        if body is None:
            text = "the stored answers end here"
            raise self.failed("answer", text, tick, time, "message")
        return Wire.decoded(body, is_binary=self.ready.encoding == "msgpack"), body

    def failed(
        self, kind: FailureKind, text: str, tick: int, time: float, part: str = ""
    ) -> StackFailed:
        """See :class:`Talk`."""
        return StackFailed(
            StackFailure(kind=kind, tick=tick, time=time, exception=part, message=text)
        )

    def told(self) -> Told:
        """See :class:`Talk`."""
        return self._told

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """See :class:`Talk`; it is known."""

    def branch(self) -> None:
        """See :class:`Talk`; there is no stack to be copied."""
        raise CannotBranch("stored answers go no further")

    def close(self) -> None:
        """Nothing has to be ended."""
