"""Stages ask all robots at once who has something to do; nothing else depends on it."""

from __future__ import annotations

import numpy as np
import pytest
from mission_course import run, ward

from mrta_falsify.stack import itinerary, replanning
from mrta_falsify.stack.headway import HEADWAY, Headway
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.mission_table import MissionTable, record_of
from mrta_falsify.stack.resources import rooms

due_now = replanning._fill_due
ROOM = record_of(("room", np.int64), ("number", np.int64))


def everyone_asked(rows, pose, velocity, time, grounds, asks):
    asks["at_rest"] = (np.abs(velocity[:, :2]) <= itinerary.AT_REST).all(axis=1)
    asks["asks"], asks["waits"] = True, False
    return True


def everyone_looked_at(rows, pose, link, tick, time, reached, may_plan):
    due_now(rows, pose, link, tick, time, reached, may_plan)
    due = np.where(rows["must_plan"], time >= rows["plan_at"], True)
    may_plan[:] = rows["going"] & link & due


def nothing_kept(robot, mission):
    room = mission.itinerary[0].room if mission.itinerary else -1
    return room, -1


@pytest.mark.parametrize(
    ("places", "tasks"),
    [
        ([0, 1, 2], [(0, 0, 3), (0, 1, 3), (0, 2, 3), (30, 3, 0)]),  # a queue, and a way back
        ([0, (4.0, 3.0)], [(0, 1, 0), (5, 0, 1)]),
    ],
    ids=["queue", "two"],
)
def test_who_is_not_asked_has_nothing_to_do(monkeypatch, places, tasks):
    world = ward(places, tasks, rooms=4, horizon=120.0)
    few = run(world)
    monkeypatch.setattr(itinerary, "_fill_asks", everyone_asked)
    monkeypatch.setattr(rooms, "_room_of", nothing_kept)
    everyone = run(world)
    assert few.events
    assert few.events == everyone.events
    np.testing.assert_array_equal(few.pose, everyone.pose)
    assert few.state.digest() == everyone.state.digest()


def test_paths_are_checked_at_their_turn_only(monkeypatch):
    world = ward([0, 1], [(0, 0, 1), (0, 1, 0)])
    few = run(world)
    monkeypatch.setattr(replanning, "_fill_due", everyone_looked_at)
    everyone = run(world)
    assert few.events == everyone.events
    np.testing.assert_array_equal(few.pose, everyone.pose)


def test_a_record_is_written_anew_only_when_the_mission_is_another():
    asked = []

    def describe(robot, mission, number):
        asked.append(robot)
        return mission.room, number

    table, missions = MissionTable(ROOM, describe), [Mission(room=3), Mission(room=5)]
    assert table.rows(missions, 1)["room"].tolist() == [3, 5]
    again = table.rows([missions[0], Mission(room=5)], 2)
    assert asked == [0, 1, 1]
    assert again["number"].tolist() == [1, 2]
    assert table.rows(missions[:1], 3)["number"].tolist() == [3]
    assert len(table.rows([], 4)) == 0


def test_headway_is_made_by_going_far_enough():
    headway = Headway.of_fleet(2)
    headway.note(np.zeros((2, 3)), 1.0)
    moved = np.array([[0.9 * HEADWAY, 0.0, 0.0], [1.1 * HEADWAY, 0.0, 0.0]])
    headway.note(moved, 2.0)
    assert headway.moved_at.tolist() == [1.0, 2.0]
    headway.forget(1)
    headway.note(moved, 3.0)
    assert headway.moved_at.tolist() == [1.0, 3.0]
