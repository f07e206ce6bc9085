"""Where the movable furniture of a world is, and which of it rests."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import PARKED_AFTER
from mrta_falsify.core.world import World
from simulator_interface.staging import first_poses, pieces_of

MOVED = 0.05  # m or rad; less is rest


class Furnishings:
    """The movable pieces of a world; people move them."""

    def __init__(self, world: World) -> None:
        self.pieces = pieces_of(world)
        self.pose = first_poses(self.pieces)  #: (F, 3), replaced whenever a piece moves
        self._anchor = self.pose.copy()
        self._since = np.full(len(self.pieces), -np.inf)

    def number(self, name: str) -> int:
        """Look up the number of a piece by the name of its furniture."""
        return [piece.item.name for piece in self.pieces].index(name)

    def move(self, number: int, pose: Array, time: float) -> None:
        """Put a piece somewhere at ``time`` [s]."""
        self.pose = self.pose.copy()
        self.pose[number] = pose
        if np.abs(pose - self._anchor[number]).max() > MOVED:
            self._anchor[number], self._since[number] = pose, time

    def outline(self, number: int) -> Array:
        """Place the outline ``(V, 2)`` [m] of a piece."""
        return self.pieces[number].at(self.pose[number])

    def at_rest(self, time: float) -> tuple[int, ...]:
        """List the pieces at rest for so long that maps show them, as parked robots."""
        return tuple(np.flatnonzero(time - self._since > PARKED_AFTER).tolist())
