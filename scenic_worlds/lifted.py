"""Python functions that also take Scenic's random values."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from scenic.core.distributions import distributionFunction

F = TypeVar("F", bound=Callable[..., object])


def lifted(function: F) -> F:
    """``function``, so that a random argument makes the result random.

    With fixed arguments it is called at once; with random ones Scenic calls it for each
    scene. The return annotation tells Scenic the kind of the result.
    """
    random: F = distributionFunction(function)
    return random
