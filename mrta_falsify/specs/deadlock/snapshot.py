"""What the oracle knows of the fleet when it derives edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Intent, Sensed
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.goals import Goal

Claim = Literal["inside", "entering", "coming", "leaving"]  #: how a robot uses a resource


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetSnapshot:
    """The fleet at one moment, goals understood."""

    world: World
    sensed: Sensed
    intent: Intent
    position: Array  #: (N, 2) [m], contiguous
    still: BoolArray  #: (N,) stands on its spot
    present: BoolArray  #: (N,) has joined
    path: tuple[Array, ...]  #: N polylines (L, 2) that the robots drive along [m], empty: none
    goal: tuple[Goal | None, ...]  #: N meanings of the goals, None: no goal
    at_goal: BoolArray  #: (N,)
    #: by number of a resource: its users by their claim, as far as they were asked for
    users: dict[int, dict[Claim, list[int]]] = field(default_factory=dict)

    def is_idle(self, i: int) -> bool:
        """Whether robot ``i`` waits for a task: without a goal, or parked."""
        goal = self.goal[i]
        if goal is None:
            return True
        return bool(self.at_goal[i]) and goal.kind in ("parking", "elsewhere")

    def way(self, i: int) -> Array:
        """Give robot ``i``'s path ``(L, 2)`` [m]; without one, the straight line to its goal."""
        path = self.path[i]
        if len(path):
            return np.ascontiguousarray(path, dtype=np.float64)
        return np.stack([self.position[i], self.intent.goal[i]])
