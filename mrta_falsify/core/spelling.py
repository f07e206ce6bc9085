"""The nearest known name to a misspelt one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SHORTEST = 3  # letters of a name that may be meant by one that holds it
CLOSE = 0.6  # similarity of difflib, 0 to 1, from which on a name may be meant


def nearest_name(name: str, known: Iterable[str], *, cutoff: float = CLOSE) -> str:
    """Find the known name that ``name`` was probably meant to be; empty if none is near.

    It never is the name that was given: where both read alike (a number and its digits), another
    spelling is not what was wrong.

    Args:
        name: as given.
        known: names that exist.
        cutoff: least similarity, 0 to 1.
    """
    candidates = sorted(other for other in known if other != name)
    same = [other for other in candidates if other.casefold() == name.casefold()]
    found = same or difflib.get_close_matches(name, candidates, n=1, cutoff=cutoff)
    if not found:  # HospitalBed, where there is a Bed
        within = (o for o in candidates if len(o) >= SHORTEST and o.casefold() in name.casefold())
        found = sorted(within, key=lambda other: (-len(other), other))
    return found[0] if found else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """End a message with the nearest known name; empty if none is near."""
    nearest = nearest_name(name, known)
    return f"; did you mean {nearest!r}?" if nearest else ""
