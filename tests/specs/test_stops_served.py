"""Which stops count as done, whatever a stack says of those that are left."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.specs.stops_served import StopsServed
from tests.specs.frames import Robot, Script

NOWHERE = (np.nan, np.nan)
ROOM, OTHER = (3.0, 0.0), (-3.0, 0.0)


def served_by(at, goal, *, seconds=10.0, confirmed=lambda time: ()):
    """Stops done at each tick by a robot that is where ``at`` says."""
    script = Script(
        robots=[Robot(lambda time: (*at(time), 0.0), goal=goal)],
        rooms=[ROOM, OTHER],
        seconds=seconds,
    )
    world = script.world()
    stops = StopsServed(world)
    return [
        int(stops.update(frame.sensed, frame.intent.goal, confirmed(frame.sensed.time))[0])
        for frame in script.frames(world)
    ]


def arrives(time):
    """Drives to ROOM within 6 s and stays."""
    return (min(3.0, -3.0 + time), 0.0)


def test_a_stop_that_the_books_confirm_counts_at_once():
    def confirmed(time):
        return (StackEvent(time=8.0, kind="picked-up", robot=0, task=0),) * (time == 8.0)

    counts = served_by(arrives, lambda time: ROOM, confirmed=confirmed)
    assert (counts[0], counts[-1]) == (0, 1)
    assert sum(np.diff(counts)) == 1


def test_stops_that_are_given_to_another_robot_are_not_done():
    counts = served_by(lambda time: (0.0, 0.0), lambda time: ROOM if time < 5.0 else OTHER)
    assert counts[-1] == 0


def test_a_room_that_was_reached_and_left_counts_without_a_claim():
    counts = served_by(arrives, lambda time: ROOM if time < 8.0 else OTHER)
    assert counts[-1] == 1


def test_a_robot_that_drives_through_a_room_has_not_stopped_there():
    counts = served_by(lambda time: (-3.0 + time, 0.0), lambda time: ROOM if time < 6.0 else OTHER)
    assert counts[-1] == 0


def test_a_spot_that_is_no_room_is_no_stop():
    counts = served_by(lambda time: (0.0, 0.0), lambda time: NOWHERE if time > 5.0 else (0.0, 0.0))
    assert counts[-1] == 0


def test_goals_that_change_to_and_fro_at_one_place_are_one_stop():
    counts = served_by(arrives, lambda time: ROOM if time < 7.0 or int(time) % 2 else OTHER)
    assert counts[-1] == 1


def test_a_stop_that_is_confirmed_and_then_left_counts_once():
    def confirmed(time):
        return (StackEvent(time=8.0, kind="picked-up", robot=0, task=0),) * (time == 8.0)

    counts = served_by(arrives, lambda time: ROOM if time < 9.0 else OTHER, confirmed=confirmed)
    assert counts[-1] == 1
