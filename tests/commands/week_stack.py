"""Two robots that swap ends of a hall; constants say how they meet.

The test of the week puts it into a repository and changes constants from commit to commit.
"""

import math

import numpy as np

from simulator_interface.clients.mrta_stack import serve

SPEED = 0.5  # m/s
KEEP = 1.0  # m; a robot waits for another one that is nearer ahead
SIDE = 0.0  # m; how far right of the middle robots drive
NARROW = 0.6  # m; who is farther aside is not in the way
ARRIVED = 0.2  # m along the hall
STANDS = 2.0  # s at a room until its stop is claimed


class Hall:
    def __init__(self, world, harness):
        self.rooms = [room["point"] for room in world["rooms"]]
        self.names = [robot["name"] for robot in world["robots"]]
        self.stops = [[] for _ in self.names]  # of each robot: room, kind, task
        self.since = [None for _ in self.names]  # it is at its stop

    def step(self, tick):
        for task in tick["tasks"]:
            stops = self.stops[self.names.index(task["robot"])]
            stops.append((task["start"], "picked-up", task["task"]))
            stops.append((task["end"], "dropped-off", task["task"]))
        robots = len(self.names)
        twist, goal, events = np.zeros((robots, 3)), np.full((robots, 2), np.nan), []
        for i, stops in enumerate(self.stops):
            if stops:
                goal[i] = self.rooms[stops[0][0]]
                twist[i] = self.work(i, tick, goal[i], events)
        left = [len(stops) for stops in self.stops]
        return {"twist": twist, "goal": goal, "stops_left": left, "events": events}

    def work(self, i, tick, goal, events):
        x, y, yaw = tick["pose"][i]
        if abs(goal[0] - x) < ARRIVED:
            if self.since[i] is None:
                self.since[i] = tick["time"]
            elif tick["time"] - self.since[i] > STANDS:
                _, kind, task = self.stops[i].pop(0)
                events.append({"kind": kind, "robot": i, "task": task})
                self.since[i] = None
            return (0.0, 0.0, 0.0)
        faces = 1.0 if math.cos(yaw) > 0.0 else -1.0
        drives = 1.0 if goal[0] > x else -1.0
        for j, other in enumerate(tick["pose"]):
            if j != i and 0.0 < (other[0] - x) * drives < KEEP and abs(other[1] - y) < NARROW:
                return (0.0, 0.0, 0.0)
        if faces != drives:  # backwards to a room behind
            return (-SPEED, 0.0, 0.0)
        aside = (goal[1] - SIDE * faces) - y
        error = math.atan2(max(-0.7, min(0.7, aside)), faces) - yaw
        return (SPEED, 0.0, max(-1.0, min(1.0, math.atan2(math.sin(error), math.cos(error)))))


if __name__ == "__main__":
    serve(Hall, name="hall", says=("deliveries", "goals"))
