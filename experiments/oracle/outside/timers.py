"""Robots that stand for a time, or until another robot has passed.

``mode``: *window*: robots of ``who`` stand from ``start`` to ``end`` [s]. *mark*: each of ``who``
stands for ``patience`` s once it has driven ``mark`` m to its next stop. *partner*: there it waits
until its partner has been served once more, for at most ``patience`` s. ``partner0`` is the number
of the partner of robot 0, and so on; -1: none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from driving import Drivers, Reason
from mrta_stack import serve


class Timers(Drivers):
    """See the module."""

    def __init__(self, world: dict[str, Any], harness: Any) -> None:
        super().__init__(world, harness)
        params, n = self.params, self.count
        self.mode = params["mode"]
        who = int(params.get("who", 0))  # one bit a robot
        self.who = [bool(who >> i & 1) for i in range(n)]
        self.window = float(params.get("start", 0.0)), float(params.get("end", 0.0))
        self.mark, self.patience = float(params.get("mark", 1.0)), float(params["patience"])
        self.partner = [int(params.get(f"partner{i}", -1)) for i in range(n)]
        self.began: list[float | None] = [None] * n
        self.is_past = np.zeros(n, dtype=bool)
        self.served_before = [0] * n

    def arrived(self, i: int) -> None:
        """Begin the way to the next stop."""
        self.began[i], self.is_past[i] = None, self.reached[i] >= 2

    def may_go(self, i: int, pose: Any) -> Reason | None:
        """Hold robots up by the clock."""
        if self.mode == "window":
            start, end = self.window
            return Reason("timer") if self.who[i] and start <= self.time < end else None
        if self.is_past[i] or self.driven[i] < self.mark or not self._is_held(i):
            return None
        if self.began[i] is None:
            self.began[i] = self.time
            other = self.partner[i]
            self.served_before[i] = self.reached[other] if other >= 0 else 0
        if self.time - self.began[i] >= self.patience:
            self.is_past[i] = True
            return None
        if self.mode == "mark":
            return Reason("timer")
        other = self.partner[i]
        if self.reached[other] > self.served_before[i]:
            self.is_past[i] = True
            return None
        return Reason("partner", (other,))

    def _is_held(self, i: int) -> bool:
        return self.partner[i] >= 0 if self.mode == "partner" else self.who[i]


if __name__ == "__main__":
    serve(Timers, name="timers", version="1", says=("deliveries", "goals", "paths"))
