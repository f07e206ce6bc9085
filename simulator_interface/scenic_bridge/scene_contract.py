"""What the bridge relies on in programs over the Scenic library ``scenic_worlds``.

The library imports this package. So the bridge cannot import the library: it knows its modules
by name, and the places of its floor by the protocol below.
"""

from __future__ import annotations

from typing import Any, Protocol

from scenic.core.scenarios import Scene

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import World

MODEL = "scenic_worlds.model"  #: what programs name in their ``model`` line
BEHAVIORS = "scenic_worlds.behaviors"  #: home of the behaviours that become directives
BEHAVIORS_FILE = "behaviors.scenic"  #: its file, as tracebacks name it


class ScenePlaces(Protocol):
    """The named places of a scene's floor; errors name what was given."""

    @property
    def layout(self) -> World:
        """The floor itself: walls, its own furniture, rooms, no robots."""

    def room_number(self, place: Any, /) -> int:
        """Look up the number of a room given by number or name.

        Raises:
            InputError: there is no such room.
            RejectionException: there is none on this floor, which varies.
        """

    def room_point(self, place: Any, /) -> Array:
        """Look up the point ``(2,)`` [m] of a room; errors as ``room_number``."""

    def route_points(self, route: Any, /) -> Array:
        """Look up points ``(K, 2)`` [m] of a route over rooms and points; the same errors."""


def places_of_scene(scene: Scene) -> ScenePlaces:
    """Look up the places that the model line of a scene's program has made.

    Raises:
        WorldError: the program has no model line.
    """
    places: ScenePlaces | None = scene.params.get("_places")
    if places is None:
        raise WorldError(f"the program has no floor; begin it with the line `model {MODEL}`")
    return places


def is_library_behavior(behavior: Any) -> bool:
    """Whether a behaviour is one of the library's."""
    return type(behavior).__module__ == BEHAVIORS
