"""How a stack under test fails to answer: it crashes, hangs, or answers nonsense."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.renamed import renamed_attribute

#: crash: an exception, or the end of the process; hang: no answer to a tick; memory: too much of
#: it; answer: not a number, or of a wrong shape
FailureKind: TypeAlias = Literal["crash", "hang", "memory", "answer"]

GIB = 1024.0**3  # bytes
TICK_LIMIT = 60.0  # s of CPU; a tick of the slowest shipped stack takes less than 1 s
MEMORY_LIMIT = 2.0  # GiB; the shipped stacks take less than 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class StackLimits:
    """What a stack may use."""

    tick: float = quantity(above=0.0, unit="s", default=TICK_LIMIT)  #: CPU time for one tick
    memory: float = quantity(above=0.0, unit="GiB", default=MEMORY_LIMIT)
    """Resident memory that it may take up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StackFailure:
    """How a stack failed to answer a tick."""

    kind: FailureKind
    tick: int  #: that it did not answer, or not properly
    time: float  #: of the tick [s]
    layer: str = ""  #: whose code failed, empty: not known
    exception: str = ""  #: type of the exception, name of the signal, or ``exit``
    message: str = ""  #: in words
    frames: tuple[str, ...] = ()  #: of the traceback, innermost last, as ``file:line in function``


class StackFailed(Exception):  # noqa: N818 - says what happened to the stack, not to the toolkit
    """The stack under test failed; the episode ends here.

    Args:
        failure: how.
    """

    def __init__(self, failure: StackFailure) -> None:
        super().__init__(failure.message)
        self.failure = failure


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherAnswer:
    """Where the stack answered the same question differently."""

    field: str  #: such as ``command`` or ``intent.goal``; see docs/specifications.md
    robot: str = ""  #: name, empty: concerns none alone
    first: str = ""  #: what it answered
    again: str = ""  #: what it answered to the same state and input
    tick: int = -1  #: -1: the one at which it was asked again
    time: float = 0.0  #: of ``tick`` [s], where that is given


@dataclass(frozen=True, slots=True, kw_only=True)
class DeterminismCheck:
    """What came of asking a copy of the stack the same again, one tick or all of a run."""

    difference: OtherAnswer | None = None  #: the first one
    ticks: int = 1  #: that were asked again
    why_not: str = ""  #: why none could be, in words


def __getattr__(name: str) -> Any:
    return renamed_attribute(sys.modules[__name__], name, {"AskedAgain": "DeterminismCheck"})
