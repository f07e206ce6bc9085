"""A stack whose answers may come from elsewhere: ``python noisy_stack.py SOURCE [FROM_TICK]``."""

import random
import sys
import threading
import time

import numpy as np

from simulator_interface.clients import mrta_stack

SOURCE = sys.argv[1]
FROM = int(sys.argv[2]) if len(sys.argv) > 2 else 0


class Noisy:
    def __init__(self, world, harness):
        self.robots = len(world["robots"])
        self.drawn = random.Random(world["seed"])
        self.counted = 0
        if SOURCE == "thread":
            threading.Thread(target=self.count, daemon=True).start()

    def count(self):
        while True:
            self.counted += 1
            time.sleep(1e-4)

    def noise(self):
        match SOURCE:
            case "clock" | "coin":
                return time.perf_counter_ns() % 1000 / 1000.0
            case "unseeded":
                return np.random.random()  # noqa: NPY002
            case "thread":
                return self.counted % 1000 / 1000.0
            case "hash":
                return hash("robot1") % 1000 / 1000.0
        return self.drawn.random()

    def step(self, tick):
        twist = np.zeros((self.robots, 3))
        if tick["tick"] >= FROM:
            if SOURCE == "raises":
                raise RuntimeError("as always")
            noise = self.noise()
            if SOURCE == "coin" and tick["tick"] == FROM and noise < 0.5:
                raise RuntimeError("tails")
            twist[-1, 2] = noise * 1e-3
        return {"twist": twist}


if __name__ == "__main__":
    mrta_stack.serve(Noisy, name="noisy", can=() if SOURCE == "thread" else ("branch",))
