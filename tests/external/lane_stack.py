"""Robots that drive along one lane to the rooms of their tasks, and stop for whoever is ahead.

``lane_stack.cpp`` is the same in C++. Both compute with +, -, * and comparisons alone, so that they
command the same bits.
"""

from __future__ import annotations

import math

import numpy as np

from simulator_interface.clients.mrta_stack import serve

SPEED = 0.5  # m/s
GAIN = 0.8  # 1/s
ARRIVED = 0.2  # m
KEEP = 1.0  # m between centres
STANDS = 2.0  # s at a room until its stop is claimed


class Lane:
    def __init__(self, world, harness):
        self.rooms = [room["point"][0] for room in world["rooms"]]
        self.names = [robot["name"] for robot in world["robots"]]
        self.stops = [[] for _ in self.names]  # of each robot: x, kind, task
        self.since = [-1.0 for _ in self.names]  # it is at its stop

    def step(self, tick):
        for task in tick["tasks"]:
            stops = self.stops[self.names.index(task["robot"])]
            stops.append((self.rooms[task["start"]], "picked-up", task["task"]))
            stops.append((self.rooms[task["end"]], "dropped-off", task["task"]))
        robots = len(self.names)
        twist, goal = np.zeros((robots, 3)), np.full((robots, 2), np.nan)
        events, waits = [], []
        for i in range(robots):
            if self.stops[i]:
                self.work(i, tick, twist, events, waits)
            if self.stops[i]:
                goal[i] = (self.stops[i][0][0], tick["pose"][i][1])
        left = [len(stops) for stops in self.stops]
        said = {"twist": twist, "goal": goal, "stops_left": left, "waits_for": waits}
        return {**said, "events": events} if events else said

    def work(self, i, tick, twist, events, waits):
        x, _, yaw = tick["pose"][i]
        stop, kind, task = self.stops[i][0]
        away = stop - x
        if -ARRIVED < away < ARRIVED:
            if self.since[i] < 0.0:
                self.since[i] = tick["time"]
            elif tick["time"] - self.since[i] > STANDS:
                events.append(
                    {"kind": kind, "robot": i, "task": task, "resource": "", "detail": ""}
                )
                self.stops[i].pop(0)
                self.since[i] = -1.0
            return
        for j in range(len(self.names)):
            gap = tick["pose"][j][0] - x
            if j != i and (0.0 < gap < KEEP if away > 0.0 else -KEEP < gap < 0.0):
                waits.append([i, self.names[j]])
                return
        speed = min(max(GAIN * away, -SPEED), SPEED)
        twist[i, 0] = speed if abs(yaw) < 0.5 * math.pi else -speed


if __name__ == "__main__":
    serve(Lane, name="lane", says=("deliveries", "goals"))
