"""Which links are up when."""

from __future__ import annotations

import dataclasses

from mrta_falsify.core.world import CommsOutage
from mrta_falsify.stack.comms import links_at, outage_times


def test_an_outage_cuts_the_named_links_of_the_named_robots_for_its_time(hall):
    outage = CommsOutage(name="a", robots=("robot2",), links=("planner",), start=5.0, end=9.0)
    world = dataclasses.replace(hall, events=(outage,))
    assert outage_times(world) == (5.0, 9.0)
    during = links_at(world, 5.0)
    assert during.down_for(0) == ()
    assert during.down_for(1) == ("planner",)
    assert links_at(world, 4.99).down_for(1) == links_at(world, 9.0).down_for(1) == ()


def test_overlapping_outages_add_up(hall):
    first = CommsOutage(name="a", robots=(), links=("planner",), start=0.0, end=9.0)
    second = CommsOutage(name="b", robots=("robot1",), links=("states",), start=5.0, end=7.0)
    world = dataclasses.replace(hall, events=(first, second))
    assert links_at(world, 6.0).down_for(0) == ("planner", "states")
    assert links_at(world, 6.0).down_for(1) == ("planner",)
