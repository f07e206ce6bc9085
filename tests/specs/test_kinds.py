"""Deadlock, stuck, shut by the world: told apart by one function."""

from __future__ import annotations

import pytest

from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.causes import kind_of, leading, primary, secondary


def violated(spec, at=50.0, who=("robot1",), **evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=at, who=who, evidence=evidence
    )


def claimed(kind="", members=("robot1",), onset=40.0, **more):
    named = {"kind": kind} if kind else {}
    return violated(
        "no_deadlock", who=members, members=list(members), onset=onset, cycle=[], **named, **more
    )


@pytest.mark.parametrize(
    ("verdict", "kind"),
    [
        (claimed("deadlock", ("robot1", "robot2")), "deadlock"),
        (claimed("stuck", ("robot1", "robot2")), "stuck"),
        (claimed("shut", ("robot1", "robot2")), "shut"),
        (claimed("", ("robot1", "robot2")), "deadlock"),  # of a version that named none
        (claimed("", ("robot1",)), "stuck"),
        (violated("no_deadlock", who=("robot1", "robot2")), "deadlock"),  # of one without evidence
        (violated("progress"), ""),
        (Verdict(spec="no_deadlock", robustness=3.0, violated=False), ""),
    ],
)
def test_the_kind_is_that_of_the_claim_or_of_the_number_of_members(verdict, kind):
    assert kind_of([verdict]) == kind


def test_the_gravest_claim_tells_the_kind_wherever_it_stands():
    later = claimed("deadlock", ("robot2", "robot3"), onset=90.0).evidence
    assert kind_of([claimed("shut", onset=10.0, others=[later])]) == "deadlock"
    assert kind_of([claimed("shut", others=[claimed("stuck").evidence])]) == "stuck"


def test_nothing_that_only_follows_from_a_shut_place_is_looked_for_first():
    shut = claimed("shut", onset=40.0)
    run = [
        shut,
        violated("progress", 99.0),
        violated("deadlines", 80.0, ()),
        violated("no_livelock"),
    ]
    assert kind_of(run) == "shut"
    assert leading(run) is shut
    assert primary(run) == ()
    assert secondary(run) == {verdict.spec for verdict in run}


@pytest.mark.parametrize(
    "own",
    [violated("no_robot_robot_contact", 120.0), violated("progress", 99.0, ("robot7",))],
)
def test_a_failure_of_the_stack_leads_over_a_shut_place(own):
    shut = claimed("shut", onset=40.0)
    assert leading([shut, own]) is own
    assert kind_of([shut, own]) == ""
    assert primary([shut, own]) == (own,)
    assert primary([shut, own], then=(own.spec,)) == ()


def test_a_deadlock_is_looked_for_first_unless_the_user_says_otherwise():
    ring = claimed("deadlock", ("robot1", "robot2"))
    assert primary([ring, violated("deadlines")], then=("deadlines",)) == (ring,)
    assert secondary([ring], then=("no_deadlock",)) == {"no_deadlock"}
