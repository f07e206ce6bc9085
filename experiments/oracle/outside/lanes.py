"""Robots that drive until another one stands before them.

A robot that has stood for ``patience`` s before one that comes towards it, and whose number is the
larger one, goes back to where it was served last, or started; once on its way to a stop. It comes
again once the other one has been served, or after another ``patience`` s. By default nobody does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from driving import Drivers, Reason, Stop
from mrta_stack import serve


class Lanes(Drivers):
    """See the module."""

    def __init__(self, world: dict[str, Any], harness: Any) -> None:
        super().__init__(world, harness)
        self.patience = float(self.params.get("patience", 1e9))
        self.home = [np.array(robot["pose"][:2]) for robot in world["robots"]]
        self.back: list[tuple[int, int, float] | None] = [None] * self.count
        self.has_tried = [False] * self.count

    def arrived(self, i: int) -> None:
        """Go back to here from now on."""
        self.home[i], self.back[i] = self.last[i, :2].copy(), None
        self.has_tried[i] = False

    def aim(self, i: int, stop: Stop) -> Any:
        """Lead the path home for a robot that goes back."""
        return self.home[i] if self.back[i] else stop.point

    def may_go(self, i: int, pose: Any) -> Reason | None:
        """Send a robot back, or let it come again."""
        if self.back[i]:
            other, served, since = self.back[i]
            if self.reached[other] > served or self.time - since > self.patience:
                self.back[i], self.path[i], self.stands_since[i] = None, None, None
                return Reason("timer")
            if np.hypot(*(self.home[i] - pose[i, :2])) < 0.2:
                return Reason("partner", (other,))
            return None
        stands, before = self.stands_since[i], self.stood_for[i]
        if stands is None or self.time - stands < self.patience or before is None:
            return None
        if self.has_tried[i]:
            return None
        if before.why == "robot" and before.robots[0] < i:
            other = before.robots[0]
            self.back[i], self.has_tried[i] = (other, self.reached[other], self.time), True
            self.path[i], self.stands_since[i] = None, None
            return Reason("timer")
        return None


if __name__ == "__main__":
    serve(Lanes, name="lanes", version="1", says=("deliveries", "goals", "paths"))
