"""What is a deadlock and what only looks like one."""

import dataclasses
import itertools

import numpy as np
import pytest
from frames import (
    DT,
    Human,
    Robot,
    Script,
    corridor,
    drive,
    judge,
    offer,
    room_resource,
    stop_at,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from mrta_falsify.core.fleet import Tells
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage, CommsOutage, Task
from mrta_falsify.specs.deadlock.oracle import NoDeadlock
from mrta_falsify.specs.deadlock.progress_clock import ProgressClock
from mrta_falsify.specs.deadlock.watches import ContinuationWatch, Question


def oracle(**options):
    return NoDeadlock(NoDeadlock.Options(**options))


def head_on(**more) -> Script:
    """Two robots meet in a corridor 1 m wide at time 3 and stay there."""
    return Script(
        robots=[
            Robot(stop_at(drive((-3, 0), (5, 0), 0.9), 3.0), goal=(5, 0)),
            Robot(stop_at(drive((3, 0), (-5, 0), 0.9), 3.0), goal=(-5, 0)),
        ],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
        **more,
    )


def queue_cycle(count: int = 3) -> Script:
    """``count`` robots on a ring, each bound for the place of the next one."""
    angle = 2 * np.pi * np.arange(count) / count
    radius = 0.62 / (2 * np.sin(np.pi / count))
    points = [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angle]
    return Script(
        robots=[Robot(points[i], goal=points[(i + 1) % count]) for i in range(count)],
        walls=[rectangle(0.1, 0.1, (4.0, 4.0))],
    )


# --- what cannot be copied: suspected at most --------------------------------------------------


def suspicion(script: Script) -> Verdict:
    """Verdict on a script of at least 40 s; violated it never is without a forecast."""
    script.seconds = max(script.seconds, 40.0)
    verdict = judge(oracle(), script)
    assert not verdict.violated
    return verdict


def is_suspected(verdict: Verdict) -> bool:
    return verdict.outcome == "not_judged" and not verdict.evidence["confirmed"]


def test_head_on_robots_that_cannot_be_copied_are_suspected_after_half_a_minute_and_no_failure():
    early, late = judge(oracle(), head_on(seconds=30.0)), suspicion(head_on())
    assert early.outcome == "holds"
    assert late.outcome == "not_judged"
    assert "suspected" in late.not_judged
    assert late.who == ("robot1", "robot2")
    assert late.robustness == 0.0
    assert not late.evidence["confirmed"]


def test_a_suspicion_is_dropped_once_a_robot_moves_on():
    script = head_on(seconds=45.0)
    there = drive((-0.3, 0), (-5, 0), 0.9, leave=40.0)
    first = script.robots[0].at
    script.robots[0].at = lambda t: first(t) if t < 40.0 else there(t)
    assert suspicion(script).outcome == "holds"


def test_evidence_names_cycle_and_place():
    evidence = suspicion(head_on(rooms=[(0.0, 1.0)])).evidence
    assert [edge["robot"] for edge in evidence["cycle"]] == ["robot1", "robot2"]
    assert [edge["blocked_by"] for edge in evidence["cycle"]] == ["robot2", "robot1"]
    assert {edge["cause"] for edge in evidence["cycle"]} == {"barrier"}
    assert evidence["place"]["near"] == "room0"
    assert abs(evidence["place"]["x"]) < 0.1


def test_victims_behind_a_deadlock_are_not_members():
    script = head_on()
    script.robots = [
        *script.robots,
        Robot(stop_at(drive((-5, 0), (5, 0), 0.9), 4.4), goal=(5, 0)),
    ]
    verdict = suspicion(script)
    assert verdict.who == ("robot1", "robot2")
    assert verdict.evidence["victims"] == ["robot3"]
    assert [edge["robot"] for edge in verdict.evidence["chain"]] == ["robot3"]


def test_three_robots_in_a_ring_are_all_members():
    assert suspicion(queue_cycle(3)).who == ("robot1", "robot2", "robot3")


def test_four_robots_in_a_roundabout_are_all_members():
    assert len(suspicion(queue_cycle(4)).who) == 4


def test_doorway_with_two_robots_is_found():
    walls = [rectangle(0.2, 4.0, (0, 2.5)), rectangle(0.2, 4.0, (0, -2.5))]
    script = Script(
        robots=[Robot((-0.35, 0), goal=(3, 0)), Robot((0.35, 0), goal=(-3, 0))],
        walls=walls,
        bounds=(-4.0, -4.5, 4.0, 4.5),
    )
    assert suspicion(script).who == ("robot1", "robot2")


def test_slow_robots_that_move_are_no_deadlock():
    script = Script(
        robots=[
            Robot(drive((-3, 0), (5, 0), 0.04), goal=(5, 0)),
            Robot(drive((-3.8, 0), (4.2, 0), 0.04), goal=(5, 0)),
        ],
        walls=corridor(),
        seconds=60.0,
    )
    assert suspicion(script).outcome == "holds"


def test_jitter_on_the_spot_is_no_progress():
    def shake(x):
        return lambda t: (x + 0.03 * np.sin(9 * t), 0.03 * np.cos(7 * t), 0.4 * np.sin(5 * t))

    script = Script(
        robots=[Robot(shake(-0.35), goal=(5, 0)), Robot(shake(0.35), goal=(-5, 0))],
        walls=corridor(),
    )
    assert is_suspected(suspicion(script))


def test_turning_on_the_spot_for_ever_is_no_progress():
    script = head_on(seconds=60.0)
    first = script.robots[0].at
    script.robots[0].at = lambda t: (*first(t)[:2], max(0.0, t - 3.0) * 0.5)
    assert is_suspected(suspicion(script))


def test_waiting_for_a_person_who_moves_is_no_deadlock():
    def swaying(time):
        return (0.8, 0.3 * np.sin(time))

    script = Script(robots=[Robot((0, 0), goal=(5, 0))], humans=[Human(swaying)])
    assert suspicion(script).outcome == "holds"


def test_a_person_who_stands_as_long_as_the_robot_is_suspected_with_it():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0))],
        humans=[Human((0.8, 0), route=[(0.8, 0)])],
        walls=corridor(),
        bounds=(-6.0, -2.0, 6.0, 2.0),
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1",)
    assert verdict.evidence["objects"] == [{"name": "human0", "kind": "person", "carried_by": ""}]


