"""What the user's nodes have said: commands, goals, paths and events, brought up to date."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array
from simulator_interface.foreign.robot_topics import NANO, RobotTopics, Topic

NEVER = -1


class LastValue:
    """Collects messages between two answers.

    Args:
        topics: of the world.
    """

    def __init__(self, topics: RobotTopics) -> None:
        count = len(topics.robots)
        self._topics = topics
        self._twist = np.zeros((count, 3))
        self._goal = np.full((count, 2), np.nan)
        self._paths: dict[int, Array] = {}
        self._events: list[dict[str, Any]] = []
        self.now = 0  #: simulated time of the tick that is being answered [ns]
        self.published_at = [NEVER] * count  #: simulated time of each robot's last command [ns]
        self.messages = 0  #: taken in to date

    def take_in(self, topic: Topic, message: Any) -> None:
        """Take in a message."""
        self.messages += 1
        value = self._topics.read(topic, message)
        if value.event is not None:
            self._events.append(value.event)
        if value.goal is not None:
            self._goal[topic.robot] = value.goal
        if value.path is not None:
            self._paths[topic.robot] = value.path
        if value.twist is not None:
            self._twist[topic.robot] = value.twist
            self.published_at[topic.robot] = self.now if value.stamp is None else value.stamp

    def twist(self, stale_after: float) -> Array:
        """Give the commands ``(N, 3)`` that count.

        Args:
            stale_after: simulated time after which one does not [s].
        """
        oldest = self.now - round(stale_after * NANO)
        counts = [NEVER < time >= oldest for time in self.published_at]
        return np.where(np.array(counts, dtype=np.bool_)[:, None], self._twist, 0.0)

    def goals(self) -> Array:
        """Give where robots want to be ``(N, 2)`` [m], nan: nowhere."""
        return self._goal.copy()

    def new_paths(self) -> list[list[Any]]:
        """Give the paths that have changed, each only once."""
        paths, self._paths = self._paths, {}
        return [[robot, path] for robot, path in sorted(paths.items())]

    def new_events(self) -> list[dict[str, Any]]:
        """Give the events, each only once; their order does not depend on who was quicker."""
        events, self._events = self._events, []
        return sorted(events, key=repr)
