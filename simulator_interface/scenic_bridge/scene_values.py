"""Values of a sampled scene, checked; errors name what is wrong as the program does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from scenic.core.distributions import RejectionException

from mrta_falsify.core.errors import InputError, WorldError


class SceneRejected(RejectionException, WorldError):  # type: ignore[misc] # noqa: N818
    """A sampled scene contradicts itself, for example a deadline before its arrival.

    Samplers draw another scene; where there is none left to draw, it is an error.
    """


@contextmanager
def naming(what: str) -> Iterator[None]:
    """Put ``what`` before the message of errors and rejections in this block."""
    try:
        yield
    except InputError as error:
        error.args = (f"{what}: {error}",)
        raise
    except RejectionException as error:
        raise SceneRejected(f"{what}: {error}") from None


def read_number(value: Any, what: str, *, low: float = -math.inf) -> float:
    """Read a finite number of at least ``low``.

    Raises:
        WorldError: ``value`` is something else; the message begins with ``what``.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number >= low):
        limit = f" >= {low:g}" if math.isfinite(low) else ""
        raise WorldError(f"{what} is {value!r}; it must be a finite number{limit}")
    return number


def read_property(item: Any, name: str) -> float:
    """Read a property of an object as a finite number.

    Raises:
        WorldError: it is something else.
    """
    return read_number(getattr(item, name), name)


def read_seed(given: Any, otherwise: int) -> int:
    """Read the seed of the noise that a program fixes, ``otherwise`` if it does not.

    Raises:
        WorldError: it is not a whole number >= 0.
    """
    if given is None:
        return otherwise
    number = int(given) if isinstance(given, int) else int(read_number(given, "param noise_seed"))
    if number < 0 or number != given:
        raise WorldError(f"param noise_seed is {given!r}; it must be a whole number >= 0")
    return number
