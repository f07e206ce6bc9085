"""What ``auto`` is without one of its parts, as samplers of a comparison: which part buys what?

A search stops at its first failure, so what ``auto`` does once a failure is known is no part here.
Which kinds of failure come first is none either: a pair of the suite says what counts (``then``).
"""

from __future__ import annotations

import dataclasses

from mrta_falsify.core.config import Choice
from mrta_falsify.core.feedback import Feedback
from samplers.auto import AutoSampler


class WithoutNoise(AutoSampler):
    """``auto`` that takes what copies tell for certain."""

    def tell(self, feedback: Feedback) -> None:
        """Take in a margin without its variance."""
        super().tell(dataclasses.replace(feedback, noise={}))


PARTS = {
    "auto_without_slope": Choice("auto", {"slope": False}),
    "auto_without_blame": Choice("auto", {"blame": False}),
    "auto_without_loads": Choice("auto", {"loads": False}),
    "auto_without_kin": Choice("auto", {"kin": False}),
    "auto_without_rehearsals": Choice("auto", {"rehearse": False}),
    "auto_without_noise": Choice(f"{__name__}:{WithoutNoise.__name__}"),
    "auto_without_hints": Choice(  # of what a run was near to: these three at once
        f"{__name__}:{WithoutNoise.__name__}", {"slope": False, "blame": False}
    ),
}
