"""Directives: the steps of the script that a person follows, as plain data.

The behaviours of ``scenic_worlds.behaviors`` become these, so that a world replays without
its Scenic program. Points are in the map frame; a speed of 0 means the person's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import later, quantity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowRoute:
    """Walk from point to point; with ``repeat``, again and again."""

    KIND: ClassVar[str] = "follow_route"
    kind: Literal["follow_route"] = "follow_route"
    route: Array = quantity(shape=("K", 2), unit="m")  #: points visited in turn
    repeat: bool = False  #: start again at the first point after the last
    speed: float = quantity(low=0.0, unit="m/s", default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WalkTo:
    """Walk to a point, around whatever the map shows."""

    KIND: ClassVar[str] = "walk_to"
    kind: Literal["walk_to"] = "walk_to"
    point: Array = quantity(shape=(2,), unit="m")
    speed: float = quantity(low=0.0, unit="m/s", default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wait:
    """Stand for a time; the person still steps aside for people who come near."""

    KIND: ClassVar[str] = "wait"
    kind: Literal["wait"] = "wait"
    duration: float = quantity(low=0.0, unit="s")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaitUntil:
    """Stand until a moment of the episode."""

    KIND: ClassVar[str] = "wait_until"
    kind: Literal["wait_until"] = "wait_until"
    time: float = quantity(low=0.0, unit="s")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandStill:
    """Stand for good."""

    KIND: ClassVar[str] = "stop"
    kind: Literal["stop"] = "stop"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """Walk behind a movable piece of furniture and push it until its centre is at a point."""

    KIND: ClassVar[str] = "push"
    kind: Literal["push"] = "push"
    furniture: str  #: name of the piece, which must be ``movable``
    point: Array = quantity(shape=(2,), unit="m")
    speed: float = quantity(low=0.0, unit="m/s", default=0.0)
    keeps: bool = later(False)
    """The piece is never left on the way: without progress the person brings it back to where it
    was, and it does not begin where no way is as wide as the piece."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Appear:
    """Enter the building at a point, as soon as no robot stands there."""

    KIND: ClassVar[str] = "appear"
    kind: Literal["appear"] = "appear"
    point: Array = quantity(shape=(2,), unit="m")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leave:
    """Leave the building, here and now."""

    KIND: ClassVar[str] = "leave"
    kind: Literal["leave"] = "leave"


Directive = FollowRoute | WalkTo | Wait | WaitUntil | StandStill | Push | Appear | Leave


def begins_outside(directives: tuple[Directive, ...]) -> bool:
    """Whether a person begins outside the building: only waits come before ``Appear``."""
    for directive in directives:
        if isinstance(directive, Appear):
            return True
        if not isinstance(directive, Wait | WaitUntil):
            return False
    return False
