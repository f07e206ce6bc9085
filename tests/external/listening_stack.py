"""A stack that runs already: it listens at the address that is its argument.

At its fifth tick it takes a minute if its parameter ``slow`` is true.
"""

import sys
import time

import numpy as np

from simulator_interface.clients.mrta_stack import serve


class Turning:
    """Lets all robots turn, a little faster each tick."""

    def __init__(self, world: dict, harness: object) -> None:
        self.robots, self.ticks = len(world["robots"]), 0
        self.is_slow = world["params"].get("slow", False)

    def step(self, tick: dict) -> dict:
        self.ticks += 1
        if self.ticks == 5 and self.is_slow:
            time.sleep(60.0)
        return {"twist": np.tile((0.0, 0.0, 0.01 * self.ticks), (self.robots, 1))}


serve(Turning, name="listening", listen=sys.argv[1])
