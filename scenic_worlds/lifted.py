"""Python functions that also take Scenic's random values."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

from scenic.core.distributions import distributionFunction

from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.spelling import did_you_mean

F = TypeVar("F", bound=Callable[..., object])


def lifted(function: F) -> F:
    """Let ``function`` take Scenic's random values: a random argument makes the result random.

    With fixed arguments it is called at once; with random ones Scenic calls it for each
    scene. The return annotation tells Scenic the kind of the result.

    The lifted function raises ConfigError at once for a parameter that ``function`` does not
    have, even if its arguments are random.
    """
    random = distributionFunction(function)
    known = inspect.signature(function).parameters

    @functools.wraps(function)
    def call(*args: Any, **options: Any) -> Any:
        for name in options:
            if name not in known:
                hint = did_you_mean(name, known) or f"; it takes {', '.join(known)}"
                raise ConfigError(f"{function.__name__} has no parameter {name!r}{hint}")
        return random(*args, **options)

    return cast(F, call)
