"""Who comes out of a resource goes before who is to enter it.

A robot that has let go is still in the mouth of the place. Whoever is let in next must not push
it back, into the very place that it has just left.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.plane import distance_of
from mrta_falsify.stack.resources.queue import Queue, QueueState

OUT_OF_THE_WAY = 4.0  # m from where it let go, as far as robots decide together


def coming_out(
    queues: Sequence[Queue], memories: Sequence[QueueState], pose: Array
) -> tuple[int, ...]:
    """List robots that have left a resource which another one is about to enter, latest first.

    Args:
        queues: of all resources.
        memories: of them; robots that are out of the way are forgotten.
        pose: ``(N, 3)`` of all robots, x, y [m] and yaw [rad], map frame.
    """
    found: dict[int, float] = {}
    for queue, memory in zip(queues, memories, strict=True):
        if not memory.left:
            continue
        for robot, departure in tuple(memory.left.items()):
            away = distance_of(departure.place, pose[robot, :2]) > OUT_OF_THE_WAY
            if away or robot in memory.holders:
                del memory.left[robot]
        if memory.left and any(queue.is_left_at(pose[robot, :2]) for robot in memory.holders):
            for robot, departure in memory.left.items():
                found[robot] = max(departure.time, found.get(robot, departure.time))
    return tuple(sorted(found, key=lambda robot: (-found[robot], robot)))
