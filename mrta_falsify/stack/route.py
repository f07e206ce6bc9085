"""Where one robot is going: its waypoints, the path to the next two, and a halt on the way."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import NO_POINTS, distance_of, is_near

WAYPOINT_REACHED = 1.0  # m, MRTA-Sim
ROOM_REACHED = 0.3  # m, MRTA-Sim
SPOT_REACHED = 0.2  # m, a third of the 0.6 m that robots keep from each other
AT_PATH_END = 0.15  # m, controllers stop within 0.1 m of their goal
LOOK_AHEAD = 0.5  # m to the point a robot steers for, MRTA-Sim
RETRY = 2.0  # s between plans that fail, and while a robot is stuck


def _no_points() -> Array:
    return NO_POINTS


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Where a robot is going and how; part of the stack's memory."""

    route: Array = field(default_factory=_no_points)  #: (K, 2) waypoints still to visit [m]
    path: Array = field(
        default_factory=_no_points
    )  #: (L, 2) planned through the next two waypoints [m]
    halt: Array = field(
        default_factory=_no_points
    )  #: (1, 2) waiting spot to go to first [m], or empty
    must_plan: bool = False
    plan_at: float = 0.0  #: no plan before this time [s]
    failed: str = ""  #: why there is no path
    through_parked: bool = False  #: the path found no way around robots at rest
    parked_number: int = -1  #: which robots were at rest when the path was found

    @property
    def is_going(self) -> bool:
        """Whether there is somewhere to go."""
        return len(self.route) > 0

    def head_for(self, route: Array) -> Way:
        """Take up a new route ``(K, 2)``; the robot waits until there is a path."""
        return replace(
            self,
            route=np.asarray(route),
            path=NO_POINTS,
            halt=NO_POINTS,
            must_plan=True,
            plan_at=0.0,
            failed="",
        )

    def halt_at(self, spot: Array) -> Way:
        """Go to a waiting spot ``(2,)`` first, and keep the route for later."""
        halt = np.array(spot, dtype=np.float64).reshape(1, 2)
        return replace(self, halt=halt, path=NO_POINTS, must_plan=True, plan_at=0.0)

    def resumed(self) -> Way:
        """End the halt: go back to the route."""
        if not len(self.halt):
            return self
        return replace(self, halt=NO_POINTS, path=NO_POINTS, must_plan=True, plan_at=0.0)

    def stopped(self) -> Way:
        """Stay here."""
        return replace(
            self, route=NO_POINTS, path=NO_POINTS, halt=NO_POINTS, must_plan=False, failed=""
        )

    def beyond_waypoint(self) -> Way:
        """Drop the first waypoint, which is reached."""
        return replace(self, route=self.route[1:], must_plan=True)

    def has_reached(self, point: Array, position: Array, reach: float) -> bool:
        """Whether the robot is near ``point`` ``(2,)``, or as near as its path leads.

        The planner moves a goal that is covered by up to 0.25 m.
        """
        if is_near(point, position, reach):
            return True
        if not len(self.path) or len(self.route) > 1:
            return False
        end = self.path[-1]
        return distance_of(end, point) <= ROOM_REACHED and distance_of(end, position) <= AT_PATH_END
