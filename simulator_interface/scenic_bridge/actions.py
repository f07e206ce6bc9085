"""Scenic's actions and library behaviours: from a behaviour's arguments to directives.

The behaviours of ``scenic_worlds.behaviors`` are errands: each becomes directives, which the
crowd carries out. A person whose only behaviour is such a one gets its directives in the
world, and the world replays without Scenic; any other behaviour is the program's own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scenic.core.dynamics.actions import Action
from scenic.core.dynamics.behaviors import Behavior
from scenic.core.vectors import Vector

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.directives import (
    Appear,
    Directive,
    FollowRoute,
    Leave,
    Push,
    StandStill,
    Wait,
    WaitUntil,
    WalkTo,
)
from mrta_falsify.core.errors import InputError, WorldError

if TYPE_CHECKING:
    from simulator_interface.people.scripts import Errand

LIBRARY = "scenic_worlds.behaviors"


class CarryOn(Action):  # type: ignore[misc]
    """Go on with an errand for one Scenic time step; who takes no such action stands."""

    def __init__(self, errand: Errand) -> None:
        self.errand = errand

    def canBeTakenBy(self, agent: Any) -> bool:  # noqa: N802
        """People and scripted robots run errands; the fleet's robots belong to the stack."""
        return getattr(agent, "kind", "") in ("human", "robot")

    def applyTo(self, agent: Any, simulation: Any) -> None:  # noqa: N802
        """See Scenic's ``Action``."""
        simulation.carry_on(agent, self.errand)

    def __repr__(self) -> str:
        if self.errand.done:
            return "CarryOn(done)"
        return f"CarryOn({self.errand.directives[self.errand.index].kind})"


class Reader:
    """Reads the arguments of library behaviours.

    Args:
        places: of the layout, for rooms given by number or name.
        names: name in the world of each object of the scene, by ``id``.
    """

    def __init__(self, places: Any, names: dict[int, str]) -> None:
        self.places = places
        self._names = names
        self._readers: dict[str, Callable[..., tuple[Directive, ...]]] = {
            "WalkTo": self._walk_to,
            "FollowRoute": self._follow_route,
            "WaitFor": self._wait_for,
            "WaitUntil": self._wait_until,
            "StandStill": lambda: (StandStill(),),
            "Push": self._push,
            "Appear": lambda place: (Appear(point=self._point(place, "place")),),
            "Leave": lambda: (Leave(),),
            "InTurn": self._in_turn,
        }

    def of_behavior(self, behavior: Behavior) -> tuple[Directive, ...] | None:
        """Directives of a sampled behaviour, None if it is the program's own.

        Raises:
            WorldError: an argument that can never be, named as in the program.
        """
        if not is_of_library(behavior):
            return None
        if any(isinstance(a, Behavior) and not is_of_library(a) for a in behavior._args):
            return None
        return self.read(type(behavior).__name__, behavior._args, behavior._kwargs)

    def read(
        self, name: str, args: Sequence[Any], options: dict[str, Any]
    ) -> tuple[Directive, ...]:
        """Directives of the library behaviour ``name`` with its arguments.

        Raises:
            WorldError: an argument that can never be, named as in the program.
        """
        try:
            return self._readers[name](*args, **options)
        except InputError as error:
            error.args = (f"behavior {name}: {error}",)
            raise

    def _walk_to(self, place: Any, speed: Any = 0.0) -> tuple[Directive, ...]:
        return (WalkTo(point=self._point(place, "place"), speed=_number(speed, "speed")),)

    def _follow_route(
        self, route: Any, repeat: Any = False, speed: Any = 0.0
    ) -> tuple[Directive, ...]:
        if isinstance(route, str) or not hasattr(route, "__iter__"):
            raise WorldError(f"route is {route!r}; it must be a list of places")
        points = [self._point(stop, f"route[{i}]") for i, stop in enumerate(route)]
        if not points:
            raise WorldError("route is empty; it must have at least one place")
        return (
            FollowRoute(
                route=frozen_array(np.array(points)),
                repeat=bool(repeat),
                speed=_number(speed, "speed"),
            ),
        )

    def _wait_for(self, seconds: Any) -> tuple[Directive, ...]:
        return (Wait(duration=_number(seconds, "seconds")),)

    def _wait_until(self, time: Any) -> tuple[Directive, ...]:
        return (WaitUntil(time=_number(time, "time")),)

    def _push(self, thing: Any, place: Any, speed: Any = 0.0) -> tuple[Directive, ...]:
        name = thing if isinstance(thing, str) else self._names.get(id(thing), "")
        if not name:
            raise WorldError(f"thing is {thing!r}; it must be furniture of the program")
        point, pace = self._point(place, "place"), _number(speed, "speed")
        return (Push(furniture=name, point=point, speed=pace),)

    def _in_turn(self, *steps: Any) -> tuple[Directive, ...]:
        directives: list[Directive] = []
        for i, step in enumerate(steps):
            read = self.of_behavior(step) if isinstance(step, Behavior) else None
            if read is None:
                raise WorldError(
                    f"step {i + 1} is {step!r}; it must be a behavior of {LIBRARY} (write `do` "
                    "after `do` in a behavior of your own for others)"
                )
            directives += read
        return tuple(directives)

    def _point(self, place: Any, what: str) -> Array:
        """Place ``(2,)`` [m]: a room, a point, or anything that has a position."""
        if isinstance(place, (int, str, np.integer)) and not isinstance(place, bool):
            return frozen_array(np.asarray(self.places.room_point(place), dtype=np.float64)[:2])
        place = getattr(place, "position", place)
        values = (place.x, place.y) if isinstance(place, Vector) else place
        try:
            return frozen_array([_number(values[0], what), _number(values[1], what)])
        except (TypeError, IndexError):
            raise WorldError(
                f"{what} is {place!r}; it must be a room, a point (x, y) or an object"
            ) from None


def is_of_library(behavior: Any) -> bool:
    """Whether a behaviour is one of ``scenic_worlds.behaviors``."""
    return type(behavior).__module__ == LIBRARY


def pushed_names(directives: Sequence[Directive]) -> set[str]:
    """Names of the furniture that directives push."""
    return {directive.furniture for directive in directives if isinstance(directive, Push)}


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not np.isfinite(number) or (number < 0.0 and what in ("speed", "seconds", "time")):
        raise WorldError(f"{what} is {value!r}; it must be a finite number, times and speeds >= 0")
    return number


def errand(name: str, *args: Any, **options: Any) -> Errand:
    """Errand of a library behaviour that begins now; called by the behaviours themselves."""
    from scenic.syntax import veneer  # noqa: PLC0415 - Scenic's state while it simulates

    simulation: Any = veneer.currentSimulation
    made: Errand = simulation.errand_of(veneer.currentBehavior, name, args, options)
    return made
