"""The stack under test gives the same answer when it is asked the same again."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World

NAME = "repeatable"


class Repeatable:
    """Asked again with the same memory and input, the stack answers the same.

    Robustness: 1, or -1 after an answer that differed. A stack that never was asked again (an
    episode shorter than ``every`` ticks, a system that cannot copy a process) is not judged.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How often to ask."""

        every: int = quantity(low=1, default=200)  #: ticks; each copy takes CPU time

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del world, dt
        self._asked = 0
        self._violated: Verdict | None = None

    def asks_again(self, tick: int) -> bool:
        """Whether ``tick`` is asked again: each ``every``-th, until an answer differed."""
        return tick > 0 and tick % self._options.every == 0 and self._violated is None

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        again = frame.asked_again
        if again is None:
            return
        self._asked += 1
        if again.difference is None or self._violated is not None:
            return
        other = again.difference
        self._violated = Verdict(
            spec=NAME,
            robustness=-1.0,
            violated=True,
            violated_at=frame.sensed.time,
            who=(other.robot,) if other.robot else (),
            evidence={
                "tick": frame.sensed.tick,
                "field": other.field,
                "robot": other.robot,
                "first": other.first,
                "again": other.again,
            },
        )

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        if self._violated is not None:
            return self._violated
        if not self._asked:
            return unjudged(NAME, "the stack was not asked again")
        return Verdict(spec=NAME, robustness=1.0, violated=False, evidence={"asked": self._asked})
