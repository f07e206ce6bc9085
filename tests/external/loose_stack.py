"""A stack that stands, and says the coupling that is its argument."""

import sys

import numpy as np

from simulator_interface.clients.mrta_stack import serve


class Standing:
    def __init__(self, world: dict, harness: object) -> None:
        self.robots = len(world["robots"])

    def step(self, tick: dict) -> dict:
        return {"twist": np.zeros((self.robots, 3)), "goal": np.full((self.robots, 2), 3.0)}


serve(Standing, name="loose", says=("goals",), coupling=sys.argv[1])
