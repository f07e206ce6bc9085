"""The account of who waits for whom, from evidence of this version and of earlier ones."""

from __future__ import annotations

import pytest

from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import PUSHED, Arrow, WaitsFor, tick_of, wait_account
from tests.conftest import scripted_trace


def row(robot, cause, blocked_by="", resource=""):
    return {"robot": robot, "cause": cause, "blocked_by": blocked_by, "resource": resource}


def stuck(*who, at=2.0, **evidence):
    return Verdict(
        spec="no_deadlock",
        robustness=-1.0,
        violated=True,
        violated_at=at,
        who=who,
        evidence=evidence,
    )


def queue_behind_a_stall():
    """robot2 stands at the door with the room granted; robot1 and robot3 queue behind it."""
    return stuck(
        "robot2",
        members=["robot2"],
        root="robot2",
        onsets={"robot2": 21.5},
        victims=["robot1", "robot3"],
        cycle=[row("robot2", "wall")],
        chain=[row("robot1", "queue", "robot2", "ward"), row("robot3", "queue", "robot1", "ward")],
        objects=[{"name": "bed2", "kind": "furniture", "carried_by": "porter1"}],
        onset=21.5,
    )


def test_the_root_of_a_chain_is_told_first_and_all_arrows_are_there():
    account = wait_account(queue_behind_a_stall())
    assert account.root == "robot2"
    assert account.robots == ("robot2", "robot1", "robot3")
    assert account.arrows == (
        Arrow("robot2", "bed2", "wall"),
        Arrow("robot1", "robot2", "queue", "ward"),
        Arrow("robot3", "robot1", "queue", "ward"),
        Arrow("bed2", "porter1", PUSHED),
    )
    assert account.nodes == ("robot2", "bed2", "porter1", "robot1", "robot3")


def test_members_are_told_in_the_order_in_which_they_stopped():
    account = wait_account(
        stuck(
            "a", "b", "c",
            members=["a", "b", "c"],
            root="c",
            onsets={"a": 12.0, "b": 11.0, "c": 10.0},
            cycle=[row("a", "barrier", "b"), row("b", "barrier", "c"), row("c", "barrier", "a")],
            chain=[],
        )
    )  # fmt: skip
    assert account.members == ("c", "b", "a")
    assert [wait.robot for wait in account.waits] == ["c", "b", "a"]
    assert account.is_closed


def test_both_of_a_symmetric_pair_are_members_that_wait_for_each_other():
    rows = [row("a", "barrier", "b"), row("b", "barrier", "a")]
    pair = wait_account(stuck("a", "b", members=["a", "b"], cycle=rows, chain=[]))
    assert pair.is_closed
    assert pair.victims == ()
    alone = wait_account(stuck("a", members=["a"], cycle=rows[:1], victims=["b"], chain=rows[1:]))
    assert not alone.is_closed


def test_the_deadlock_that_began_first_is_told():
    later = {"members": ["c"], "onset": 50.0, "cycle": [row("c", "stalled")]}
    first = {"members": ["a"], "onset": 20.0, "cycle": [row("a", "stalled")]}
    assert wait_account(stuck("c", **later, others=[first])).members == ("a",)


def test_evidence_of_earlier_versions_is_completed_from_the_trace(hall):
    trace = scripted_trace(hall, seconds=10.0)  # robot1 waits for robot2 from 1 s to 3 s
    old = stuck("robot2", members=["robot2"], cycle=[row("robot2", "barrier", "robot1")])
    assert [wait.robot for wait in wait_account(old).waits] == ["robot2"]
    completed = wait_account(old, trace)
    assert completed.waits[1] == WaitsFor("robot1", "queue", "robot2", "store")
    assert completed.holding == ("robot2", "robot1")


def test_evidence_that_has_its_chain_needs_no_trace(hall):
    trace = scripted_trace(hall, seconds=10.0)
    rows = [row("robot2", "barrier", "robot1")]
    new = stuck("robot2", members=["robot2"], cycle=rows, chain=[])
    assert wait_account(new, trace) == wait_account(new)


def test_of_a_late_task_nothing_is_told_of_the_last_instant(hall):
    trace = scripted_trace(hall, seconds=10.0)  # robot1, which has task0, waits until 3 s
    late = Verdict(
        spec="deadlines", robustness=-1.0, violated=True, violated_at=2.0, who=("task0",)
    )
    assert wait_account(late, trace).waits == ()


@pytest.mark.parametrize(("at", "tick"), [(2.0, 40), (99.0, 200), (None, 200)])
def test_the_tick_of_a_violation_lies_in_the_run(hall, at, tick):
    trace = scripted_trace(hall, seconds=10.0)
    assert tick_of(stuck("robot1", at=at), trace) == tick


def test_a_member_without_an_edge_is_stalled():
    account = wait_account(stuck("robot1", members=["robot1"], cycle=[], chain=[]))
    assert account.waits == (WaitsFor("robot1", "stalled"),)
