"""Find a certificate of a deadlock: the checker decides what counts, this looks for it."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mrta_falsify.analysis.certify import checker
from mrta_falsify.core import codec
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.findings import Certificate, CertifiedMember, Standing

#: how the checker refuses: a claim that does not hold, or one that is not a claim at all
REFUSALS = (ValueError, LookupError, TypeError, StopIteration)
MOVING = "its members still move, or stood for less than 2 s before the end"
WAIT_ELSEWHERE = "its members wait for robots that are no part of a closed circle"
FREE_WAYS = "discs of its members' radius have free ways, and no area that they want is full"


class Reason(NamedTuple):
    """Why a robot stands."""

    area: str  #: that ``robots`` fill; empty: they cut it off
    robots: tuple[int, ...]


class Sought(NamedTuple):
    """A certificate, or why there is none."""

    certificate: Certificate | None
    missing: str = ""


def certify(folder: Path, members: Collection[str] = ()) -> Sought:
    """Look for a certificate in the files of a trial.

    Args:
        folder: of the trial, with ``world.json`` and ``trace.zip``.
        members: of the deadlock that was found; a circle with one of them is wanted. Empty: any.

    Raises:
        FormatError: a file cannot be read.
    """
    try:
        case = checker.Case(folder)
    except (OSError, ValueError, LookupError, zipfile.BadZipFile) as error:
        raise FormatError(f"{folder}: has no readable world.json and trace.zip: {error}") from None
    names = [robot["name"] for robot in case.world["robots"]]
    wanted = {names.index(name) for name in members}
    end = len(case.time) - 1 - int(np.ceil(checker.LEAST / case.table["dt"]))
    late = np.hypot(*(case.poses[max(end, 0) :] - case.at).transpose(2, 0, 1))
    moves = (late > checker.STANDS).any(axis=0) if end >= 0 else np.ones(len(names), dtype=bool)
    standing = set(np.flatnonzero(~moves).tolist())
    if wanted and not wanted & standing:
        return Sought(None, MOVING)
    no_goal = np.isnan(case.goal).any(axis=1)
    resting = {k for k in standing if no_goal[k] and case.left[-1, k] == 0}
    reasons = _reasons(case, {k for k in standing if not no_goal[k]}, resting, wanted)
    circles = _circles(reasons)
    circle = next((c for c in circles if not wanted or c & wanted), None)
    if circle is None:
        return Sought(None, WAIT_ELSEWHERE if wanted & set(reasons) else FREE_WAYS)
    found = _written(case, names, sorted(circle), reasons)
    try:
        checker.accept(folder, codec.encode(found))
    except REFUSALS as error:
        return Sought(None, str(error))
    return Sought(found)


def _reasons(
    case: checker.Case, waiting: set[int], resting: set[int], first: set[int]
) -> dict[int, Reason]:
    """Find robots that each have a reason among themselves and the robots at rest."""
    while True:
        found = {k: _reason(case, k, (waiting | resting) - {k}, first) for k in sorted(waiting)}
        reasons = {k: reason for k, reason in found.items() if reason is not None}
        if len(reasons) == len(waiting):
            return reasons
        waiting = set(reasons)


def _reason(case: checker.Case, who: int, others: set[int], first: set[int]) -> Reason | None:
    """Find why a robot stands: a full area, or robots that cut it off, as few as may be."""
    for area in case.world["resources"]:
        inside = [j for j in sorted(others) if _is_inside(case, area, j)]
        if len(inside) == area["capacity"] and case.fills(who, area["name"], inside):
            return Reason(area["name"], tuple(inside))
    try:
        if case.has_way(who, sorted(others)):
            return None
        needed = sorted(others, key=lambda j: (j in first, -_apart(case, who, j)))
        for j in list(needed):
            without = [m for m in needed if m != j]
            if not case.has_way(who, without):
                needed = without
    except ValueError:
        return None
    return Reason("", tuple(sorted(needed)))


def _is_inside(case: checker.Case, area: dict[str, Any], robot: int) -> bool:
    room = [] if area["room"] is None else case.world["rooms"][area["room"]]["area"]
    return not checker.distance(room or area["release_area"], *case.at[robot])


def _apart(case: checker.Case, one: int, two: int) -> float:
    return float(np.hypot(*(case.at[one] - case.at[two])))


def _circles(reasons: dict[int, Reason]) -> list[set[int]]:
    """List the sets of robots that wait for each other and for no other waiting robot."""
    after = {k: {j for j in reason.robots if j in reasons} for k, reason in reasons.items()}
    for _ in reasons:
        after = {k: held.union(*(after[j] for j in held)) for k, held in after.items()}
    circles: list[set[int]] = []
    for k, held in after.items():
        circle = held | {k}
        is_closed = all(after[j] | {j} == circle for j in circle)
        if is_closed and circle not in circles and (len(circle) > 1 or not held):
            circles.append(circle)
    return circles


def _written(
    case: checker.Case, names: list[str], circle: list[int], reasons: dict[int, Reason]
) -> Certificate:
    """Write a circle down."""
    still = sorted({j for k in circle for j in reasons[k].robots} - set(circle))
    robots = [*circle, *still]
    found = Certificate(
        world=case.table["world_digest"],
        trace=case.table["digest"],
        read=case.read,
        since=float(case.since(robots)),
        until=float(case.time[-1]),
        members=tuple(
            CertifiedMember(
                name=names[k],
                pose=_pair(case.at[k]),
                goal=_pair(case.goal[k]),
                area=reasons[k].area,
                robots=tuple(names[j] for j in reasons[k].robots),
            )
            for k in circle
        ),
        resting=tuple(Standing(name=names[j], pose=_pair(case.at[j])) for j in still),
    )
    return sealed(found)


def sealed(certificate: Certificate) -> Certificate:
    """Put the digest of what a certificate says into it."""
    data = codec.encode(certificate)
    del data["digest"]
    return dataclasses.replace(certificate, digest=checker.digest(data))


def _pair(point: np.ndarray) -> tuple[float, float]:
    x, y = point.tolist()
    return x, y
