"""A floor without what stands or moves on it: worlds with equal floors share what is found out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.world import World


@dataclass(frozen=True)
class BareFloor:
    """Walls and rooms of a world as bytes, to be the key of what is kept."""

    world: World = dataclasses.field(compare=False)
    key: bytes

    @classmethod
    def of(cls, world: World) -> BareFloor:
        """Take walls, bounds and room points of a world."""
        parts = [np.asarray(world.bounds), *(np.asarray(wall.polygon) for wall in world.walls)]
        parts += [np.asarray(room.point) for room in world.rooms]
        return cls(world, b"|".join(part.tobytes() for part in parts))

    def bare(self) -> World:
        """Take everything but walls, rooms and resources away."""
        return dataclasses.replace(
            self.world, robots=(), humans=(), furniture=(), tasks=(), events=(), parking=NO_POINTS
        )
