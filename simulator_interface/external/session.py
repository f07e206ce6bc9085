"""The conversation with a stack's process over one episode: questions, failures, copies."""

from __future__ import annotations

import contextlib
import functools
import math
import signal
from collections.abc import Callable
from typing import Any, Protocol

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.stack_failure import (
    GIB,
    DeterminismCheck,
    StackFailed,
)
from mrta_falsify.process.child import send
from mrta_falsify.process.ending import Ending
from mrta_falsify.process.supervisor import run_supervised
from mrta_falsify.process.watch import current_watch
from simulator_interface.external.answers import Ready, shown
from simulator_interface.external.branching import CannotBranch, MessageLog, connect_branch
from simulator_interface.external.messages import Message
from simulator_interface.external.process import NO_ANSWER, Heavy, StackProcess, why_no_answer
from simulator_interface.external.second_run import (
    Exchange,
    no_further,
    other_answer,
    run_again,
)
from simulator_interface.external.services import Services
from simulator_interface.external.transcript import Transcript, TranscriptRecorder
from simulator_interface.external.wire import Closed, Late, Unreadable, Wire

MAX_QUESTIONS = 100_000  # in one tick; a fleet of 100 may ask 1000 for each robot
#: messages of a run on disc, in memory that the stack may have; a second telling needs them
MAX_EXCHANGED = 4.0
#: ticks that a fresh process is told where forks are asked as well. A fork has the same random
#: numbers ahead of it, so an unseeded generator only shows in a fresh process, and there at once.
FRESH_TICKS = 200


class StackSession(Protocol):
    """Where the answers of a stack come from."""

    ready: Ready

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """Ask a tick; give the answer, and the bytes of it.

        Raises:
            StackFailed: there is none.
        """

    def failed(self, ending: Ending) -> StackFailed:
        """Say that the stack failed at a tick."""

    def note_kept(self, size: int) -> None:
        """Count bytes that the harness keeps of the last answer as memory of the stack."""

    def transcript(self) -> Transcript:
        """Give all that the stack has said; nothing may be asked afterwards."""

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """Keep what was seen in a copy of the run."""

    def ask_copy(self, ask: Callable[[], object]) -> Callable[[], DeterminismCheck | None]:
        """Ask a fork of the stack a tick that the stack has not been asked yet.

        Args:
            ask: asks it.

        Returns:
            What compares the answers once the stack has given its own; None: no fork answers.
        """

    def ask_fresh(self) -> DeterminismCheck:
        """Tell a fresh process all that was said, and compare its answers."""

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


