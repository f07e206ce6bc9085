"""A stack that reads all it is told, and asks a question a tick; a fuzzed harness speaks to it."""

from __future__ import annotations

import numpy as np

try:
    from mrta_stack import serve
except ImportError:
    from simulator_interface.clients.mrta_stack import serve


class Reading:
    def __init__(self, world, harness):
        self.harness = harness
        self.robots = len(world["robots"])

    def step(self, tick):
        points = tick["obstacle_points"]
        near = np.hypot(points[..., 0], points[..., 1]).min(initial=np.inf)
        people = sum(float(x) for x, _ in tick["human_position"])
        told = sum(task["start"] + task["end"] + task["deadline"] for task in tick["tasks"])
        path = self.harness.plan(tick["pose"][0, :2], (1.0, 1.0))
        twist = np.zeros((self.robots, 3))
        twist[:, 0] = 0.1 if near > people + told + len(path) else 0.0
        return {"twist": twist}


if __name__ == "__main__":
    serve(Reading, name="reads")
