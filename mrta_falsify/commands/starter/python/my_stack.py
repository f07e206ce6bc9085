"""A stack to begin with: one robot drives at a time, the others stand at their parking spots.

Run it by: mrta-falsify campaign my_scenario.scenic --stack stack.yaml -o runs/first
"""

import math

import numpy as np
from mrta_stack import serve

SPEED = 0.5  # m/s
AHEAD = 0.4  # m; how far along its path a robot aims
ARRIVED = 0.2  # m
KEEP = 0.7  # m; a robot stops for people and obstacles nearer than this


class MyStack:
    """Asked once a tick; everything it may know is in `world` and `tick`."""

    def __init__(self, world, harness):
        self.harness = harness
        self.rooms = [np.array(room["point"]) for room in world["rooms"]]
        starts = np.array([robot["pose"][:2] for robot in world["robots"]])
        self.spots = np.array(world["parking"] or starts)[: len(starts)]
        self.tasks = []  # that nobody has begun, the most urgent first
        self.robot = 0  # that drives
        self.stops = []  # of it: where, what it claims then (None: nothing), service time, task
        self.path = None  # of it
        self.since = None  # when it arrived at the stop [s]

    def step(self, tick):
        robots = len(tick["pose"])
        twist, goal = np.zeros((robots, 3)), np.full((robots, 2), np.nan)
        events, paths, left = [], [], [0] * robots
        self.tasks = sorted(self.tasks + tick["tasks"], key=lambda task: task["deadline"])
        if not self.stops:
            self.begin(tick)
        if self.stops:
            robot, (point, claim, service, task) = self.robot, self.stops[0]
            goal[robot], left[robot] = point, len(self.stops)
            if math.dist(tick["pose"][robot, :2], point) > ARRIVED:
                self.since = None
                if self.path is None or not tick["tick"] % 40:
                    self.path = self.plan(robot, point, tick)
                    paths.append([robot, self.path])
                twist[robot] = self.drive(robot, self.path, tick)
            elif self.since is None:
                self.since = tick["time"]
            elif tick["time"] - self.since > service + 1.0:  # it has come to rest, and stood
                if claim is not None:
                    events.append({"kind": claim, "robot": robot, "task": task})
                self.stops.pop(0)
                self.path, self.since = None, None
        return {"twist": twist, "goal": goal, "stops_left": left, "paths": paths, "events": events}

    def begin(self, tick):
        """Send home who is not at its spot; then take the most urgent task."""
        for robot, spot in enumerate(self.spots):
            if math.dist(tick["pose"][robot, :2], spot) > 2 * ARRIVED:
                self.robot, self.stops = robot, [(spot, None, 0.0, -1)]
                return
        if self.tasks:
            task = self.tasks.pop(0)
            start, end = self.rooms[task["start"]], self.rooms[task["end"]]
            self.robot = int(np.argmin(np.hypot(*(tick["pose"][:, :2] - start).T)))
            self.stops = [
                (start, "picked-up", task["pickup_time"], task["task"]),
                (end, "dropped-off", task["dropoff_time"], task["task"]),
            ]

    def plan(self, robot, goal, tick):
        """The harness's planner, around the other robots, which stand."""
        others = np.delete(tick["pose"][:, :2], robot, axis=0)
        path = self.harness.plan(tick["pose"][robot, :2], goal, avoid=others)
        return path if len(path) else self.harness.plan(tick["pose"][robot, :2], goal)

    def drive(self, robot, path, tick):
        """Turn towards a point ahead on the path; drive if nothing is in the way."""
        if not len(path):
            return (0.0, 0.0, 0.0)
        x, y, yaw = tick["pose"][robot]
        away = np.hypot(*(path - (x, y)).T)
        ahead = int(np.argmin(away))
        while ahead < len(path) - 1 and away[ahead] < AHEAD:
            ahead += 1
        error = math.atan2(path[ahead][1] - y, path[ahead][0] - x) - yaw
        error = math.atan2(math.sin(error), math.cos(error))
        near = np.concatenate([tick["human_position"], np.delete(tick["pose"][:, :2], robot, 0)])
        offset = near - (x, y)
        forward = offset @ (math.cos(yaw), math.sin(yaw))
        aside = np.abs(offset @ (-math.sin(yaw), math.cos(yaw)))
        blocked = (forward > 0.0) & (forward < KEEP + 0.3) & (aside < 0.6)
        speed = 0.0 if blocked.any() or abs(error) > 0.5 else min(SPEED, 1.5 * away[-1] + 0.05)
        return (speed, 0.0, float(np.clip(2.0 * error, -1.5, 1.5)))


if __name__ == "__main__":
    serve(MyStack, name="my stack", version="0.1", says=("deliveries", "goals", "paths"))
