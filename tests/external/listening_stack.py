"""A stack that runs already: it listens at the address that is its argument.

At its fifth tick it takes a minute while there is no file that its parameter ``slow_until`` names.
"""

import os
import sys
import time

import numpy as np

from simulator_interface.clients.mrta_stack import serve


class Turning:
    """Lets all robots turn, a little faster each tick."""

    def __init__(self, world: dict, harness: object) -> None:
        self.robots, self.ticks = len(world["robots"]), 0
        self.slow_until = world["params"].get("slow_until", "")

    def step(self, tick: dict) -> dict:
        self.ticks += 1
        if self.ticks == 5 and self.slow_until and not os.path.exists(self.slow_until):
            time.sleep(60.0)
        return {"twist": np.tile((0.0, 0.0, 0.01 * self.ticks), (self.robots, 1))}


serve(Turning, name="listening", listen=sys.argv[1])
