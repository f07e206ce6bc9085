"""When a failure was decided, read off the chances of failure by time."""

from __future__ import annotations

import pytest

from mrta_falsify.core.inevitability import (
    ChanceCurve,
    RewoundTo,
    decision,
    decisive,
    monotone_fit,
    moves_the_turn,
    turn_of,
)
from mrta_falsify.core.probability import failure_probability

FOUND = 40.0  # s


def _points(*rows):
    return tuple(
        RewoundTo(time=time, chance=failure_probability(failed, runs))
        for time, failed, runs in rows
    )


def _curve(*rows, replaced="layer", name="planner", restores=False):
    points = _points(*rows)
    turn = turn_of(points, FOUND)
    return ChanceCurve(
        replaced=replaced,
        name=name,
        change=f"another {name}",
        restores=restores,
        points=points,
        open_until=turn.open_until,
        lost_from=turn.lost_from,
    )


ALWAYS = _curve((0.0, 6, 6), (20.0, 6, 6), replaced="nothing", name="")


def test_chances_that_fall_with_time_are_pooled_by_their_runs():
    assert monotone_fit(_points((0, 0, 6), (1, 3, 6), (2, 0, 3), (3, 6, 6))) == [
        0.0,
        pytest.approx(1 / 3),
        pytest.approx(1 / 3),
        1.0,
    ]
    assert monotone_fit(_points((0, 4, 4), (1, 3, 6), (2, 0, 4))) == [0.5, 0.5, 0.5]


def test_one_odd_time_does_not_move_the_turn():
    points = _points((0, 0, 6), (10, 3, 3), (12, 0, 6), (14, 0, 6), (16, 6, 6))
    assert turn_of(points, FOUND) == (14, 16)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0, 6, 6), (20, 6, 6)], (None, 0)),
        ([(0, 0, 6), (20, 1, 6)], (20, FOUND)),
        ([(0, 3, 6), (20, 6, 6)], (0, 20)),
        ([], (None, FOUND)),
    ],
)
def test_a_turn_lies_between_the_last_open_time_and_the_first_that_is_lost(rows, expected):
    assert turn_of(_points(*rows), FOUND) == expected


def test_a_change_moves_the_turn_only_beyond_both_intervals():
    assert moves_the_turn(_curve((0.0, 0, 6), (30.0, 6, 6)), ALWAYS)
    assert not moves_the_turn(_curve((0.0, 1, 3), (30.0, 6, 6)), ALWAYS)
    odd = _curve((0.0, 12, 12), (10.0, 0, 6), (30.0, 6, 6))
    assert odd.open_until is None
    assert not moves_the_turn(odd, ALWAYS)
    unsure = _curve((0.0, 2, 12), (20.0, 12, 12), replaced="nothing", name="")
    assert not moves_the_turn(_curve((0.0, 0, 12), (20.0, 12, 12)), unsure)
    assert moves_the_turn(_curve((0.0, 0, 12), (22.0, 0, 12)), unsure)


def test_the_interval_at_a_time_follows_from_those_before_and_after_it():
    curve = _curve((0.0, 6, 6), (10.0, 2, 3), (20.0, 0, 1))
    assert curve.band(10.0).low == curve.points[0].chance.low
    assert curve.band(15.0).high == curve.points[2].chance.high == curve.band(0.0).high


def test_it_was_decided_by_the_layer_that_would_have_averted_it_longest():
    planner = _curve((0.0, 0, 6), (10.0, 0, 6), (11.0, 6, 6))
    queues = _curve((0.0, 0, 6), (30.0, 0, 6), (31.0, 6, 6), name="queue_policy")
    late = _curve((0.0, 1, 3), (35.0, 0, 1), (36.0, 6, 6), name="controller")
    curves = (ALWAYS, planner, queues, late)
    assert decisive(curves) is queues
    assert decision(curves) == 31.0


def test_the_shipped_layer_in_place_of_another_decides_before_any_other():
    shipped = _curve((0.0, 0, 6), (10.0, 0, 6), (11.0, 6, 6), restores=True)
    queues = _curve((0.0, 0, 6), (30.0, 0, 6), (31.0, 6, 6), name="queue_policy")
    assert decisive((ALWAYS, queues, shipped)) is shipped


def test_a_robot_that_holds_all_up_is_no_layer():
    robot = _curve((0.0, 0, 6), (30.0, 6, 6), replaced="robot", name="robot1")
    assert decisive((ALWAYS, robot)) is None
    assert decision((ALWAYS, robot)) == 0.0


def test_without_a_decisive_layer_it_was_decided_when_the_stack_began_to_fail():
    stack = _curve((0.0, 0, 6), (12.0, 1, 6), (12.5, 6, 6), replaced="nothing", name="")
    same = _curve((0.0, 0, 6), (12.0, 1, 6), (12.5, 6, 6))
    assert decisive((stack, same)) is None
    assert decision((stack, same)) == 12.5
    assert decision((_curve(replaced="nothing", name=""),)) is None
