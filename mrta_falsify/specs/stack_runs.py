"""The stack under test answers every tick, and with something that can be carried out."""

from __future__ import annotations

from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.registry import WithoutOptions
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.stack_failure import StackFailure
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World

NAME = "stack_runs"


class StackRuns(WithoutOptions):
    """The stack does not crash, hang, take too much memory or answer nonsense.

    Robustness: 1, or -1 if it failed. A failure ends the episode; ``violated_at`` is the time of
    the tick that was not answered. Failures of the toolkit are errors and no verdicts.
    """

    profile = SpecProfile(meaning="the stack failed", tie=0)

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del world, dt
        self._failure: StackFailure | None = None

    def update(self, frame: Frame) -> None:
        """Take in one tick, which the stack answered."""

    def stack_failed(self, failure: StackFailure) -> None:
        """Take in how the stack failed."""
        self._failure = failure

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        failure = self._failure
        if failure is None:
            return Verdict(spec=NAME, robustness=1.0, violated=False)
        return Verdict(
            spec=NAME,
            robustness=-1.0,
            violated=True,
            violated_at=failure.time,
            evidence={
                "kind": failure.kind,
                "tick": failure.tick,
                "layer": failure.layer,
                "exception": failure.exception,
                "message": failure.message,
                "frames": list(failure.frames),
            },
        )
