"""A copy of a failing run ends once it is known whether it fails."""

from __future__ import annotations

import dataclasses

from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.specs.books import Ledger
from mrta_falsify.specs.suspicion import suspected
from mrta_falsify.verbs.explain.continuing import Failure, is_suspected, stops_of
from mrta_falsify.verbs.explain.small_differences import Tally
from tests.scenes.ward import ward_layout

VERDICT = Verdict(spec="no_deadlock", robustness=-1.0, violated=True, violated_at=40.0)
FAILURE = Failure(verdict=VERDICT, found=40.0, stops={0: 2, 1: 0})


def _ledger(*, picked, delivered):
    """Tasks by robot that were picked up and delivered."""
    ledger = Ledger(ward_layout(rooms=2))
    for robot, tasks in picked.items():
        for task in tasks:
            ledger.picked[task], ledger.by[task] = 1.0, robot
    for task in delivered:
        ledger.delivered[task] = 2.0
    return ledger


def test_a_stop_is_a_pick_up_or_a_delivery():
    ledger = _ledger(picked={0: (0, 1), 1: (2,)}, delivered=(0,))
    assert [stops_of(ledger, robot) for robot in (0, 1, 2)] == [3, 1, 0]


def test_a_failure_is_passed_once_each_robot_that_it_names_has_done_one_more_stop():
    assert not FAILURE.has_been_passed(_ledger(picked={0: (0, 1)}, delivered=(0,)))
    assert not FAILURE.has_been_passed(_ledger(picked={0: (0,), 1: (1,)}, delivered=(0,)))
    assert FAILURE.has_been_passed(_ledger(picked={0: (0, 1), 1: (2,)}, delivered=(0,)))


def test_a_robot_that_is_gone_need_not_pass():
    ledger = _ledger(picked={0: (0, 1)}, delivered=(0,))
    assert FAILURE.has_been_passed(ledger, without=1)
    alone = dataclasses.replace(FAILURE, stops={0: 0})
    assert not alone.has_been_passed(ledger, without=0)


def test_tasks_that_a_failure_names_must_be_delivered():
    late = Failure(verdict=VERDICT, found=40.0, stops={}, tasks=frozenset((3,)))
    assert not late.has_been_passed(_ledger(picked={0: (3,)}, delivered=()))
    assert late.has_been_passed(_ledger(picked={0: (3,)}, delivered=(3,)))


def test_a_suspicion_is_told_from_what_could_not_be_judged():
    assert is_suspected(suspected("no_deadlock", "a deadlock", who=("a",), evidence={}))
    assert not is_suspected(unjudged("no_deadlock", "no goals are told"))
    assert not is_suspected(VERDICT)


def _tally(failed, passed, unknown=0):
    return Tally(failed, passed, unknown)


def test_two_copies_alike_are_enough_for_now_and_six_settle():
    assert _tally(2, 0).is_enough
    assert not _tally(1, 1).is_enough
    assert _tally(3, 3).is_enough
    assert not _tally(5, 0).is_settled
    assert _tally(6, 0).is_settled
    assert _tally(0, 6).is_settled
    assert not _tally(4, 2).is_settled


def test_copies_that_cannot_be_judged_come_to_an_end():
    assert _tally(0, 0, 2).is_enough
    assert _tally(0, 0, 3).is_settled
    assert not _tally(0, 0, 1).is_settled
