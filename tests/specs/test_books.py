"""What counts as picked up and delivered, and what is refused and why."""

import dataclasses

import numpy as np
import pytest
from frames import Robot, Script, drive

from mrta_falsify.core.codec import encode
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import StackEvent, Tells
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.registry import build
from mrta_falsify.core.world import Task
from mrta_falsify.specs.books import Books

SERVICE = 2.0  # s
ALL_TOLD = Tells()
NEEDY = ("all_tasks_done", "deadlines", "no_starvation", "honest_events")


def event(time, kind, task=0, robot=0, **more):
    return StackEvent(time=time, kind=kind, task=task, robot=robot, **more)


UP, DOWN = event(3.0, "picked-up"), event(13.0, "dropped-off")


def errand(*events, **more) -> Script:
    """Robot 1 stands in room 0, drives to room 1 from 5 to 11 s and stays; robot 2 stands there."""

    def told(tick):
        return tuple(e for e in events if abs(e.time - tick * 0.05) < 0.02)

    task = Task(
        arrival=1.0, start=0, end=1, deadline=20.0, pickup_time=SERVICE, dropoff_time=SERVICE
    )
    values = {
        "robots": [Robot(drive((0, 0), (6, 0), 1.0, leave=5.0)), Robot((6.0, 0.8))],
        "rooms": [(0.0, 0.0), (6.0, 0.0)],
        "tasks": [task] * 4,
        "stack_events": told,
        "seconds": 16.0,
        "horizon": 16.0,
        **more,
    }
    return Script(**values)


def kept(script: Script, **changes) -> Books:
    world = dataclasses.replace(script.world(), **changes)
    books = Books(world)
    for frame in script.frames(world):
        books.update(frame.sensed, frame.events)
    return books


def reasons(script: Script, **changes) -> list[str]:
    return [row.reason for row in kept(script, **changes).refused.rows]


def judged(name: str, script: Script, tells: Tells = ALL_TOLD):
    specification, world = build("specification", Choice(name)), script.world()
    specification.start(world, 0.05)
    for frame in script.frames(world):
        specification.update(dataclasses.replace(frame, tells=tells))
    return specification.verdict()


def test_what_is_claimed_and_was_done_is_in_the_books():
    books = kept(errand(UP, DOWN))
    assert books.picked == {0: pytest.approx(3.0)}
    assert books.delivered == {0: pytest.approx(13.0)}
    assert (books.open, books.refused.rows) == ((1, 2, 3), [])


def test_a_claim_counts_at_the_tick_that_brings_it_whatever_it_says():
    early = [dataclasses.replace(UP, time=0.0), dataclasses.replace(DOWN, time=0.0)]

    def told(tick):
        return tuple(e for e, at in zip(early, (60, 260), strict=True) if tick == at)

    assert kept(errand(stack_events=told)).delivered == {0: pytest.approx(13.0)}


@pytest.mark.parametrize(
    ("claims", "reason"),
    [
        ([event(3.0, "picked-up", robot=1)], "elsewhere: 6.1 m from room0"),
        ([UP, event(4.0, "dropped-off")], "elsewhere: 6.0 m from room1"),
        ([UP, event(10.5, "dropped-off")], "moving: at 1.00 m/s"),
        ([event(2.0, "picked-up")], "not long enough: 1.0 s of 2.0 s"),
        ([UP, event(12.5, "dropped-off")], "not long enough: 1."),
        ([DOWN], "the robot has not picked it up"),
        ([UP, event(13.0, "dropped-off", robot=1)], "the robot has not picked it up"),
        ([event(0.5, "picked-up")], "the task has not arrived"),
        ([event(3.0, "picked-up", robot=7)], "there is no robot number 7"),
        ([event(3.0, "picked-up", robot=-1)], "there is no robot number -1"),
        ([event(3.0, "picked-up", task=4)], "there is no task number 4"),
        ([event(3.0, "picked-up", resource="room1")], "it names room1, the task's room is room0"),
        ([UP, event(4.5, "picked-up")], "it has been picked up already"),
        ([UP, DOWN, event(15.5, "dropped-off")], "it has been delivered already"),
        ([UP, DOWN, event(15.5, "picked-up")], "it has been delivered already"),
    ],
)
def test_a_claim_that_motion_contradicts_is_refused_with_its_reason(claims, reason):
    (found,) = reasons(errand(*claims))
    assert found.startswith(reason)


