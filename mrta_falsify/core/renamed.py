"""Old names of keyword arguments: they still work, with one warning."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed_keywords(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take keyword arguments by their old names, too.

    Args:
        names: old name -> name now.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> R:
            for old in names.keys() & keywords.keys():
                warnings.warn(
                    f"{function.__name__}: {old} is called {names[old]} now",
                    DeprecationWarning,
                    stacklevel=2,
                )
                keywords.setdefault(names[old], keywords.pop(old))
            return function(*args, **keywords)

        return call

    return decorate
