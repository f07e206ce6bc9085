"""When a continuation may end: nothing that a robot waits for has moved for two minutes."""

from __future__ import annotations

import pytest

from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.specs.deadlock.rest import LastingRest
from tests.specs.frames import Robot, Script


def keeps(edge: BlockedBy, *, drives_for: float) -> bool:
    """Whether robot 0 stays for good, 140 s on, while robot 2 drives to and fro for a time."""

    def patrol(time: float) -> tuple[float, float, float]:
        return 5.0 + min(time, drives_for) % 4.0, 8.0, 0.0

    robots = [
        Robot(at=(1.0, 1.0), goal=(9.0, 1.0)),
        Robot(at=(2.0, 1.0), goal=(1.0, 1.0)),
        Robot(at=patrol, goal=(5.0, 5.0)),
    ]
    script = Script(robots=robots, seconds=140.0)
    world = script.world()
    rest = LastingRest(world)
    edges = {0: [edge], 1: [BlockedBy(1, "barrier", 0)], 2: [BlockedBy(2, "task")]}
    for frame in script.frames(world):
        if frame.sensed.tick % 5 == 0:
            rest.update(frame, edges)
    return rest.keeps(0, settled=0.0)


@pytest.mark.parametrize("edge", [BlockedBy(0, "wall"), BlockedBy(0, "stalled")])
def test_a_robot_that_no_robot_holds_waits_for_all_that_moves(edge):
    assert not keeps(edge, drives_for=130.0)
    assert keeps(edge, drives_for=1.0)


def test_a_robot_that_another_one_holds_waits_for_that_one_alone():
    assert keeps(BlockedBy(0, "barrier", 1), drives_for=130.0)
