"""A run that goes forward from time to time, and another stack in the place of its own."""

from __future__ import annotations

import pytest

from mrta_falsify.core.config import StackConfig
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.testing import planted as worlds
from mrta_falsify.trial import on_kinematic_engine
from simulator_interface.continuation import run_to

PLANTED = on_kinematic_engine(StackConfig(defects=("same_room_twice_stalls",)))
SHIPPED = on_kinematic_engine(StackConfig())


def _run_to(time):
    world = worlds.same_room_twice_stalls(0)
    return run_to(world, PLANTED, build_specifications(("deadlines",)), time)


def test_a_run_goes_forward_as_if_it_had_been_run_there_at_once():
    with _run_to(0.0) as first:
        assert first.last.sensed.tick == 0
        then = first.at(1.02).at(1.5)
        with _run_to(1.5) as at_once:
            assert then.last.sensed.time == at_once.last.sensed.time == pytest.approx(1.5)
            assert (then.last.sensed.pose == at_once.last.sensed.pose).all()


def test_nothing_is_left_of_a_stack_that_is_replaced_at_the_first_tick():
    with _run_to(0.0) as running:
        running.episode.state.dispatcher.known = 7
        running.episode.swap(SHIPPED)
        assert running.episode.state.dispatcher.known == 0


def test_a_stack_that_is_replaced_later_leaves_its_memory():
    with _run_to(0.5) as running:
        known = running.episode.state.dispatcher.known = 7
        running.episode.swap(SHIPPED)
        assert running.episode.state.dispatcher.known == known
