"""The stack under test gives the same answer when it is asked the same again."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.stack_failure import DeterminismCheck
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.core.world import World

NAME = "repeatable"


class Repeatable:
    """Asked again with the same memory and input, the stack answers the same.

    Robustness: 1, or -1 after an answer that differed. A stack that never was asked again (an
    episode shorter than a quarter of ``every``, a system or a stack that cannot be copied) is not
    judged.
    """

    profile = SpecProfile(meaning="the stack answered the same question differently", tie=1)

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How often to ask."""

        #: ticks; each copy takes CPU time. The first is made after a quarter of it
        every: int = quantity(low=1, default=800)

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del world, dt
        self._asked = 0
        self._why_not = "the stack was not asked again"
        self._violated: Verdict | None = None
        self._last = (0, 0.0)  # tick, and its time [s]

    def asks_again(self, tick: int) -> bool:
        """Whether ``tick`` is asked again, until an answer differed."""
        every = self._options.every
        is_due = tick == max(1, every // 4) or tick % every == 0
        return tick > 0 and is_due and self._violated is None

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._last = (frame.sensed.tick, frame.sensed.time)
        if frame.determinism is not None:
            self.asked_at_end(frame.determinism)

    def asked_at_end(self, again: DeterminismCheck) -> None:
        """Take in what came of asking the stack again."""
        if again.why_not:
            self._why_not = again.why_not
            return
        self._asked += again.ticks
        other = again.difference
        if other is None or self._violated is not None:
            return
        tick, time = (other.tick, other.time) if other.tick >= 0 else self._last
        self._violated = Verdict(
            spec=NAME,
            robustness=-1.0,
            violated=True,
            violated_at=time,
            who=(other.robot,) if other.robot else (),
            evidence={
                "tick": tick,
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
            return unjudged(NAME, self._why_not)
        return Verdict(spec=NAME, robustness=1.0, violated=False, evidence={"asked": self._asked})
