"""A dispatcher of a user: each robot fetches and brings its own tasks.

It hears of tasks, says where each robot is to go, and what it has picked up and dropped off. The
harness drives. With the argument `ahead`, robots drive straight ahead and stop before each other.
"""

from __future__ import annotations

import functools
import json
import math
import os
import sys
import time

from simulator_interface.foreign.dds.link import Link
from simulator_interface.foreign.dds.waiting import done_topic
from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.interfaces import humble_types
from simulator_interface.foreign.robot_topics import ALL_TASKS, DEFAULT, NANO, Topic

NEAR = 0.6 if "ahead" in sys.argv else 0.3  # m
APART = 1.2  # m, at which robots that drive straight ahead stop
KINDS = ("picked-up", "dropped-off")
ROBOTS = ("robot1", "robot2")


class Fetching:
    def __init__(self) -> None:
        self.types = WireTypes(humble_types())
        self.link = Link(int(os.environ["ROS_DOMAIN_ID"]), self.types)
        self.place: dict[str, tuple[float, float]] = {}
        self.stops: dict[str, list[dict]] = {name: [] for name in ROBOTS}
        self.arrived: dict[str, float] = {}
        self.sent = 0
        self.events = Topic("/events", "std_msgs/msg/String", DEFAULT, "events")
        self.done = done_topic("/clock_done")
        self.goals = {
            name: Topic(f"/{name}/goal_pose", "geometry_msgs/msg/PoseStamped", DEFAULT, "goal_pose")
            for name in ROBOTS
        }
        self.commands = {
            name: Topic(f"/{name}/cmd_vel", "geometry_msgs/msg/Twist", DEFAULT, "cmd_vel")
            for name in (ROBOTS if "ahead" in sys.argv else ())
        }
        for topic in (self.events, self.done, *self.goals.values(), *self.commands.values()):
            self.link.advertise(topic)
        for name in ROBOTS:
            odom = Topic(f"/{name}/odom", "nav_msgs/msg/Odometry", DEFAULT, "odom")
            self.link.listen(odom, functools.partial(self.see, name))
        self.link.listen(Topic("/tasks", "std_msgs/msg/String", ALL_TASKS, "tasks"), self.take)
        clock = Topic("/clock", "rosgraph_msgs/msg/Clock", DEFAULT, "clock")
        self.link.listen(clock, self.answer)

    def see(self, name: str, odometry) -> None:
        place = odometry.pose.pose.position
        self.place[name] = place.x, place.y

    def take(self, message) -> None:
        task = json.loads(message.data)
        for kind, end in zip(KINDS, ("start", "end"), strict=True):
            service = task["pickup_time" if end == "start" else "dropoff_time"]
            stop = {"kind": kind, "task": task["task"], "at": task[f"{end}_point"], "for": service}
            self.stops[task["robot"]].append(stop)

    def answer(self, message) -> None:
        now = message.clock.sec + message.clock.nanosec / NANO
        for name, stops in self.stops.items():
            if stops:
                self.work(name, stops, now)
        done = self.types.make(self.done.type)
        done.data = [message.clock.sec * NANO + message.clock.nanosec, self.sent]
        self.link.publish(self.done, done)

    def work(self, name: str, stops: list[dict], now: float) -> None:
        stop = stops[0]
        if math.dist(self.place[name], stop["at"]) > NEAR:
            self.arrived.pop(name, None)
        elif now - self.arrived.setdefault(name, now) > stop["for"] + 1.0:
            said = self.types.make(self.events.type)
            said.data = json.dumps({"kind": stop["kind"], "robot": name, "task": stop["task"]})
            self.publish(self.events, said)
            self.arrived.pop(name)
            stops.pop(0)
        goal = self.types.make("geometry_msgs/msg/PoseStamped")
        goal.header.frame_id = "map"
        x, y = stops[0]["at"] if stops else (math.nan, math.nan)
        goal.pose.position.x, goal.pose.position.y = x, y
        self.publish(self.goals[name], goal)
        if name in self.commands:
            self.drive(name, math.dist(self.place[name], (x, y)) > NEAR)

    def drive(self, name: str, is_away: bool) -> None:
        one, other = self.place.values()
        twist = self.types.make("geometry_msgs/msg/Twist")
        twist.linear.x = 0.5 if is_away and math.dist(one, other) > APART else 0.0
        self.publish(self.commands[name], twist)

    def publish(self, topic: Topic, message) -> None:
        self.link.publish(topic, message)
        self.sent += 1


node = Fetching()
last = time.monotonic()
while time.monotonic() < last + 120.0:
    if node.link.wait(time.monotonic() + 1.0):
        last = time.monotonic()