def test_waiting_for_a_task_is_no_deadlock():
    script = Script(robots=[Robot((0, 0)), Robot((0.6, 0))], seconds=60.0)
    verdict = suspicion(script)
    assert verdict.outcome == "holds"
    assert verdict.robustness == pytest.approx(30.0)


def test_time_without_a_goal_is_not_held_against_a_robot():
    def late(t):
        return (4.0, 0.0) if t >= 20.0 else (np.nan, np.nan)

    script = Script(
        robots=[Robot((0, 0), goal=late), Robot((0.62, 0))],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
        seconds=60.0,
    )
    assert suspicion(script).evidence["onset"] == pytest.approx(20.0, abs=2.0)


def test_a_robot_that_another_keeps_off_its_room_is_not_being_served():
    def script(distance: float) -> Script:
        return Script(
            robots=[Robot((-distance, 0), goal=(0, 0)), Robot((0.6 - distance, 0))],
            rooms=[(0.0, 0.0)],
            tasks=[LONG_TASK],
            walls=corridor(),
            bounds=(-6.0, -0.7, 6.0, 0.7),
        )

    assert suspicion(script(0.5)).who == ("robot1",)
    assert suspicion(script(0.2)).outcome == "holds"


def test_a_halt_may_end_with_an_event_that_ends():
    def script(end: float) -> Script:
        return Script(
            robots=[Robot((0, 0), goal=(4, 0), no_path=True)],
            events=[
                Blockage(name="cart", polygon=rectangle(1.0, 1.0, (8.0, 8.0)), start=0.0, end=end)
            ],
        )

    assert is_suspected(suspicion(script(1e6)))
    assert suspicion(script(60.0)).outcome == "holds"


