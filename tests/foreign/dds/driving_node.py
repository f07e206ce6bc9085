"""Nodes of a user in one process: each robot drives on until its x is beyond a mark.

Arguments: coupling, mark [m], number of robots. Stepped, it acknowledges each clock; else it
answers each odometry.
"""

from __future__ import annotations

import functools
import os
import sys
import time

from simulator_interface.foreign.dds.link import Link
from simulator_interface.foreign.dds.waiting import done_topic
from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.interfaces import humble_types
from simulator_interface.foreign.robot_topics import DEFAULT, NANO, Topic

LONGEST = 120.0  # s of silence after which nobody needs this process any more


class Driving:
    def __init__(self, coupling: str, mark: float, robots: int) -> None:
        self.coupling, self.mark = coupling, mark
        self.types = WireTypes(humble_types())
        self.link = Link(int(os.environ["ROS_DOMAIN_ID"]), self.types)
        self.x: list[float | None] = [None] * robots
        self.sent = 0
        self.commands = []
        for robot in range(robots):
            name = f"/robot{robot + 1}"
            odom = Topic(f"{name}/odom", "nav_msgs/msg/Odometry", DEFAULT, "odom", robot)
            command = Topic(f"{name}/cmd_vel", "geometry_msgs/msg/Twist", DEFAULT, "cmd_vel", robot)
            see = functools.partial(self.see, robot)
            self.link.listen(odom, see, wakes=coupling != "stepped")
            self.link.advertise(command)
            self.commands.append(command)
        if coupling == "stepped":
            clock = Topic("/clock", "rosgraph_msgs/msg/Clock", DEFAULT, "clock")
            self.link.listen(clock, self.answer)
            self.wait_for_subscribers()
            self.done = done_topic("/clock_done")
            self.link.advertise(self.done)  # ready to step

    def wait_for_subscribers(self) -> None:
        until = time.monotonic() + LONGEST
        while time.monotonic() < until:
            if all(self.link.listeners(topic.name) for topic in self.commands):
                return
            time.sleep(0.01)

    def see(self, robot: int, odometry) -> None:
        self.x[robot] = odometry.pose.pose.position.x
        if self.coupling != "stepped":
            self.command(robot)

    def answer(self, message) -> None:
        for robot in range(len(self.x)):
            self.command(robot)
        done = self.types.make(self.done.type)
        done.data = [message.clock.sec * NANO + message.clock.nanosec, self.sent]
        self.link.publish(self.done, done)

    def command(self, robot: int) -> None:
        twist = self.types.make("geometry_msgs/msg/Twist")
        x = self.x[robot]
        twist.linear.x = 0.3 if x is not None and x < self.mark else 0.0
        self.link.publish(self.commands[robot], twist)
        self.sent += 1


node = Driving(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
last = time.monotonic()
while time.monotonic() < last + LONGEST:
    if node.link.wait(time.monotonic() + 1.0):
        last = time.monotonic()
