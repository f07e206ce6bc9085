"""A stack to be killed: ``python -m tests.external.killed_stack MODE``; see ``kills.MODES``."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from simulator_interface.clients import mrta_stack

THINKS = 0.01  # s a tick, so that it is killed while it thinks


class Killed:
    def __init__(self, world, harness):
        self.robots = len(world["robots"])
        self.asked = 0
        if mode in ("children", "sessions"):
            for _ in range(2):
                subprocess.Popen(["sleep", "1000"], start_new_session=mode == "sessions")

    def step(self, tick):
        time.sleep(THINKS)
        self.asked += 1
        twist = np.zeros((self.robots, 3))
        twist[:, 2] = 0.01 * self.asked
        return {"twist": twist}


def hang(connection, address):
    time.sleep(1e6)


if __name__ == "__main__":
    mode = sys.argv[1]
    if mode == "hangs":
        mrta_stack._branch = hang
    mrta_stack.serve(Killed, name="killed")
