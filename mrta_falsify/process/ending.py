"""How a child ended, and how values and exceptions travel between processes."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from mrta_falsify.core.errors import HarnessError
from mrta_falsify.core.stack_failure import FailureKind, StackFailure


class Ending(Exception):  # noqa: N818 - says what became of a child
    """A child gave no answer, or none of use: it ended, or had to be ended.

    Args:
        kind: how.
        text: what it did, in words that follow its name, as in ``gave no answer``; for the kind
            ``answer`` a whole sentence.
        cause: the type of an exception, a signal, an exit code, or the field of an answer.
        lines: the last that it printed; None: they have not been asked for.
        tick: that it was asked, -1: none.
        time: of that tick, simulated [s].
        where: the traceback of its main thread, as faulthandler writes it.
    """

    def __init__(
        self,
        kind: FailureKind,
        text: str,
        *,
        cause: str = "",
        lines: Sequence[str] | None = None,
        tick: int = -1,
        time: float = 0.0,
        where: str = "",
    ) -> None:
        super().__init__(kind, text)
        self.kind, self.text, self.cause, self.lines = kind, text, cause, lines
        self.tick, self.time, self.where = tick, time, where

    def __str__(self) -> str:
        """Say it of the stack under test."""
        return self.of("stack")

    def of(self, who: str) -> str:
        """Say it of the stack, or of one of its layers."""
        return self.text if self.kind == "answer" else f"the {who} {self.text}"

    def at(self, tick: int, time: float) -> Ending:
        """Note the tick that it was asked, and the simulated time of that [s]."""
        self.tick, self.time = tick, time
        return self

    def failure(
        self, *, who: str = "stack", layer: str = "", frames: Sequence[str] | None = None
    ) -> StackFailure:
        """Turn it into the failure of a stack, which ``stack_runs`` judges.

        Args:
            who: the stack, or the layer that a process stands for.
            layer: whose code failed, empty: not known.
            frames: of a traceback, innermost last; None: the last lines that it printed.
        """
        return StackFailure(
            kind=self.kind,
            tick=self.tick,
            time=self.time,
            layer=layer,
            exception=self.cause,
            message=self.of(who),
            frames=tuple(self.lines or () if frames is None else frames),
        )


def name_of_ending(code: int) -> str:
    """Say how a process ended: its exit code, or the signal, of which ``code`` is the negative."""
    if code >= 0:
        return f"exit code {code}"
    known = {known.value: known.name for known in signal.Signals}
    return known.get(-code, f"signal {-code}")  # real-time signals have no name


# --- from one process to another ---------------------------------------------------------------


class RemoteTraceback(Exception):  # noqa: N818 - is never raised by itself
    """Where an exception was raised in another process."""


class Raised(NamedTuple):
    """An exception on its way to another process."""

    kind: type[BaseException]
    args: tuple[Any, ...]
    more: dict[str, Any]  #: attributes
    traceback: str

    @classmethod
    def by(cls, error: BaseException) -> Raised:
        """Describe an exception that is being handled."""
        args = error.args
        if isinstance(error, OSError) and error.filename is not None:
            args = (error.errno, error.strerror, error.filename)
        return cls(type(error), args, dict(vars(error)), traceback.format_exc())

    @classmethod
    def unsendable(cls, error: Exception, outcome: Outcome) -> Raised:
        """Say that an outcome cannot be sent, and why."""
        text = str(error)
        if isinstance(outcome, Raised):
            text = f"{outcome.kind.__name__}: {outcome.args}"
        return cls(HarnessError, (text,), {}, traceback.format_exc())

    def rebuilt(self) -> BaseException:
        """Build the exception; its cause is the traceback in the other process."""
        # Constructors of ours take other arguments than exceptions keep.
        if issubclass(self.kind, OSError):
            error: BaseException = self.kind(*self.args)
        else:
            error = self.kind.__new__(self.kind)
            error.args = self.args
            vars(error).update(self.more)
        error.__cause__ = RemoteTraceback(f"\n{self.traceback}")
        return error


class Returned(NamedTuple):
    """A value on its way to another process."""

    value: Any


Outcome = Returned | Raised  #: of a call


def outcome_of(call: Callable[[], Any]) -> Outcome:
    """Run a call; give what it returns or raises."""
    try:
        return Returned(call())
    except (Exception, KeyboardInterrupt) as error:
        return Raised.by(error)


def opened(outcome: Outcome) -> Any:
    """Return what a call in another process returned, or raise what it raised."""
    if isinstance(outcome, Raised):
        raise outcome.rebuilt()
    return outcome.value
