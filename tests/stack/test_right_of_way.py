"""Who comes out of a resource goes before who is let in next."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Resource
from mrta_falsify.stack.driving import _ranked_first
from mrta_falsify.stack.resources.policies import Fifo
from mrta_falsify.stack.resources.queue import Queue, QueueState
from mrta_falsify.stack.resources.right_of_way import OUT_OF_THE_WAY, coming_out


def queue_at(x: float) -> Queue:
    area = rectangle(2.0, 2.0, (x, 0.0))
    resource = Resource(name="lane", kind="corridor", request_area=area, release_area=area)
    return Queue(resource, Fifo(Fifo.Options()))


def left(asked: Queue, robot: int, at: float, time: float = 0.0) -> QueueState:
    """A resource that ``robot`` has let go of at x = ``at`` [m]."""
    state = QueueState(holders=[robot])
    asked.let_go(state, robot, time, np.array([at, 0.0]))
    return state


def poses(*x: float) -> np.ndarray:
    return np.array([[at, 0.0, 0.0] for at in x])


def test_who_has_left_goes_before_a_holder_that_is_outside():
    asked = queue_at(0.0)
    state = left(asked, 0, at=1.1)
    state.holders.append(1)
    assert coming_out([asked], [state], poses(1.2, 2.0)) == (0,)


def test_nobody_has_right_of_way_once_the_holder_is_inside():
    asked = queue_at(0.0)
    state = left(asked, 0, at=1.1)
    assert coming_out([asked], [state], poses(1.2, 2.0)) == ()  # nobody is let in
    state.holders.append(1)
    assert coming_out([asked], [state], poses(1.2, 0.5)) == ()


def test_right_of_way_ends_where_the_robot_is_out_of_the_way_and_does_not_come_back():
    asked = queue_at(0.0)
    state = left(asked, 0, at=1.1)
    state.holders.append(1)
    away = 1.1 + OUT_OF_THE_WAY + 0.1
    assert coming_out([asked], [state], poses(away, 2.0)) == ()
    assert coming_out([asked], [state], poses(1.2, 2.0)) == ()


def test_who_lets_go_inside_has_no_right_of_way():
    asked = queue_at(0.0)
    state = left(asked, 0, at=0.9)
    state.holders.append(1)
    assert coming_out([asked], [state], poses(1.2, 2.0)) == ()


def test_who_holds_a_resource_again_does_not_come_out_of_it():
    asked = queue_at(0.0)
    state = left(asked, 0, at=1.1)
    state.holders += [0, 1]
    assert coming_out([asked], [state], poses(1.2, 2.0)) == ()


def test_who_left_last_goes_first():
    first, second = queue_at(0.0), queue_at(9.0)
    states = [left(first, 1, at=1.1, time=3.0), left(second, 0, at=7.9, time=5.0)]
    for state in states:
        state.holders.append(2)
    found = coming_out([first, second], states, poses(7.5, 1.5, 4.0))
    assert found == (0, 1)


def test_robots_that_go_first_are_ranked_so_and_the_others_keep_their_order():
    rank = np.array([3, 2, 1, 0])  # the largest number first
    assert _ranked_first(rank, (1, 0)).tolist() == [1, 0, 3, 2]