def test_each_service_takes_its_own_time():
    second = event(4.0, "picked-up", task=1)
    assert reasons(errand(UP, second)) == ["not long enough: 1.0 s of 2.0 s"]
    assert reasons(errand(UP, event(5.0, "picked-up", task=1))) == []


def test_a_robot_carries_no_more_than_it_can():
    still = errand(
        *(event(3.0 + 2.0 * i, "picked-up", task=i) for i in range(3)),
        robots=[Robot((0.0, 0.0)), Robot((6.0, 0.8))],
    )
    assert reasons(still) == ["over capacity: 2 aboard, room for 2"]


def test_a_robot_that_has_not_joined_serves_nothing():
    late = tuple(dataclasses.replace(r, joins_at=4.0) for r in errand().world().robots)
    assert reasons(errand(UP), robots=late) == ["the robot has not joined"]


def test_a_robot_that_creeps_through_the_room_is_not_at_rest():
    tasks = [dataclasses.replace(task, pickup_time=7.0) for task in errand().tasks]
    robots = [Robot(drive((-0.9, 0), (0.9, 0), 0.12)), Robot((6.0, 0.8))]
    creeping = errand(event(9.0, "picked-up"), robots=robots, tasks=tasks)
    (reason,) = reasons(creeping)
    assert reason.startswith("not long enough: ")


def test_a_robot_that_steps_back_from_a_person_is_still_at_rest():
    def dodging(time):
        return (0.0, 0.2 * np.sin(3.0 * min(time, 3.0 / 3.0 * np.pi)), 0.0)

    tasks = [dataclasses.replace(task, pickup_time=4.0) for task in errand().tasks]
    robots = [Robot(dodging), Robot((6.0, 0.8))]
    assert reasons(errand(event(5.0, "picked-up"), robots=robots, tasks=tasks)) == []


def test_a_robot_that_is_shoved_while_it_loads_loses_no_time():
    def shoved(time):
        return (1.5 * min(max(time - 2.6, 0.0), 0.5), 0.0, 0.0)

    script, touched = errand(UP, robots=[Robot(shoved), Robot((6.0, 0.8))]), np.zeros((2, 3), bool)
    touched[0, 1] = True
    world = script.world()
    books = {True: Books(world), False: Books(world)}
    for frame in script.frames(world):
        at_it = 2.6 <= frame.sensed.time <= 3.2  # it loads until 3 s
        contact = touched if at_it else frame.sensed.contact
        sensed = dataclasses.replace(frame.sensed, contact=contact)
        books[True].update(sensed, frame.events)
        books[False].update(frame.sensed, frame.events)
    assert books[True].picked == {0: pytest.approx(3.0)}
    assert books[False].picked == {}


def test_nothing_is_served_through_a_wall():
    wall = rectangle(0.1, 4.0, (0.45, 0.0))
    robot = Robot((0.8, 0.0))
    refused = reasons(errand(UP, robots=[robot, Robot((6.0, 0.8))], walls=[wall]))
    assert refused == ["a wall stands between the robot and room0"]
    assert reasons(errand(UP, robots=[robot, Robot((6.0, 0.8))])) == []


def test_a_claim_repeated_every_tick_is_refused_once():
    script = errand(stack_events=lambda tick: (event(tick * 0.05, "dropped-off"),))
    assert reasons(script) == ["the task has not arrived", "the robot has not picked it up"]


def test_a_task_that_arrives_after_the_horizon_is_not_due():
    tasks = [
        dataclasses.replace(t, arrival=a)
        for t, a in zip(errand().tasks, (1, 16, 17, 99), strict=True)
    ]
    assert kept(errand(tasks=[dataclasses.replace(t, deadline=200.0) for t in tasks])).due == {0, 1}


def test_robots_are_finished_when_nothing_open_is_theirs():
    assert kept(errand(UP, DOWN)).robots_finished() == 0  # three tasks nobody was given
    given = [event(1.0, "assigned", task=i, robot=0) for i in range(4)]
    assert kept(errand(*given, UP, DOWN)).robots_finished() == 1
    only = errand().tasks[:1]
    assert kept(errand(UP, DOWN, tasks=only)).robots_finished() == 2
    assert kept(errand(UP, tasks=only)).robots_finished() == 1


def test_an_undelivered_task_is_a_violation_though_it_was_claimed():
    verdict = judged("all_tasks_done", errand(UP, DOWN, event(15.5, "dropped-off", task=1)))
    assert verdict.who == ("task1", "task2", "task3")
    (claim,) = verdict.evidence["claims_refused"]
    assert claim["reason"] == "the robot has not picked it up"


