"""A stack that says where to, and leaves driving to the harness; its argument is the way.

goals:  every robot gets the room of its next stop as its goal, and no twist is ever said.
path:   the first robot is given a path with a corner, which no planner would choose.
mixed:  the first robot drives in a circle by twists; the others are driven to their goals.
nobody: `follow` and `twist` are both left out.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from simulator_interface.clients.mrta_stack import serve

HOW = sys.argv[1]
ARRIVED = 0.3  # m
CORNER = np.array([[1.5, 7.0], [6.0, 7.0]])  # m, where the path leads from the first room


class GoalStack:
    """Deals tasks out in turn."""

    def __init__(self, world: dict, harness: object) -> None:
        self.rooms = [room["point"] for room in world["rooms"]]
        self.robots = len(world["robots"])
        self.stops: list[list] = [[] for _ in world["robots"]]
        self.since = [math.inf] * self.robots

    def step(self, tick: dict) -> dict:
        for task in tick["tasks"]:
            self.stops[task["task"] % self.robots] += [
                ("picked-up", task["start"], task["pickup_time"], task["task"]),
                ("dropped-off", task["end"], task["dropoff_time"], task["task"]),
            ]
        events, goal = [], np.full((self.robots, 2), np.nan)
        for robot, stops in enumerate(self.stops):
            if stops:
                goal[robot] = self.rooms[stops[0][1]]
                events += self.serve(robot, stops, tick)
        said = {
            "goal": goal,
            "stops_left": [len(stops) for stops in self.stops],
            "events": events,
            "follow": list(range(self.robots)),
        }
        return said | self.other(tick)

    def serve(self, robot: int, stops: list, tick: dict) -> list[dict]:
        kind, room, service, task = stops[0]
        if math.dist(tick["pose"][robot, :2], self.rooms[room]) > ARRIVED:
            self.since[robot] = math.inf
            return []
        self.since[robot] = min(self.since[robot], tick["time"])
        if tick["time"] - self.since[robot] < service + 1.0:
            return []
        stops.pop(0)
        self.since[robot] = math.inf
        return [{"kind": kind, "robot": robot, "task": task}]

    def other(self, tick: dict) -> dict:
        if HOW == "path" and tick["tick"] == 0:
            return {"paths": [[0, np.vstack([tick["pose"][0, :2], CORNER])]]}
        if HOW == "mixed":
            twist = np.zeros((self.robots, 3))
            twist[0] = (0.2, 0.0, 0.4)
            return {"twist": twist, "follow": list(range(1, self.robots))}
        if HOW == "nobody":
            return {"follow": []}
        return {}


serve(GoalStack, name=f"goals {HOW}", says=("deliveries", "goals", "paths"))
