"""A stack that drives ahead and fails in a world with ``bad`` things: ``python picky_stack.py``.

Parameters: ``robot`` and ``furniture`` name what must be there, ``moved`` is how far [m] the first
robot must have come by tick 20, ``first`` the room in which the task told first begins.
"""

import numpy as np

from simulator_interface.clients import mrta_stack

AT = 20  # tick


class Picky:
    def __init__(self, world, harness):
        self.bad = world["params"]
        self.robots = len(world["robots"])
        self.names = {thing["name"] for kind in ("robots", "furniture") for thing in world[kind]}
        self.start = np.array(world["robots"][0]["pose"][:2])
        self.first = None

    def step(self, tick):
        if self.first is None and tick["tasks"]:
            self.first = tick["tasks"][0]["start"]
        if tick["tick"] == AT and self.is_bad(tick):
            raise RuntimeError("not a world like this")
        twist = np.zeros((self.robots, 3))
        twist[0, 0] = 0.4
        return {"twist": twist}

    def is_bad(self, tick):
        moved = np.linalg.norm(tick["pose"][0, :2] - self.start)
        return (
            {self.bad[kind] for kind in ("robot", "furniture") if kind in self.bad} <= self.names
            and moved >= self.bad.get("moved", 0.0)
            and self.first == self.bad.get("first", self.first)
        )


if __name__ == "__main__":
    mrta_stack.serve(Picky, name="picky")