class LiveSession:
    """With a process of its own; see :class:`StackSession`.

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
        self._names = [robot["name"] for robot in world["robots"]]
        self._branch_pid = 0  # of the copy of the stack that this copy talks to
        self._last = b""  # answer to a tick
        self._forks_compared = 0
        self._kept = 0  # bytes that the harness keeps of the answers
        self._process: StackProcess | None = StackProcess(options)
        self._wire: Wire = self._process.wire
        self.ready = self._process.ready
        self._exchanges = MessageLog(are_kept=self._may_replay())
        self._recorder = TranscriptRecorder(self.ready)
        try:
            with self._process.starting():
                heard = self._exchange(world, 0.0, options.start_limit)[0]
                if heard["type"] != "ready":
                    raise Unreadable(f"`world` was answered by {shown(heard['type'])}")
        except BaseException:
            self.close()
            raise

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """See :class:`StackSession`."""
        limit = self._options.tick_limit
        try:
            heard, body = self._exchange(message, time, limit)
            if self._process is not None:
                self._process.kept = self._kept + self._recorder.size
                self._process.note_answer()
        except NO_ANSWER as error:
            raise self.failed(why_no_answer(error, limit, self._process).at(tick, time)) from None
        self._recorder.add(body)
        self._last = body
        return heard, body

    def failed(self, ending: Ending) -> StackFailed:
        """See :class:`StackSession`."""
        if self._branch_pid and ending.kind == "hang":
            self._exchanges.note_forking_failed()
            send(self._branch_pid, signal.SIGKILL)
        if ending.lines is None and self._process is not None:
            ending.lines = self._process.printed()
        failure = ending.failure()
        self._recorder.failure = failure
        return StackFailed(failure)

    def note_kept(self, size: int) -> None:
        """See :class:`StackSession`."""
        self._kept += size

    def transcript(self) -> Transcript:
        """See :class:`StackSession`."""
        return self._recorder.finish()

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """See :class:`StackSession`."""
        self._recorder.forecasts.append(answer)

    def close(self) -> None:
        """See :class:`StackSession`; may be called twice."""
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
            limit: time that the stack has, with all that it asks [s].
        """
        self._wire.allow(limit)
        said = self._wire.send(message)
        for _ in range(MAX_QUESTIONS):
            body = self._wire.receive_bytes()
            self._exchanges.add(said, body)
            most = current_watch().budget.memory * MAX_EXCHANGED
            if self._exchanges.size > most * GIB:
                raise Heavy(f"has made the harness keep messages of more than {most:g} GiB")
            heard = self._wire.read(body)
            if heard["type"] not in self._services.known:
                return heard, body
            said = self._wire.send(self._services.answer(heard, time))
        raise Unreadable(f"`{message['type']}` was answered by {MAX_QUESTIONS} questions")

    # --- copies -------------------------------------------------------------------------------

    @property
    def can_branch(self) -> bool:
        """See :class:`StackSession`."""
        return self._may_fork() or self._may_replay()

    def branch(self) -> None:
        """See :class:`StackSession`; by fork if the stack can, else by telling a fresh one all.

        Raises:
            CannotBranch: it can do neither, or does not answer the same.
        """
        self._exchanges.become_copy()
        if self._fork():
            return
        if not self._may_replay():
            raise CannotBranch("the stack cannot be copied")
        self._replay()

    def _fork(self) -> bool:
        """Go on with a fork of the stack; False: there is none."""
        if not self._may_fork():
            return False
        try:
            link, self._branch_pid = connect_branch(
                self._wire, self._options.tick_limit, is_kept=bool(self._options.command)
            )
        except (Closed, Late, Unreadable, OSError):
            self._exchanges.note_forking_failed()
            return False
        self._let_go()
        self._wire = link
        self._wire.is_binary = self.ready.encoding == "msgpack"
        return True

    def _may_fork(self) -> bool:
        is_able = "branch" in self.ready.can and not self._exchanges.forking_failed
        return is_able and self._is_stepped() and self._options.branch in ("auto", "fork")

    def _may_replay(self) -> bool:
        return self._options.branch in ("auto", "replay") and self._is_stepped()

    def _is_stepped(self) -> bool:
        """Whether its answers can be had again; a copy of it would answer otherwise."""
        return self.ready.coupling == "stepped"

    def _replay(self) -> None:
        """Say everything again to a fresh process; it must answer the same."""
        self._let_go()
        self._process = self._fresh_process()
        self._wire = self._process.wire
        other = self._run_again(self._process).difference
        if other is not None:
            of = f" of {other.robot}" if other.robot else ""
            raise CannotBranch(
                f"the stack answers otherwise at tick {other.tick}: {other.field}{of}"
            )

    def _fresh_process(self) -> StackProcess:
        try:
            return StackProcess(self._options)
        except ConfigError as error:
            raise no_further(error) from None

    def _run_again(self, process: StackProcess, most_ticks: float = math.inf) -> DeterminismCheck:
        limits = (self._options.start_limit, self._options.tick_limit)
        return run_again(
            process.wire, self._exchanges, self._names, limits=limits, most_ticks=most_ticks
        )

    # --- asked again --------------------------------------------------------------------------

    def ask_copy(self, ask: Callable[[], object]) -> Callable[[], DeterminismCheck | None]:
        """See :class:`StackSession`."""
        again = None
        if self._may_fork() and not self._exchanges.is_copy:
            with contextlib.suppress(Ending, StackFailed, CannotBranch):
                again = run_supervised(functools.partial(self._ask_fork, ask))
        return functools.partial(self._compared, again)

    def _ask_fork(self, ask: Callable[[], object]) -> bytes:
        self._exchanges.become_copy()
        if not self._fork():
            raise CannotBranch("the stack cannot be forked")
        ask()
        return self._last

    def _compared(self, again: bytes | None) -> DeterminismCheck | None:
        """Compare the answer to the last tick with that of a fork."""
        found = None
        if again is not None:
            self._forks_compared += 1
            first, other = (self._wire.read(body) for body in (self._last, again))
            found = DeterminismCheck(
                difference=other_answer(Exchange({}, first, other), self._names)
            )
        self._recorder.again.append(found)
        return found

    def ask_fresh(self) -> DeterminismCheck:
        """See :class:`StackSession`; only the first ticks where forks have been asked as well."""
        try:
            found = self._ask_fresh()
        except CannotBranch as error:
            found = DeterminismCheck(why_not=str(error))
        self._recorder.again.append(found)
        return found

    def _ask_fresh(self) -> DeterminismCheck:
        if not self._is_stepped():
            raise CannotBranch(
                f"the coupling of the stack is {self.ready.coupling}: "
                "it need not answer the same again"
            )
        if not self._may_replay():
            raise CannotBranch(
                f"the stack is not copied by replay (branch: {self._options.branch})"
            )
        process = self._fresh_process()
        try:
            most = FRESH_TICKS if self._forks_compared else math.inf
            return self._run_again(process, most)
        finally:
            process.close()


class TranscriptSession:
    """Tells again what a stack has said; see :class:`StackSession`.

    Args:
        transcript: what it said.
    """

    can_branch = False

    def __init__(self, transcript: Transcript) -> None:
        self.ready = transcript.ready
        self._transcript = transcript
        self._answers = transcript.answers()
        self._again = iter(transcript.again)

    def ask(self, message: Message, tick: int, time: float) -> tuple[Message, bytes]:
        """See :class:`StackSession`."""
        del message
        failure = self._transcript.failure
        if failure is not None and tick >= failure.tick:
            raise StackFailed(failure)
        body = next(self._answers, None)
        if body is None:
            text = "the stored answers end here"
            raise self.failed(Ending("answer", text, cause="message").at(tick, time))
        return Wire.decoded(body, is_binary=self.ready.encoding == "msgpack"), body

    def failed(self, ending: Ending) -> StackFailed:
        """See :class:`StackSession`."""
        return StackFailed(ending.failure())

    def note_kept(self, size: int) -> None:
        """See :class:`StackSession`; the size was counted when the stack answered."""

    def transcript(self) -> Transcript:
        """See :class:`StackSession`."""
        return self._transcript

    def note_forecast(self, answer: dict[str, Any] | None) -> None:
        """See :class:`StackSession`; the transcript has it already."""

    def ask_copy(self, ask: Callable[[], object]) -> Callable[[], DeterminismCheck | None]:
        """See :class:`StackSession`; the result of the first run is stored."""
        del ask
        return lambda: next(self._again, None)

    def ask_fresh(self) -> DeterminismCheck:
        """See :class:`StackSession`; the result of the first run is stored."""
        return next(self._again, None) or DeterminismCheck(why_not="no second answers are stored")

    def branch(self) -> None:
        """See :class:`StackSession`; no stack runs, so none can be copied."""
        raise CannotBranch("stored answers go no further")

    def close(self) -> None:
        """Nothing has to be ended."""
