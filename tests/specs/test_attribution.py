"""Which layer the rules name, from hand-made verdicts and traces: a test for each rule."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core.fleet import BlockedBy, StackEvent
from mrta_falsify.core.trace import EdgeSpan, PathChange, Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.specs.attribution import blocked_time, guess

ROBOTS = ("robot1", "robot2", "robot3")


def trace_of(
    *,
    edges=(),
    path=((0.0, 0.0), (5.0, 0.0)),
    solids=(),
    events=(),
    came=(0.0, 0.0),
    goal=(5.0, 0.0),
):
    """A run of 40 s in which the robots stand at (0, 0), robot1 with a path ahead.

    Args:
        edges: causes and seconds for which robot1 was blocked.
        path: of robot1.
        solids: points that its rays hit.
        events: kind, robot, task and detail; those of queues are about the store.
        came: how far robot2 has come from where it started.
        goal: of robot2.
    """
    ticks = 401
    points = np.full((ticks, len(ROBOTS), 4, 2), np.inf)
    for k, point in enumerate(solids):
        points[:, 0, k] = point
    pose, goals = np.zeros((ticks, len(ROBOTS), 3)), np.zeros((ticks, len(ROBOTS), 2))
    pose[1:, 1, :2], goals[:, 1] = came, goal
    return Trace(
        world_digest="",
        dt=0.1,
        robots=ROBOTS,
        humans=("walker",),
        columns={
            "time": np.arange(ticks) * 0.1,
            "pose": pose,
            "goal": goals,
            "obstacle_points": points,
        },
        paths=(PathChange(tick=0, robot=0, points=np.array(path).reshape(-1, 2)),),
        events=tuple(
            StackEvent(
                time=1.0,
                kind=kind,
                robot=robot,
                task=task,
                detail=detail,
                resource="store" if kind == "granted" else "",
            )
            for kind, robot, task, detail in events
        ),
        edges=tuple(
            EdgeSpan(first=0, last=round(10 * seconds) - 1, edge=BlockedBy(0, cause))
            for cause, seconds in edges
        ),
        ended="decided",
        digest="",
    )


def stuck(*rows, members=("robot1",), **evidence):
    cycle = [dict(zip(("robot", "cause", "blocked_by"), r, strict=False)) for r in rows]
    evidence = {"members": list(members), "cycle": cycle, "chain": [], "onset": 30.0, **evidence}
    return violated("no_deadlock", *members, **evidence)


def violated(spec, *who, **evidence):
    return Verdict(
        spec=spec, robustness=-1.0, violated=True, violated_at=32.0, who=who, evidence=evidence
    )


def layer(verdict, **run):
    return guess((verdict,), trace_of(**run)).layer


# --- deadlocks -----------------------------------------------------------------------------


def test_robots_at_a_waiting_spot_of_a_free_room_are_the_queues_fault():
    place = {"x": 0.0, "y": 0.0, "near": "queue of ward_1", "distance": 0.1}
    assert layer(stuck(("robot1", "stalled"), place=place)) == "queue_policy"
    assert layer(stuck(("robot1", "queue"), place=place)) == "queue_policy"


def test_who_stands_with_way_left_to_drive_is_the_controllers_fault():
    place = {"x": 0.0, "y": 0.0, "near": "queue of ward_1", "distance": 1.3}
    assert layer(stuck(("robot1", "stalled"), place=place)) == "controller"


def test_who_stands_at_the_end_of_its_path_was_not_told_where_to_go_on_to():
    verdict = stuck(("robot1", "stalled"), place={"x": 0.0, "y": 0.0, "near": "", "distance": 9.0})
    assert layer(verdict, path=((-5.0, 0.0), (0.0, 0.0))) == "waypoint_generator"
    assert layer(verdict, path=()) == "waypoint_generator"


@pytest.mark.parametrize("cause", ["wall", "cluster"])
def test_what_stands_near_a_robot_without_way_left_does_not_matter(cause):
    verdict = stuck(("robot1", cause))
    assert layer(verdict, path=((-5.0, 0.0), (0.0, 0.0))) == "waypoint_generator"
    assert layer(verdict) != "waypoint_generator"


def test_robots_that_queue_behind_a_robot_held_by_a_post_do_not_make_it_the_queues_fault():
    """The showcase: robot1 holds the room and does not get past the door post."""
    chain = [
        {"robot": "robot2", "cause": "queue", "blocked_by": "robot1", "resource": "ward"},
        {"robot": "robot3", "cause": "queue", "blocked_by": "robot2", "resource": "ward"},
    ]
    verdict = stuck(("robot1", "wall"), victims=["robot2", "robot3"], chain=chain)
    assert layer(verdict, solids=[(0.4, 0.4)]) == "controller"


def test_a_path_through_a_solid_is_the_costmaps_fault_one_past_it_is_not():
    verdict = stuck(("robot1", "wall"))
    assert layer(verdict, solids=[(0.6, 0.05)]) == "costmap"
    assert layer(verdict, solids=[(0.6, 0.35)]) == "controller"
    behind = ((-5.0, 0.0), (0.0, 0.0), (0.0, 3.0))
    assert layer(verdict, path=behind, solids=[(-2.0, 0.0)]) == "controller"


def test_robots_that_all_wait_in_queues_are_the_queues_fault():
    rows = [("robot1", "queue", "robot2"), ("robot2", "queue", "robot1")]
    assert layer(stuck(*rows, members=("robot1", "robot2"))) == "queue_policy"


def test_a_robot_that_waits_where_it_closes_the_way_out_is_the_queues_fault():
    rows = [("robot1", "barrier", "robot2"), ("robot2", "queue", "robot1")]
    assert layer(stuck(*rows, members=("robot1", "robot2"))) == "queue_policy"


def test_a_holder_that_lets_the_waiting_robot_go_first_is_the_priority_rules_fault():
    rows = [("robot1", "cluster", "robot2"), ("robot2", "queue", "robot1")]
    assert layer(stuck(*rows, members=("robot1", "robot2"))) == "priority_rule"


@pytest.mark.parametrize(
    ("cause", "expected"),
    [("barrier", "controller"), ("cluster", "priority_rule"), ("no-path", "planner")],
)
def test_what_holds_the_root_decides(cause, expected):
    rows = [("robot1", cause, "robot2"), ("robot2", "barrier", "robot1")]
    verdict = stuck(*rows, members=("robot2", "robot1"), root="robot1")
    assert layer(verdict) == expected


# --- other violations ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (violated("exclusive_use", "robot1", "robot2"), "queue_policy"),
        (violated("no_robot_human_contact", "robot1", "walker"), "controller"),
        (violated("no_robot_robot_contact", "robot1", "robot2"), "controller"),
        (violated("kinematic_limits", "robot1"), "controller"),
        (violated("honest_events", claims=[{"kind": "dropped-off"}]), "dispatcher"),
        (violated("honest_events", claims=[{"kind": "released"}]), "queue_policy"),
        (violated("costly_calls"), "dispatcher"),
        (violated("stack_runs", kind="crash", layer="planner"), "planner"),
        (violated("stack_runs", kind="hang"), ""),
        (violated("repeatable", field="command"), "controller"),
        (violated("repeatable", field="intent.waypoint"), "waypoint_generator"),
    ],
)
def test_the_violation_itself_may_name_the_layer(verdict, expected):
    assert layer(verdict) == expected


def test_who_drives_through_a_room_that_it_was_not_let_into_was_led_there():
    overfull = violated("exclusive_use", resource="store", nearest=["robot1", "robot2"])
    first = ("granted", 0, -1, "")
    assert layer(overfull, events=[first], came=(9.0, 0.0), goal=(20.0, 0.0)) == "planner"
    assert layer(overfull, events=[first], came=(9.0, 0.0), goal=(9.0, 0.5)) == "queue_policy"
    assert layer(overfull, events=[first], goal=(20.0, 0.0)) == "queue_policy", "there all along"
    both = [first, ("granted", 1, -1, "")]
    assert layer(overfull, events=both, came=(9.0, 0.0), goal=(20.0, 0.0)) == "queue_policy"


def test_a_robot_that_touches_what_its_path_keeps_clear_of_left_the_path():
    touch = violated("no_robot_static_contact", "robot1")
    assert layer(touch, solids=[(0.3, 0.02)]) == "costmap"
    assert layer(touch, solids=[(0.1, 0.25)]) == "controller"


LATE = violated("deadlines", "task0")
GIVEN = ("assigned", 0, 0, "")


def test_a_task_that_no_one_was_given_was_left_out_or_never_asked_about():
    other = ("assigned", 1, 1, "")
    undone = violated("all_tasks_done", "task0")
    assert layer(undone, events=[other, ("allocated", -1, -1, "tasks arrived")]) == "dispatcher"
    left_out = ("allocated", -1, -1, "tasks arrived; task 0 has no robot")
    assert layer(undone, events=[other, left_out]) == "allocator"
    assert layer(undone, events=[("allocation-refused", -1, -1, "no plan")]) == "allocator"


def test_what_held_the_robot_of_a_late_task_up_longest_decides():
    run = {"edges": [("queue", 12.0), ("human", 5.0)], "events": [GIVEN]}
    assert layer(LATE, **run) == "queue_policy"


def test_a_late_task_whose_robot_was_hardly_held_up_points_nowhere():
    assert layer(LATE, edges=[("queue", 3.0)], events=[GIVEN]) == ""


def test_a_robot_that_drives_in_vain_with_nothing_in_its_way_is_not_controlled_well():
    assert layer(violated("no_livelock", "robot1", since=10.0)) == "controller"
    assert layer(violated("progress", "robot1"), edges=[("no-path", 20.0)]) == "planner"


def test_nothing_violated_points_nowhere():
    assert guess((), trace_of()).layer == ""


def test_a_robot_that_two_hold_at_once_is_blocked_once_and_each_robot_for_itself():
    def span(first, last, robot=0, cause="human"):
        return EdgeSpan(first=first, last=last, edge=BlockedBy(robot, cause))

    edges = (span(0, 99), span(50, 149), span(300, 309), span(0, 49, 1), span(0, 9, 0, "queue"))
    trace = dataclasses.replace(trace_of(), edges=edges)
    one, *_ = trace.robots
    assert blocked_time(trace, 1e9, [one]) == {
        "human": pytest.approx(160 * trace.dt),
        "queue": pytest.approx(10 * trace.dt),
    }
    cut = blocked_time(trace, 100 * trace.dt, [one])
    assert cut["human"] == pytest.approx(100 * trace.dt)
