"""A floor without what stands or moves on it: worlds with equal floors share what is found out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.protocols import Planner
from mrta_falsify.core.world import World, without_actors


@dataclass(frozen=True)
class StaticFloor:
    """Walls and rooms of a world as bytes, to be the key of what is kept."""

    world: World = dataclasses.field(compare=False)
    key: bytes

    @classmethod
    def of(cls, world: World) -> StaticFloor:
        """Take walls, bounds and room points of a world."""
        parts = [np.asarray(world.bounds), *(np.asarray(wall.polygon) for wall in world.walls)]
        parts += [np.asarray(room.point) for room in world.rooms]
        return cls(world, b"|".join(part.tobytes() for part in parts))

    def planner(
        self, costmap: Mapping[str, Any], planner: Mapping[str, Any]
    ) -> tuple[Planner, Costmap]:
        """Build a planner on the walls alone, and the map that it uses.

        Args:
            costmap: options of the layered costmap.
            planner: options of A*.
        """
        bare = dataclasses.replace(without_actors(self.world), furniture=(), parking=NO_POINTS)
        source = registry.build("costmap", Choice("layered", dict(costmap))).bind(bare)
        grid = source.costmap(0.0, NO_POINTS)
        built: Planner = registry.build("planner", Choice("astar", dict(planner)))
        built.use(grid)
        return built, grid
