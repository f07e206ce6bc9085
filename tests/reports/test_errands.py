from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.core import task_history as errands
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.verdict import Verdict


@pytest.fixture
def late(hall_trace):
    """The trace with two tasks given out, of which the second is only picked up."""
    events = (
        StackEvent(time=0.0, kind="assigned", robot=0, task=0, detail="expected at 9 s"),
        StackEvent(time=5.0, kind="assigned", robot=0, task=1),
        StackEvent(time=6.0, kind="assigned", robot=1, task=1, detail="expected at 130 s"),
        StackEvent(time=8.0, kind="picked-up", robot=1, task=1, resource="ward"),
        StackEvent(time=9.0, kind="deadline-missed", task=1),
    )
    return dataclasses.replace(hall_trace, events=hall_trace.events + events)


def test_the_story_of_a_task_says_from_where_to_where_by_whom_and_how_far(hall, late):
    assert errands.story(0, hall, late) == (
        "task0, from store to ward, known at 0.0 s and due at 100.0 s: it was given to robot1 "
        "(last at 0.0 s, expected at 9 s), was picked up by robot1 at 0.0 s, was delivered by "
        "robot1 at 10.0 s."
    )
    assert errands.story(1, hall, late).endswith(
        "it was given to robot2 (last at 6.0 s, expected at 130 s), was picked up by robot2 at "
        "8.0 s, had not been delivered when the run ended at 10.0 s."
    )


def test_a_task_that_nobody_had_is_told_too(hall, hall_trace):
    assert errands.story(1, hall, hall_trace).endswith(
        "120.0 s: it had not been picked up when the run ended at 10.0 s."
    )


def test_tasks_are_read_from_a_verdict_and_lead_to_their_robots(hall, late):
    verdict = Verdict(
        spec="deadlines", robustness=-1.0, violated=True, who=("task1", "robot1", "task10", "task0")
    )
    assert errands.tasks_of(verdict) == [1, 10, 0]
    assert errands.robots_of([1, 10, 0], late) == ["robot2", "robot1"]
    assert len(errands.stories([1, 10, 0], hall, late)) == 2  # the world has no task10


def test_many_tasks_are_counted_instead_of_told(hall, late):
    told = errands.stories([0] * 9, hall, late)
    assert len(told) == errands.MAX_SENTENCES + 1
    assert told[-1] == "3 further tasks."
