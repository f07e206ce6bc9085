"""Library behaviours: from a behaviour's arguments to directives.

A person whose only behaviour is one of the library's gets its directives in the world, and the
world replays without Scenic; any other behaviour is the program's own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scenic.core.dynamics.behaviors import Behavior
from scenic.core.vectors import Vector

from mrta_falsify.core import directives
from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.directives import Directive
from mrta_falsify.core.errors import InputError, WorldError
from simulator_interface.scenic_bridge.scene_contract import (
    BEHAVIORS,
    ScenePlaces,
    is_library_behavior,
)
from simulator_interface.scenic_bridge.scene_values import read_number


class BehaviorReader:
    """Reads the arguments of library behaviours.

    Args:
        places: of the layout, for rooms given by number or name.
        names: name in the world of each object of the scene, by ``id``.
    """

    def __init__(self, places: ScenePlaces, names: dict[int, str]) -> None:
        self.places = places
        self._names = names
        self._readers: dict[str, Callable[..., tuple[Directive, ...]]] = {
            "WalkTo": self._walk_to,
            "FollowRoute": self._follow_route,
            "WaitFor": self._wait_for,
            "WaitUntil": self._wait_until,
            "StandStill": lambda: (directives.StandStill(),),
            "Push": self._push,
            "PushAlong": self._push_along,
            "Appear": lambda place: (directives.Appear(point=self._point(place, "place")),),
            "Leave": lambda: (directives.Leave(),),
            "InTurn": self._in_turn,
        }

    def of_behavior(self, behavior: Behavior) -> tuple[Directive, ...] | None:
        """Read a sampled behaviour: its directives, None if it is the program's own.

        Raises:
            WorldError: an argument that can never be, named as in the program.
        """
        if not is_library_behavior(behavior):
            return None
        if any(isinstance(a, Behavior) and not is_library_behavior(a) for a in behavior._args):
            return None
        return self.read(type(behavior).__name__, behavior._args, behavior._kwargs)

    def read(
        self, name: str, args: Sequence[Any], options: dict[str, Any]
    ) -> tuple[Directive, ...]:
        """Read the library behaviour ``name`` with its arguments.

        Raises:
            WorldError: an argument that can never be, named as in the program.
        """
        try:
            return self._readers[name](*args, **options)
        except InputError as error:
            error.args = (f"behavior {name}: {error}",)
            raise

    def _walk_to(self, place: Any, speed: Any = 0.0) -> tuple[Directive, ...]:
        return (
            directives.WalkTo(
                point=self._point(place, "place"), speed=read_number(speed, "speed", low=0.0)
            ),
        )

    def _follow_route(
        self, route: Any, repeat: Any = False, speed: Any = 0.0
    ) -> tuple[Directive, ...]:
        return (
            directives.FollowRoute(
                route=frozen_array(np.array(self._route(route))),
                repeat=bool(repeat),
                speed=read_number(speed, "speed", low=0.0),
            ),
        )

    def _wait_for(self, seconds: Any) -> tuple[Directive, ...]:
        return (directives.Wait(duration=read_number(seconds, "seconds", low=0.0)),)

    def _wait_until(self, time: Any) -> tuple[Directive, ...]:
        return (directives.WaitUntil(time=read_number(time, "time", low=0.0)),)

    def _push(
        self, thing: Any, place: Any, speed: Any = 0.0, keeps: Any = False
    ) -> tuple[Directive, ...]:
        return (
            directives.Push(
                furniture=self._name_of(thing),
                point=self._point(place, "place"),
                speed=read_number(speed, "speed", low=0.0),
                keeps=bool(keeps),
            ),
        )

    def _push_along(
        self, thing: Any, route: Any, pause: Any = 0.0, speed: Any = 0.0
    ) -> tuple[Directive, ...]:
        name, pace = self._name_of(thing), read_number(speed, "speed", low=0.0)
        wait = directives.Wait(duration=read_number(pause, "pause", low=0.0))
        told: list[Directive] = []
        for point in self._route(route):
            push = directives.Push(furniture=name, point=point, speed=pace, keeps=True)
            told += [push, wait]
        return tuple(told)

    def _name_of(self, thing: Any) -> str:
        name = thing if isinstance(thing, str) else self._names.get(id(thing), "")
        if not name:
            raise WorldError(f"thing is {thing!r}; it must be furniture of the program")
        return name

    def _route(self, route: Any) -> list[Array]:
        if isinstance(route, str) or not hasattr(route, "__iter__"):
            raise WorldError(f"route is {route!r}; it must be a list of places")
        points = [self._point(stop, f"route[{i}]") for i, stop in enumerate(route)]
        if not points:
            raise WorldError("route is empty; it must have at least one place")
        return points

    def _in_turn(self, *steps: Any) -> tuple[Directive, ...]:
        told: list[Directive] = []
        for i, step in enumerate(steps):
            read = self.of_behavior(step) if isinstance(step, Behavior) else None
            if read is None:
                raise WorldError(
                    f"step {i + 1} is {step!r}; it must be a behavior of {BEHAVIORS} (write `do` "
                    "after `do` in a behavior of your own for others)"
                )
            told += read
        return tuple(told)

    def _point(self, place: Any, what: str) -> Array:
        """Place ``(2,)`` [m]: a room, a point, or anything that has a position."""
        if isinstance(place, (int, str, np.integer)) and not isinstance(place, bool):
            return frozen_array(np.asarray(self.places.room_point(place), dtype=np.float64)[:2])
        place = getattr(place, "position", place)
        values = (place.x, place.y) if isinstance(place, Vector) else place
        try:
            return frozen_array([read_number(values[0], what), read_number(values[1], what)])
        except (TypeError, IndexError):
            raise WorldError(
                f"{what} is {place!r}; it must be a room, a point (x, y) or an object"
            ) from None
