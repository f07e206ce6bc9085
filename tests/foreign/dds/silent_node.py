"""A node that acknowledges three clocks and then no more."""

from __future__ import annotations

import os
import time

from simulator_interface.foreign.dds.link import Link
from simulator_interface.foreign.dds.waiting import done_topic
from simulator_interface.foreign.dds.wire_types import WireTypes
from simulator_interface.foreign.interfaces import humble_types
from simulator_interface.foreign.robot_topics import DEFAULT, NANO, Topic

types = WireTypes(humble_types())
link = Link(int(os.environ["ROS_DOMAIN_ID"]), types)
DONE = done_topic("/clock_done")
link.advertise(DONE)
answered: list[int] = []


def answer(message) -> None:
    if len(answered) == 3:
        return
    answered.append(message.clock.nanosec)
    done = types.make(DONE.type)
    done.data = [message.clock.sec * NANO + message.clock.nanosec]
    link.publish(DONE, done)


link.listen(Topic("/clock", "rosgraph_msgs/msg/Clock", DEFAULT, "clock"), answer)
until = time.monotonic() + 60.0
while time.monotonic() < until:
    link.wait(time.monotonic() + 1.0)
