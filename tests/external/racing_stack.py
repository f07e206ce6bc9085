"""A stack whose two threads race: whoever comes first at a tick decides the turn rate."""

from __future__ import annotations

import threading

import numpy as np

from simulator_interface.clients.mrta_stack import serve

RACERS = 2
TURN = 0.1  # rad/s


class Racing:
    def __init__(self, world, harness):
        self.robots = len(world["robots"])
        self.start = threading.Barrier(RACERS + 1)
        self.end = threading.Barrier(RACERS + 1)
        self.arrived = []
        for number in range(RACERS):
            threading.Thread(target=self.race, args=(number,), daemon=True).start()

    def race(self, number):
        while True:
            self.start.wait()
            self.arrived.append(number)
            self.end.wait()

    def step(self, tick):
        self.arrived.clear()
        self.start.wait()
        self.end.wait()
        twist = np.zeros((self.robots, 3))
        twist[0, 2] = TURN * self.arrived[0]
        return {"twist": twist}


if __name__ == "__main__":
    serve(Racing, name="races", can=())  # threads do not survive a fork