def test_turning_to_and_fro_on_one_spot_does_not_hide_a_deadlock():
    def swinging(t):
        return (-0.31, 0.0, 1.2 * np.sin(t))

    script = Script(
        robots=[Robot(swinging, goal=(4, 0)), Robot((0.31, 0), goal=(-4, 0))],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
        seconds=60.0,
    )
    assert suspicion(script).who == ("robot1", "robot2")


def test_goals_that_alternate_do_not_hide_a_deadlock():
    script = head_on()
    script.robots[0].goal = lambda t: (5.0, 0.0) if t % 2.0 < 1.0 else (4.0, 0.0)
    assert is_suspected(suspicion(script))


def test_a_robot_blocked_by_furniture_is_found_with_the_furniture():
    script = Script(
        robots=[Robot((0, 0), goal=(4, 0))],
        walls=corridor(),
        furniture=[rectangle(0.4, 1.0, (0.6, 0))],
        bounds=(-6.0, -0.7, 6.0, 0.7),
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1",)
    assert verdict.evidence["cycle"][0]["resource"] == "bed0"
    assert verdict.evidence["objects"] == [{"name": "bed0", "kind": "furniture", "carried_by": ""}]


def test_a_blockage_that_ends_before_the_horizon_is_no_deadlock():
    def script(end):
        return Script(
            robots=[Robot((0, 0), goal=(4, 0))],
            walls=corridor(),
            events=[
                Blockage(name="cart", polygon=rectangle(0.4, 1.0, (0.6, 0)), start=0.0, end=end)
            ],
            bounds=(-6.0, -0.7, 6.0, 0.7),
        )

    assert suspicion(script(200.0)).outcome == "holds"
    assert is_suspected(suspicion(script(900.0)))


def test_a_robot_cut_off_from_its_goal_is_found_without_a_path():
    script = Script(
        robots=[Robot((0, 0), goal=(4, 0), no_path=True)],
        walls=corridor(),
        furniture=[rectangle(0.4, 1.0, (2.0, 0))],
        bounds=(-6.0, -0.7, 6.0, 0.7),
    )
    verdict = suspicion(script)
    assert is_suspected(verdict)
    assert verdict.evidence["cycle"][0]["cause"] == "no-path"


def test_no_path_because_of_a_waiting_robot_leads_to_that_robot():
    script = Script(
        robots=[Robot((0, 0), goal=(4, 0), no_path=True), Robot((2, 0))],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1",)
    assert verdict.evidence["blockers"] == ["robot2"]


def test_an_outage_that_ends_is_no_deadlock():
    script = Script(
        robots=[Robot((0, 0), goal=(4, 0))],
        events=[CommsOutage(name="out", robots=(), start=0.0, end=60.0)],
    )
    assert suspicion(script).outcome == "holds"
    script.seconds = 90.0
    assert is_suspected(suspicion(script))


SPOTS = [(2.0, 0.0), (3.0, 0.0), (4.0, 0.0)]
TASK = Task(arrival=0.0, start=0, end=0, deadline=800.0, pickup_time=20.0)
LONG_TASK = dataclasses.replace(TASK, pickup_time=60.0)


def test_queueing_for_a_robot_that_is_served_is_no_deadlock():
    script = Script(
        robots=[Robot((0, 0), goal=(0, 0)), Robot((2, 0), goal=(2, 0)), Robot((3, 0), goal=(3, 0))],
        rooms=[(0.0, 0.0)],
        resources=[room_resource(0, (0.0, 0.0), SPOTS)],
        tasks=[LONG_TASK],
    )
    assert suspicion(script).outcome == "holds"


def test_queueing_behind_a_robot_that_parks_in_the_room_is_a_deadlock():
    script = Script(
        robots=[Robot((0, 0)), Robot((2, 0), goal=(2, 0)), Robot((3, 0), goal=(3, 0))],
        rooms=[(0.0, 0.0)],
        resources=[room_resource(0, (0.0, 0.0), SPOTS)],
        tasks=[TASK],
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot2",)
    assert verdict.evidence["blockers"] == ["robot1"]
    assert verdict.evidence["victims"] == ["robot3"]


def test_a_leaving_holder_and_the_waiter_in_its_way_are_a_deadlock():
    script = Script(
        robots=[Robot((1.35, 0), goal=(8, 0)), Robot((2, 0), goal=(2, 0))],
        rooms=[(0.0, 0.0)],
        resources=[room_resource(0, (0.0, 0.0), SPOTS)],
        walls=corridor(1.0, 16.0),
        bounds=(-8.0, -0.7, 9.0, 0.7),
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1", "robot2")
    assert {edge["cause"] for edge in verdict.evidence["cycle"]} == {"barrier", "queue"}


def test_a_forgotten_waiter_is_found_later():
    script = Script(
        robots=[Robot((2, 0), goal=(2, 0))],
        rooms=[(0.0, 0.0)],
        resources=[room_resource(0, (0.0, 0.0), SPOTS)],
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1",)
    assert verdict.evidence["cycle"][0]["cause"] == "stalled"


def test_followers_that_wait_for_a_boxed_in_leader_are_victims():
    script = Script(
        robots=[Robot((0, 0), goal=(4, 0)), Robot((-1.5, 0), goal=(-5, 0))],
        walls=corridor(),
        furniture=[rectangle(0.4, 1.0, (0.6, 0))],
        bounds=(-6.0, -0.7, 6.0, 0.7),
    )
    verdict = suspicion(script)
    assert verdict.who == ("robot1",)
    assert verdict.evidence["victims"] == ["robot2"]


def test_followers_wait_while_their_leader_drives():
    script = Script(
        robots=[Robot(drive((-9, 2), (9, 2), 0.4), goal=(9, 2)), Robot((0, 0), goal=(-5, 0))],
        seconds=44.0,
        bounds=(-10.0, -3.0, 10.0, 3.0),
    )
    assert suspicion(script).outcome == "holds"


def test_longer_standstill_is_less_robust_but_no_failure_before_it_is_confirmed():
    margins = [judge(oracle(), head_on(seconds=s)).robustness for s in (2.0, 6.0, 12.0, 19.0, 30.0)]
    assert all(a > b for a, b in itertools.pairwise(margins))
    assert 0.0 < margins[-1] < 0.2 * margins[0]


def test_where_the_stack_tells_no_goals_nothing_is_judged():
    world, judged = head_on().world(), oracle()
    judged.start(world, DT)
    for frame in head_on(seconds=40.0).frames(world):
        judged.update(dataclasses.replace(frame, tells=Tells(goals=False)))
    verdict = judged.verdict()
    assert verdict.outcome == "not_judged"
    assert "going" in verdict.not_judged
    assert not verdict.evidence


@settings(max_examples=12, deadline=None)
@given(order=st.permutations(range(3)), seconds=st.sampled_from([3.0, 6.5, 9.0]))
def test_renaming_and_reordering_robots_does_not_change_robustness(order, seconds):
    script = queue_cycle(3)
    script.seconds = seconds
    script.robots = [*script.robots, Robot((-3, -3), goal=(9, -3))][:3]
    plain = judge(oracle(), script)
    names = [f"robot{i + 1}" for i in range(3)]
    script.robots = [script.robots[i] for i in order]
    script.names = [names[i] for i in order]
    moved = judge(oracle(), script)
    assert moved.robustness == plain.robustness
    assert sorted(moved.who) == sorted(plain.who)


@settings(max_examples=8, deadline=None)
@given(dx=st.integers(-40, 40), dy=st.integers(-40, 40))
def test_shifting_the_map_does_not_change_robustness(dx, dy):
    def shifted(x, y):
        return Script(
            robots=[
                Robot((x - 0.34, y), goal=(x + 5, y)),
                Robot((x + 0.34, y), goal=(x - 5, y)),
            ],
            walls=[wall + np.array([x, y]) for wall in corridor()],
            bounds=(x - 6.0, y - 0.7, x + 6.0, y + 0.7),
            seconds=8.0,
        )

    here = judge(oracle(), shifted(0.0, 0.0))
    there = judge(oracle(), shifted(dx * 0.5, dy * 0.5))
    assert there.robustness == here.robustness
    assert there.who == here.who


# --- with forecasts --------------------------------------------------------------------------


def foretold(script: Script, fate, *, is_outside: bool = False, **options) -> NoDeadlock:
    """The oracle over ``script`` when forecasts answer ``fate(watch, without, nudge)``."""
    world, judged = script.world(), oracle(**options)
    judged.start(world, DT)
    offer(
        judged,
        world,
        lambda watch, *, without=(), nudge=0, to_come=False: fate(watch, *without or (-1,), nudge),
        is_outside=is_outside,
    )
    for frame in script.frames(world):
        judged.update(frame)
    return judged


def shown(stuck=None, freed=None, *, edges=(), soon=None) -> dict:
    """The answer of a continuation: last progress of the stuck, first progress of the others."""
    return {
        "stuck": {str(i): at for i, at in (stuck or {}).items()},
        "freed": {str(i): at for i, at in (freed or {}).items()},
        "edges": [
            {"robot": robot, "cause": cause, "other": other, "resource": ""}
            for robot, cause, other in edges
        ],
        "soon": {str(i): at for i, at in (soon or {}).items()},
    }


def test_who_makes_progress_in_the_continuation_of_another_robot_is_not_asked_about():
    def asked_at(soon):
        asked = []

        def fate(watch, without, nudge):
            asked.append(watch)
            return shown(freed={0: 28.0}, soon=soon)

        foretold(head_on(), fate)
        return len(asked)

    assert asked_at({0: 28.0, 1: 28.0}) < asked_at({0: 28.0})


def behind_one_in_service(*, no_path: bool) -> list[float]:
    """When it is asked about a robot that stands behind one that is served for 20 s."""
    asked = []
    script = Script(
        robots=[
            Robot((-1.0, 0.0), goal=(5.0, 0.0), no_path=no_path),
            Robot((0.0, 0.0), goal=(0.0, 0.0)),
        ],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
        rooms=[(0.0, 0.0)],
        tasks=[Task(arrival=0.0, start=0, end=0, deadline=800.0, pickup_time=20.0)],
        seconds=15.0,
    )

    def fate(watch, without, nudge):
        asked.append(watch.question.time)
        return shown(freed={0: 25.0, 1: 20.0})

    foretold(script, fate)
    return asked


def test_who_stands_behind_one_in_service_is_asked_about_before_that_ends_if_it_has_no_path():
    assert not behind_one_in_service(no_path=False)
    assert behind_one_in_service(no_path=True)[0] < 6.0


def test_no_copies_vote_on_a_stuck_robot_that_nobody_asked_about():
    nudges = []

    def fate(watch, without, nudge):
        nudges.append(nudge)
        return shown({2: 0.0}, freed={0: 28.0, 1: 28.0})

    script = head_on()
    script.robots = [*script.robots, Robot((-5.0, 0.0))]
    verdict = foretold(script, fate).verdict()
    assert not verdict.violated
    assert nudges
    assert not any(nudges)


def test_a_set_that_a_forecast_shows_to_go_on_is_no_deadlock_however_long_it_lasts():
    asked = []

    def fate(watch, without, nudge):
        asked.append(without)
        return shown(freed={0: 28.0, 1: 29.0})

    verdict = foretold(head_on(), fate).verdict()
    assert verdict.outcome == "holds"
    assert verdict.robustness > 0.0
    assert len(asked) < 6  # at first, and once they should have gone on


def test_a_set_that_a_forecast_shows_to_stay_is_found_at_once_with_its_members():
    def fate(watch, without, nudge):
        if without < 0:
            return shown({0: 3.0, 1: 3.0})
        return {"freed": [1 - without]}

    verdict = foretold(head_on(), fate).verdict()
    assert verdict.who == ("robot1", "robot2")
    assert 3.0 < verdict.violated_at < 6.0
    assert verdict.evidence["confirmed"]
    assert verdict.evidence["onset"] == pytest.approx(3.0, abs=0.3)


def test_the_first_member_by_onset_is_the_root_and_edges_are_those_at_the_end():
    def fate(watch, without, nudge):
        if without < 0:
            return shown({0: 3.0, 1: 2.0}, edges=[(0, "barrier", 1), (1, "queue", 0)])
        return {"freed": [1 - without]}

    evidence = foretold(head_on(), fate).verdict().evidence
    assert evidence["members"] == ["robot2", "robot1"]
    assert evidence["root"] == "robot2"
    assert evidence["onsets"] == {"robot1": 3.0, "robot2": 2.0}
    assert [(edge["robot"], edge["cause"], edge["blocked_by"]) for edge in evidence["cycle"]] == [
        ("robot1", "barrier", "robot2"),
        ("robot2", "queue", "robot1"),
    ]


def test_who_goes_free_without_one_robot_while_that_one_stays_put_is_its_victim():
    def fate(watch, without, nudge):
        if without < 0:
            return shown({0: 3.0, 1: 3.0})
        return {"freed": [1] if without == 0 else []}

    verdict = foretold(head_on(), fate).verdict()
    assert verdict.who == ("robot1",)
    assert verdict.evidence["victims"] == ["robot2"]


def members_of_a_ring(freed_without_0=(), *, is_outside=False) -> set[str]:
    """Members where two robots wait for each other by the edges."""
    edges = [(0, "queue", 1), (1, "queue", 0)]

    def fate(watch, without, nudge):
        if without < 0:
            return shown({0: 3.0, 1: 3.0}, edges=edges)
        rows = shown(edges=edges)["edges"]
        return {"freed": list(freed_without_0) if without == 0 else [], "edges": rows, "nearer": []}

    return set(foretold(head_on(), fate, is_outside=is_outside).verdict().who)


def test_of_a_ring_that_no_removal_opens_all_are_members_if_the_stack_may_remember_locks():
    assert members_of_a_ring(is_outside=True) == {"robot1", "robot2"}
    assert members_of_a_ring((1,), is_outside=True) == {"robot1", "robot2"}


def test_a_free_robot_of_a_stack_outside_is_not_asked_about_at_every_look():
    asked = []

    def fate(watch, without, nudge):
        asked.append(watch)
        return shown(freed={0: 28.0, 1: 29.0})

    foretold(head_on(), fate, is_outside=True)
    assert len(asked) < 6  # at first, and once they should have gone on


def test_of_a_ring_that_a_removal_opens_on_one_side_the_other_robot_is_a_victim():
    assert members_of_a_ring((1,)) == {"robot1"}


def test_who_waits_for_one_that_still_makes_progress_is_asked_about_after_that():
    asked = []

    def fate(watch, without, nudge):
        asked.append(without if not nudge else f"copy {nudge}")
        if without < 0:
            return shown({0: 3.0, 1: 12.0}, edges=[(0, "barrier", 1), (1, "barrier", 0)])
        return {"freed": [1 - without]}

    verdict = foretold(head_on(), fate).verdict()
    assert verdict.who == ("robot1", "robot2")
    assert 12.0 <= verdict.violated_at < 14.0
    # Before, one question is enough: without the robot that gets stuck later, the other goes on.
    assert asked == [-1, 1, -1, "copy 1", "copy 2", 0, 1]


def test_a_forecast_is_forgotten_once_something_comes_from_outside():
    def judged(arrival: float):
        task = Task(arrival=arrival, start=0, end=0, deadline=800.0)
        script = head_on(tasks=[task], rooms=[(9.0, 9.0)])
        world, judged = script.world(), oracle()
        judged.start(world, DT)
        now = [0.0]

        def forecast(watch, *, without=(), nudge=0):
            if without:
                return {"freed": [1 - without[0]]}
            return shown({0: 3.0, 1: 3.0}) if now[0] >= arrival else shown(freed={0: 50.0, 1: 50.0})

        offer(judged, world, forecast)
        for frame in script.frames(world):
            now[0] = frame.sensed.time
            judged.update(frame)
        return judged.verdict()

    assert judged(20.0).violated_at == pytest.approx(20.0, abs=0.3)
    assert not judged(500.0).violated


def test_who_goes_free_late_in_the_run_itself_is_not_stuck_and_no_copies_vote():
    nudges = []

    def fate(watch, without, nudge):
        nudges.append(nudge)
        return shown(freed={0: 190.0, 1: 190.0})

    assert not foretold(head_on(), fate).verdict().violated
    assert set(nudges) == {0}


def test_who_stays_on_a_balance_is_stuck_unless_most_of_several_copies_go_free():
    def judged(nudged):
        def fate(watch, without, nudge):
            if without >= 0:
                return {"freed": [1 - without]}
            return nudged if nudge else shown({0: 3.0, 1: 3.0})

        return foretold(head_on(seconds=8.0), fate).verdict()

    assert judged(shown({0: 3.0, 1: 3.0})).who == ("robot1", "robot2")
    assert not judged(shown(freed={0: 40.0, 1: 40.0})).violated


def test_whom_most_copies_free_is_asked_about_again_halfway_to_what_they_foretell():
    asked_at: dict[float, set[int]] = {}

    def fate(watch, without, nudge):
        if nudge:
            return shown(freed={0: 43.0, 1: 63.0})
        asked_at.setdefault(watch.question.time, set()).update(watch.question.queried)
        return shown({0: 3.0, 1: 3.0})

    assert not foretold(head_on(seconds=30.0), fate).verdict().violated
    together = [time for time, asked in asked_at.items() if asked == {0, 1}]
    first, second = together[:2]
    assert second == pytest.approx(0.5 * (first + 43.0), abs=0.3)
    assert len(asked_at) <= 3


def test_a_run_that_decides_alone_asks_no_other_copy():
    asked = []

    def fate(watch, without, nudge):
        asked.append((without, nudge))
        return shown({0: 3.0, 1: 90.0})  # the second one gets stuck later

    script = head_on(seconds=8.0)
    alone = foretold(script, fate, copies=1, members=False).verdict()
    assert alone.violated
    assert set(asked) == {(-1, 0)}
    assert alone.who == ("robot1",)


def test_an_engine_that_cannot_move_robots_leaves_it_to_the_first_continuation():
    def fate(watch, without, nudge):
        if without >= 0:
            return {"freed": [1 - without]}
        return None if nudge else shown({0: 3.0, 1: 3.0})

    assert foretold(head_on(seconds=8.0), fate).verdict().who == ("robot1", "robot2")


def test_who_stands_behind_a_person_is_asked_about_soon_even_a_restless_one():
    def found_at(person) -> float:
        def fate(watch, without, nudge):
            return shown({0: 3.0})

        script = Script(
            robots=[Robot(stop_at(drive((-3, 0), (5, 0), 0.9), 3.0), goal=(5, 0))],
            humans=[Human(person)],
            walls=corridor(),
            bounds=(-6.0, -0.7, 6.0, 0.7),
        )
        return foretold(script, fate).verdict().violated_at

    def to_and_fro(time):
        return (0.6, 0.4 * np.sin(2.0 * time))

    assert 2.0 < found_at((0.6, 0.0)) < 5.0
    assert 2.0 < found_at(to_and_fro) < 5.0


def test_who_moves_to_and_fro_on_one_place_is_asked_about_though_no_edge_shows_it_stuck():
    asked = []

    def fate(watch, without, nudge):
        asked.append(watch)
        return shown(freed={0: 1e3})

    def to_and_fro(time):
        return (0.3 * np.sin(1.5 * time), 0.0, 0.0)

    foretold(Script(robots=[Robot(to_and_fro, goal=(5, 0))], seconds=12.0), fate)
    assert asked


# --- when a forecast has seen enough ---------------------------------------------------------


def watched(robots, *, person_speed=None, asked=(0,), seconds=71.0, **more) -> tuple[float, dict]:
    """How long a forecast follows ``robots`` and a person of that speed [s], and its answer."""
    people = [] if person_speed is None else [Human((4.0, 4.0))]
    script = Script(robots=robots, humans=people, seconds=seconds, **more)
    world = script.world()
    question = Question(frozenset(asked), frozenset(), 0.0, settled=0.0, until=seconds - 1.0)
    watch = ContinuationWatch(ProgressClock(world), question, stride=5)
    for frame in script.frames(world):
        speed = 0.0 if person_speed is None else person_speed(frame.sensed.time)
        velocity = np.tile([speed, 0.0], (len(people), 1))
        moved = dataclasses.replace(frame.sensed, human_velocity=velocity)
        if watch.update(dataclasses.replace(frame, sensed=moved)):
            break
    return frame.sensed.time, watch.answer()


def primary_and_secondary(robot, **more) -> float:
    return watched([Robot(robot, goal=(5.0, 0.0))], **more)[0]


def test_a_forecast_of_which_nothing_is_proven_goes_on_to_its_bound():
    assert primary_and_secondary((0.0, 0.0)) == pytest.approx(70.0, abs=0.5)


@pytest.mark.parametrize("speed", [0.0002, 0.0013])
def test_a_robot_that_creeps_steadily_is_stuck(speed):
    _, answer = watched([Robot(drive((0, 0), (5, 0), speed), goal=(5.0, 0.0))], seconds=180.0)
    assert list(answer["stuck"]) == ["0"]


def test_a_robot_that_drives_slowly_but_steadily_is_free():
    _, answer = watched([Robot(drive((0, 0), (5, 0), 0.02), goal=(5.0, 0.0))])
    assert list(answer["freed"]) == ["0"]


def test_a_forecast_waits_for_a_service_that_is_longer_than_a_pause():
    task = Task(arrival=0.0, start=0, end=0, deadline=800.0, pickup_time=60.0)

    def leaves(time):
        return (0.0, 0.0, 0.0) if time < 60.0 else (0.9 * (60.0 - time), 0.0, 0.0)

    def then_waits(time):
        return (0.0, 0.0) if time < 60.0 else (-9.0, 0.0)

    behind = drive((2, 0), (0, 0), 0.5, leave=62.0)
    script = {
        "rooms": [(0.0, 0.0)],
        "resources": [room_resource(0, (0.0, 0.0), SPOTS)],
        "tasks": [task],
        "seconds": 90.0,
    }
    queue = Robot(behind, goal=lambda t: (2.0, 0.0) if t < 62.0 else (0.0, 0.0))
    _, answer = watched([Robot(leaves, goal=then_waits), queue], asked=(1,), **script)
    assert list(answer["freed"]) == ["1"]


def test_the_edges_of_a_forecast_are_those_at_its_end():
    comes = stop_at(drive((6, 0), (-5, 0), 0.9), 6.2)
    robots = [Robot((-0.2, 0), goal=(5, 0)), Robot(comes, goal=(-5, 0))]
    _, answer = watched(robots, walls=corridor(1.0, 16.0), bounds=(-8.0, -0.7, 8.0, 0.7))
    assert [(edge["robot"], edge["other"]) for edge in answer["edges"]] == [(0, 1), (1, 0)]


def test_a_later_question_is_answered_as_by_a_copy_of_its_own():
    """One watch goes on from question to question; others begin where they are asked."""
    robots = [
        Robot(stop_at(drive((-3, 0), (5, 0), 0.9), 3.0), goal=(5, 0)),
        Robot(drive((3, 2), (-5, 2), 0.2), goal=(-5, 2)),
        Robot(lambda time: (0.0, 4.0 + 0.1 * max(0.0, time - 20.0), 0.0), goal=(0, 9)),
    ]
    script = Script(robots=robots, seconds=60.0)
    world = script.world()
    frames = list(script.frames(world))

    def at(time: float) -> ProgressClock:
        progress = ProgressClock(world)
        for frame in frames[: round(time / DT) + 1]:
            if frame.sensed.tick % 5 == 0:
                progress.update(frame)
        return progress

    standing = None
    for asked, time in (({1}, 2.0), ({0, 2}, 5.0), ({1}, 6.0), ({2}, 10.0), ({2, 1}, 40.0)):
        question = Question(frozenset(asked), frozenset(), time, settled=time, until=55.0)
        alone = ContinuationWatch(at(time), question, stride=5)
        later = frames[round(time / DT) + 1 :]
        assert any(alone.update(frame) for frame in later)
        if standing is None:
            standing = ContinuationWatch(at(time), question, stride=5, series="one")
            rest, known = iter(later), False
        else:
            known = standing.resume(question)
        assert known or any(standing.update(frame) for frame in rest)
        told, expected = standing.answer(), alone.answer()
        for part in ("freed", "stuck"):
            assert told[part] == pytest.approx(expected[part]), (time, part)
