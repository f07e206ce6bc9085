"""A stack that runs already: it listens at the address that is its argument."""

import sys

import numpy as np

from simulator_interface.clients.mrta_stack import serve


class Turning:
    """Lets all robots turn, a little faster each tick."""

    def __init__(self, world: dict, harness: object) -> None:
        self.robots, self.ticks = len(world["robots"]), 0

    def step(self, tick: dict) -> dict:
        self.ticks += 1
        return {"twist": np.tile((0.0, 0.0, 0.01 * self.ticks), (self.robots, 1))}


serve(Turning, name="listening", listen=sys.argv[1])
