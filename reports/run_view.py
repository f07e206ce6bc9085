"""What pictures and pages of a run are made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunView:
    """What pictures and pages of one run are made from."""

    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...] = ()
    costmap: Costmap | None = None  #: at time 0
    facts: tuple[tuple[str, str], ...] = ()  #: label and text, shown in this order


def extent_of(world: World) -> tuple[float, float, float, float]:
    """Rectangle (x min, y min, x max, y max) [m] that holds everything drawn, plus 0.6 m."""
    parts = [
        *(wall.polygon for wall in world.walls),
        *(item.polygon for item in world.furniture),
        *(room.point[None] for room in world.rooms),
        *(robot.pose[None, :2] for robot in world.robots),
    ]
    if not parts:
        x_min, y_min, x_max, y_max = world.bounds
        return float(x_min), float(y_min), float(x_max), float(y_max)
    points = np.concatenate(parts)
    low = np.maximum(points.min(axis=0) - 0.6, world.bounds[:2])
    high = np.minimum(points.max(axis=0) + 0.6, world.bounds[2:])
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
