"""Idle robots make room: six robots parked in the six rooms of the AWS hospital."""

from __future__ import annotations

import pytest
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import Resource
from mrta_falsify.testing.watching import events, tick_of, violations, watch, went_well
from tests.scenes import worlds

EVEN = ((0, 1), (2, 3), (4, 5))
ODD = ((1, 2), (3, 4), (5, 0))
ROUND = ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0))
ACROSS = ((0, 3), (1, 4), (2, 5), (3, 0), (4, 1), (5, 2))


def occupies(resource: Resource, pose: Array) -> bool:
    return bool(Polygon(resource.release_area).contains(Point(pose[:2])))


@pytest.mark.parametrize(
    "deliveries", [EVEN, ODD, *(pytest.param(d, marks=pytest.mark.slow) for d in (ROUND, ACROSS))]
)
def test_nobody_waits_for_ever_with_a_robot_parked_in_every_room(deliveries):
    outcome = watch(worlds.full_house(deliveries))
    assert violations(outcome) == {}
    assert went_well(outcome)
    assert outcome.sim_time < 120.0


@pytest.mark.parametrize("deliveries", [EVEN, ODD])
def test_idle_robot_leaves_the_room_that_another_asks_for(deliveries):
    world = worlds.full_house(deliveries)
    trace = watch(world).trace
    for start, end in deliveries:
        (moved,) = events(trace, "makes-room", end)
        assert moved.resource == world.resources[end].name
        assert moved.other == start
        (given,) = events(trace, "granted", start, resource=moved.resource)
        # The room is given when the idle robot is out of it, not before.
        pose = trace.columns["pose"][tick_of(trace, given.time), end]
        assert not occupies(world.resources[end], pose)


@pytest.mark.parametrize("deliveries", [EVEN, ODD])
def test_robot_that_made_room_stands_in_nobodys_way(deliveries):
    world = worlds.full_house(deliveries)
    trace = watch(world).trace
    for _, end in deliveries:
        pose = trace.columns["pose"][-1, end]
        assert not any(occupies(resource, pose) for resource in world.resources)
