"""Which violation is told first: a test for each rule of ``specs/causes.py``."""

from __future__ import annotations

import pytest

from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.specs.causes import by_cause, cause_begins, follows_from, leading


def violated(spec, at, *who, **evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=at, who=who, evidence=evidence
    )


def deadlock(onset, found, *members, **evidence):
    evidence = {"members": list(members), "onset": onset, **evidence}
    return violated("no_deadlock", found, *members, **evidence)


def order(*verdicts):
    return [verdict.spec for verdict in by_cause(verdicts)]


def test_a_touch_just_after_robots_lock_up_does_not_hide_the_deadlock():
    gridlock = deadlock(40.0, 42.0, "robot1", "robot2", "robot3")
    touch = violated("no_robot_static_contact", 40.45, "robot2")
    assert leading([touch, gridlock]) is gridlock
    assert follows_from(touch, gridlock)


def test_a_touch_before_robots_lock_up_is_told_first():
    gridlock = deadlock(40.0, 42.0, "robot1", "robot2")
    touch = violated("no_robot_robot_contact", 39.0, "robot1", "robot2")
    assert order(gridlock, touch) == ["no_robot_robot_contact", "no_deadlock"]
    assert not follows_from(touch, gridlock)


def test_a_later_touch_of_other_robots_is_no_consequence():
    gridlock = deadlock(40.0, 42.0, "robot1", "robot2", victims=["robot3"])
    assert follows_from(violated("no_robot_human_contact", 41.0, "robot3", "walker"), gridlock)
    assert not follows_from(violated("no_robot_human_contact", 41.0, "robot4"), gridlock)


def test_work_that_is_late_never_leads_if_something_went_wrong():
    late = violated("deadlines", 20.0, "task1")
    undone = violated("all_tasks_done", 20.0, "task1")
    dear = violated("costly_way", 10.0)
    touch = violated("no_robot_static_contact", 30.0, "robot1")
    assert order(undone, late, touch, dear)[0] == "no_robot_static_contact"
    assert order(undone, late) == ["deadlines", "all_tasks_done"]


@pytest.mark.parametrize(
    ("spec", "evidence"),
    [
        ("progress", {"since": 30.0}),
        ("no_livelock", {"since": 30.0}),
        ("no_starvation", {"waiting_since": 30.0}),
    ],
)
def test_a_robot_of_a_deadlock_that_gets_no_nearer_is_its_consequence(spec, evidence):
    gridlock = deadlock(40.0, 42.0, "robot1", "robot2", victims=["robot3"])
    stands = violated(spec, 120.0, "robot3", **evidence)
    assert order(stands, gridlock) == ["no_deadlock", spec]


def test_a_robot_that_drove_in_vain_before_the_deadlock_is_told_first():
    gridlock = deadlock(140.0, 142.0, "robot1", "robot2")
    circling = violated("no_livelock", 120.0, "robot1", since=60.0)
    assert order(gridlock, circling) == ["no_livelock", "no_deadlock"]


def test_lost_progress_begins_when_progress_ended_but_not_after_it_was_found():
    assert cause_begins(violated("progress", 120.0, "robot1", since=30.0)) == 30.0
    # the evidence is of the worst moment, here of a later one
    assert cause_begins(violated("progress", 120.0, "robot1", since=400.0)) == 120.0


def test_the_earliest_of_several_deadlocks_counts():
    second = deadlock(50.0, 52.0, "robot3", others=[{"members": ["robot1"], "onset": 20.0}])
    assert cause_begins(second) == 20.0


def test_a_person_passed_too_closely_and_then_touched_is_told_as_touched():
    near = violated("human_clearance", 9.8, "robot1", "walker")
    touch = violated("no_robot_human_contact", 10.0, "robot1", "walker")
    other = violated("human_clearance", 9.8, "robot2", "nurse")
    assert order(near, touch)[0] == "no_robot_human_contact"
    assert order(other, touch)[0] == "human_clearance"


def test_a_crash_is_its_own_cause():
    crash = violated("stack_runs", 10.0)
    assert order(violated("deadlines", 5.0, "task0"), crash)[0] == "stack_runs"
    assert order(violated("exclusive_use", 10.0, "a", "b"), crash)[0] == "stack_runs"
    assert order(violated("exclusive_use", 5.0, "a", "b"), crash)[0] == "exclusive_use"


def test_violations_of_one_instant_have_a_fixed_order():
    expected = [
        *("stack_runs", "repeatable", "honest_events", "kinematic_limits", "exclusive_use"),
        *("no_robot_robot_contact", "no_robot_static_contact", "no_robot_human_contact"),
        *("no_deadlock", "no_livelock", "no_starvation", "progress"),
        *("human_clearance", "deadlines", "all_tasks_done"),
    ]
    same = [violated(spec, 10.0, "robot1") for spec in expected]
    told = order(*reversed(same))
    assert told == expected
    assert order(*same, violated("my_own", 10.0))[0] == "my_own"


def test_what_holds_or_was_not_judged_comes_last_and_never_leads():
    holds = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
    missing = unjudged("deadlines", "the stack tells no deliveries")
    late = violated("all_tasks_done", 60.0, "task0")
    assert order(missing, holds, late) == ["all_tasks_done", "no_deadlock", "deadlines"]
    assert leading([missing, holds]) is None
