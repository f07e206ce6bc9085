"""Words that messages of all floors share."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

DATES_FROM, DATES_TO = 946684800.0, 4102444800.0  # s since 1970: the years 2000 to 2099


def listed(names: Sequence[str]) -> str:
    """List names as ``a``, ``a and b`` or ``a, b and c``; empty for none."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def number_text(value: float) -> str:
    """Write a number so that it can be told apart from its neighbours, whatever its size.

    From 1 on it has its whole part and up to 3 decimals, so a time in seconds since 1970 keeps its
    milliseconds; below it has 4 significant digits.
    """
    if not 1.0 <= abs(value) < 1e15:
        return f"{value:.4g}"
    return f"{value:.3f}".rstrip("0").rstrip(".")


def is_date(seconds: float) -> bool:
    """Whether a time, taken as seconds since 1970, lies in this century."""
    return DATES_FROM <= seconds < DATES_TO


def date_text(seconds: float) -> str:
    """Write seconds since 1970 as ``2020-03-17 14:57:01 UTC``."""
    return f"{datetime.datetime.fromtimestamp(seconds, datetime.UTC):%Y-%m-%d %H:%M:%S} UTC"


def clock_text(seconds: float) -> str:
    """Write the hours of the day of seconds since 1970, as ``14:57:01 UTC``."""
    return date_text(seconds).partition(" ")[2]
