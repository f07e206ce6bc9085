"""What every registered waypoint generator keeps."""

from __future__ import annotations

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import WaypointGenerator
from mrta_falsify.testing.wards import ward_layout

LAYOUT = ward_layout(rooms=4, two_sided=True)


@pytest.mark.parametrize("name", registry.names("waypoint_generator"))
class TestWaypointGenerator:
    def build(self, name):
        return registry.build("waypoint_generator", Choice(name))

    def test_it_offers_the_protocol(self, name):
        assert isinstance(self.build(name), WaypointGenerator)

    def test_ways_end_where_they_are_to_lead(self, name):
        for lane in LAYOUT.lanes:
            tail = np.asarray(LAYOUT.resources[lane.end].spots[-1])
            to_queue, to_room = (
                self.build(name).to_queue(lane, tail),
                self.build(name).to_room(lane),
            )
            assert to_queue.shape[1:] == to_room.shape[1:] == (2,)
            np.testing.assert_array_equal(to_queue[-1], tail)
            np.testing.assert_array_equal(to_room[-1], LAYOUT.rooms[lane.end].point)

    def test_lanes_are_not_changed(self, name):
        lane = LAYOUT.lanes[0]
        before = lane.to_queue.copy(), lane.to_room.copy()
        self.build(name).to_queue(lane, np.zeros(2))
        self.build(name).to_room(lane)
        np.testing.assert_array_equal(lane.to_queue, before[0])
        np.testing.assert_array_equal(lane.to_room, before[1])
