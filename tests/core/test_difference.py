from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.difference import Difference, first_difference
from tests.conftest import scripted_trace


def _with(trace, name, tick, value, robot=1):
    column = trace.columns[name].copy()
    column[tick, robot] = value
    return dataclasses.replace(trace, columns={**trace.columns, name: column})


def test_equal_traces_differ_nowhere(hall, hall_trace):
    assert first_difference(hall_trace, scripted_trace(hall, seconds=10.0)) is None


def test_the_first_tick_the_robot_and_the_size_are_named(hall_trace):
    moved = hall_trace.columns["pose"][40, 1] + np.array([0.0, 1e-9, 0.0])
    later = _with(hall_trace, "velocity", 60, 2.0, robot=0)
    found = first_difference(hall_trace, _with(later, "pose", 40, moved))
    assert (found.tick, found.what, found.who) == (40, "pose", hall_trace.robots[1])
    assert found.time == pytest.approx(2.0)
    assert found.size == pytest.approx(1e-9, rel=1e-3)
    assert str(found).startswith("at tick 40 (2.00 s): pose of robot2 by 1e-09")


def test_what_is_sensed_is_named_before_what_is_intended_at_the_same_tick(hall_trace):
    other = _with(_with(hall_trace, "slack", 7, 1.0), "pose", 7, 0.0)
    assert first_difference(hall_trace, other).what == "pose"


def test_values_missing_in_both_are_no_difference(hall_trace):
    one = _with(hall_trace, "goal", 5, np.nan)
    assert first_difference(one, _with(hall_trace, "goal", 5, np.nan)) is None
    assert first_difference(one, hall_trace).size is None


def test_another_event_another_path_and_another_end_are_found(hall_trace):
    fewer = dataclasses.replace(hall_trace, events=hall_trace.events[:-1])
    assert first_difference(hall_trace, fewer).what == "event dropped-off"
    changed = dataclasses.replace(hall_trace.paths[1], points=np.zeros((1, 2)))
    other = dataclasses.replace(hall_trace, paths=(hall_trace.paths[0], changed))
    assert first_difference(hall_trace, other).what == "path"
    ended = dataclasses.replace(hall_trace, ended="all-tasks-done")
    assert first_difference(hall_trace, ended).what.startswith("end")


def test_a_run_that_ends_earlier_parts_at_its_end(hall, hall_trace):
    short = dataclasses.replace(
        hall_trace,
        columns={name: column[:50] for name, column in hall_trace.columns.items()},
        events=hall_trace.events[:1],
        ended="decided",
    )
    assert first_difference(hall_trace, short) == Difference(
        tick=50, time=pytest.approx(2.45), what="end (decided)"
    )


def test_a_difference_survives_the_way_through_json(hall_trace):
    found = first_difference(hall_trace, _with(hall_trace, "pose", 3, 0.0))
    assert codec.decode(Difference, codec.encode(found)) == found


def test_traces_of_other_robots_are_not_compared(hall_trace):
    other = dataclasses.replace(hall_trace, robots=("a", "b"))
    with pytest.raises(ValueError, match="different robots"):
        first_difference(hall_trace, other)


def test_of_several_ticks_that_differ_in_one_column_the_first_is_named(hall_trace):
    other = _with(_with(hall_trace, "goal", 30, 1.5), "goal", 90, 1.5)
    found = first_difference(hall_trace, other)
    assert (found.tick, found.what) == (30, "goal")


def test_what_is_infinite_in_both_is_left_out_of_the_size(hall_trace):
    points = np.full_like(hall_trace.columns["obstacle_points"][9, 1], np.inf)
    other = points.copy()
    other[0] = 1.0
    one = _with(hall_trace, "obstacle_points", 9, points)
    found = first_difference(one, _with(hall_trace, "obstacle_points", 9, other))
    assert (found.tick, found.what, found.size) == (9, "obstacle_points", None)