def test_a_refused_delivery_is_late():
    lied = errand(UP, event(4.0, "dropped-off"), seconds=25.0, horizon=30.0)
    assert "task0" in judged("deadlines", lied).who


# --- honest_events ----------------------------------------------------------------------------


def test_a_stack_that_tells_the_truth_is_honest():
    given = event(1.0, "assigned")
    missed = event(15.0, "deadline-missed", task=1)
    tasks = [dataclasses.replace(task, deadline=14.0) for task in errand().tasks]
    script = errand(event(0.0, "joined", task=-1), given, UP, DOWN, missed, tasks=tasks)
    verdict = judged("honest_events", script)
    assert (verdict.outcome, verdict.robustness) == ("holds", 1.0)


def test_each_claim_is_in_the_evidence_with_time_robot_task_room_and_reason():
    lies = [UP, event(4.0, "dropped-off"), event(10.0, "dropped-off", robot=1)]
    verdict = judged("honest_events", errand(*lies))
    assert (verdict.robustness, verdict.violated_at) == (-2.0, pytest.approx(4.0))
    assert verdict.who == ("robot1", "robot2")
    assert verdict.evidence["claims"] == [
        {
            "time": pytest.approx(4.0),
            "kind": "dropped-off",
            "task": 0,
            "robot": "robot1",
            "room": "room1",
            "reason": "elsewhere: 6.0 m from room1",
        },
        {
            "time": pytest.approx(10.0),
            "kind": "dropped-off",
            "task": 0,
            "robot": "robot2",
            "room": "room1",
            "reason": "the robot has not picked it up",
        },
    ]
    encode(verdict)


@pytest.mark.parametrize(
    ("lie", "reason"),
    [
        (event(0.5, "assigned"), "the task has not arrived"),
        (event(2.0, "assigned", robot=9), "there is no robot number 9"),
        (event(2.0, "allocated", task=9, robot=-1), "there is no task number 9"),
        (event(2.0, "deadline-missed", robot=-1), "the deadline is at 20 s"),
    ],
)
def test_other_events_that_geometry_or_the_world_contradicts(lie, reason):
    verdict = judged("honest_events", errand(lie))
    assert [claim["reason"] for claim in verdict.evidence["claims"]] == [reason]


def test_a_robot_cannot_have_joined_before_its_time():
    script = errand(event(2.0, "joined", task=-1))
    late = tuple(dataclasses.replace(r, joins_at=4.0) for r in script.world().robots)
    world = dataclasses.replace(script.world(), robots=late)
    specification = build("specification", Choice("honest_events"))
    specification.start(world, 0.05)
    for frame in script.frames(world):
        specification.update(frame)
    assert specification.verdict().evidence["claims"][0]["reason"] == "it joins at 4 s"


def test_an_event_dated_to_another_moment_is_not_honest():
    def told(tick):
        return (dataclasses.replace(UP, time=0.0),) if tick == 60 else ()

    verdict = judged("honest_events", errand(stack_events=told))
    assert [c["reason"] for c in verdict.evidence["claims"]] == ["misdated: it says 0.0 s"]


# --- what is not told -------------------------------------------------------------------------


@pytest.mark.parametrize("name", NEEDY)
def test_without_deliveries_nothing_is_judged_that_needs_them(name):
    verdict = judged(name, errand(), Tells(deliveries=False))
    assert verdict.outcome == "not_judged"
    assert verdict.not_judged == "the stack does not tell its deliveries"


@pytest.mark.parametrize("name", ["no_livelock", "progress", "no_starvation"])
def test_without_goals_nothing_is_judged_that_needs_them(name):
    verdict = judged(name, errand(), Tells(goals=False))
    assert verdict.not_judged == "the stack does not tell its goals"


def test_what_motion_alone_shows_is_judged_all_the_same():
    nothing = Tells(deliveries=False, goals=False, paths=False)
    for name in ("kinematic_limits", "exclusive_use", "no_robot_robot_contact"):
        assert judged(name, errand(), nothing).outcome != "not_judged"


def test_a_formula_over_goals_is_not_judged_without_them():
    formula = Choice("stl", {"formula": "always (tasks_left < 5)"})
    specification, script = build("specification", formula), errand()
    world = script.world()
    specification.start(world, 0.05)
    for frame in script.frames(world):
        specification.update(dataclasses.replace(frame, tells=Tells(goals=False)))
    assert specification.verdict().outcome == "not_judged"
