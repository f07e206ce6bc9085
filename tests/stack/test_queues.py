"""Queues as state machines: exclusion, order, and nobody dropped."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.defects import with_defects
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.plane import inside
from mrta_falsify.core.polyline import point_before_end
from mrta_falsify.core.protocols import Waiter
from mrta_falsify.core.world import Resource
from mrta_falsify.stack.resources.policies import DeadlineFirst, Fifo
from mrta_falsify.stack.resources.queue import Queue, QueueState

FIFO = Fifo(Fifo.Options())
SPOTS = [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]


def queue(*defects, policy=FIFO, **fields):
    resource = Resource(
        name="ward",
        room=0,
        request_area=rectangle(10.0, 10.0),
        release_area=rectangle(2.0, 2.0),
        spots=frozen_array(SPOTS),
        **fields,
    )
    return with_defects(Queue, defects)(resource, policy)


def waiter(robot, since=0.0, deadline=np.inf):
    return Waiter(robot=robot, since=since, distance=1.0, deadline=deadline)


def fill(asked, robots):
    state = QueueState()
    for robot in robots:
        asked.ask(state, waiter(robot, since=float(robot)))
        asked.grant(state)
    return state


@given(
    capacity=st.integers(1, 3),
    moves=st.lists(st.tuples(st.sampled_from(["ask", "leave", "give up"]), st.integers(0, 7))),
)
def test_whatever_happens_exclusion_holds_and_nobody_is_lost(capacity, moves):
    asked, state, present = queue(capacity=capacity), QueueState(), set()
    for time, (move, robot) in enumerate(moves):
        if move == "ask":
            new = asked.ask(state, waiter(robot, since=float(time)))
            assert new == (robot not in present)
            present.add(robot)
        elif move == "leave":
            if asked.release(state, robot):
                present.discard(robot)
        elif robot not in state.holders:
            asked.withdraw(state, robot)
            present.discard(robot)
        asked.grant(state)
        waiting = [known.robot for known in state.waiters]
        assert len(state.holders) <= capacity
        assert sorted(state.holders + waiting) == sorted(present)
        assert not waiting or len(state.holders) == capacity


def test_the_fourth_waiter_stands_behind_the_last_spot():
    asked = queue()
    state = fill(asked, range(5))
    assert state.holders == [0]
    assert [asked.place_of(state, robot) for robot in range(5)] == [None, 0, 1, 2, 3]
    approach = np.array([[3.0, 5.0], [3.0, 0.0]])
    np.testing.assert_allclose(asked.waiting_point(2, approach), SPOTS[2])
    np.testing.assert_allclose(asked.waiting_point(3, approach), [3.0, 1.0])


def test_asking_again_keeps_the_place_and_brings_the_news():
    asked = queue(policy=DeadlineFirst(DeadlineFirst.Options()))
    state = fill(asked, [0, 1, 2])
    assert asked.order(state) == (1, 2)
    assert not asked.ask(state, waiter(2, since=50.0, deadline=10.0))
    assert asked.order(state) == (2, 1)
    assert [known.since for known in state.waiters] == [1.0, 2.0]


def test_a_release_by_somebody_who_holds_nothing_changes_nothing():
    asked = queue()
    state = fill(asked, [0, 1])
    assert not asked.release(state, 1)
    assert state.holders == [0]


def test_service_time_counts_from_the_beginning_of_the_visit():
    asked = queue(service_time=5.0)
    state = fill(asked, [0])
    assert asked.is_served(state, 0, 0.0)
    state.entered[0] = 10.0
    assert not asked.is_served(state, 0, 14.9)
    assert asked.is_served(state, 0, 15.0)
    asked.release(state, 0)
    assert state.entered == {}


def test_the_defect_forgets_the_fourth_waiter_for_good():
    asked = queue("fourth_waiter_dropped")
    state = fill(asked, range(5))
    assert [known.robot for known in state.waiters] == [1, 2, 3]
    for robot in range(4):
        asked.release(state, robot)
        asked.grant(state)
    asked.ask(state, waiter(4))
    assert asked.grant(state) == ()
    assert state.holders == []


def test_the_defect_admits_whenever_anybody_leaves():
    asked = queue("queue_release_loses_exclusion")
    state = fill(asked, range(3))
    (event,) = asked.turn_away(state, 1, 5.0)
    assert (event.kind, event.robot) == ("granted", 2)
    assert state.holders == [0, 2]
    assert [event.kind for event in asked.let_go(state, 0, 6.0, np.zeros(2))] == ["released"]
    assert queue().turn_away(fill(queue(), range(3)), 1, 5.0) == []


@pytest.mark.parametrize(
    ("point", "expected"), [((0.0, 0.0), True), ((1.5, 0.0), False), ((0.9, -0.9), True)]
)
def test_inside_tells_in_from_out(point, expected):
    assert inside(rectangle(2.0, 2.0), np.array(point)) is expected


def test_nothing_is_inside_an_area_without_corners():
    assert not inside(np.zeros((0, 2)), np.zeros(2))


@pytest.mark.parametrize(
    ("distance", "expected"), [(0.0, [3, 0]), (1.0, [2, 0]), (4.0, [0, 1]), (99.0, [0, 4])]
)
def test_a_point_before_the_end_of_a_way(distance, expected):
    way = np.array([[0.0, 4.0], [0.0, 0.0], [3.0, 0.0]])
    np.testing.assert_allclose(point_before_end(way, distance), expected)
