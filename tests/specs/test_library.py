"""The shipped specifications on scripted runs."""

import numpy as np
import pytest
from frames import Human, Robot, Script, drive, judge, stop_at

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, UnknownNameError
from mrta_falsify.core.fleet import StackEvent
from mrta_falsify.core.world import Task
from mrta_falsify.specs.contacts import ContactCounter
from mrta_falsify.specs.library import (
    build_specifications,
    default_specifications,
    specification_choice,
    vote_specifications,
)


def spec(name: str, **options):
    return registry.build("specification", Choice(name, options))


def passing(distance: float, **more) -> Script:
    """A robot drives past a standing person at the given centre distance."""
    return Script(
        robots=[Robot(drive((-3, 0), (3, 0), 0.8), goal=(3, 0))],
        humans=[Human((0, distance))],
        seconds=8.0,
        **more,
    )


def stops(*rows: tuple[float, str, int, int]):
    """Stack events (time, kind, robot, task)."""

    def at(tick: int):
        now = tick * 0.05
        return tuple(
            StackEvent(time=time, kind=kind, robot=robot, task=task)
            for time, kind, robot, task in rows
            if abs(time - now) < 0.02
        )

    return at


def test_gap_to_a_person_is_the_robustness():
    verdict = judge(spec("no_robot_human_contact"), passing(0.9))
    assert verdict.robustness == pytest.approx(0.9 - 0.47, abs=0.01)
    assert verdict.evidence["nearest"]["speed"] == pytest.approx(0.8)
    assert verdict.evidence["between"] == ["robot1", "human0"]


def test_clearance_is_a_tenth_of_a_metre_stricter():
    near = passing(0.52)
    assert not judge(spec("no_robot_human_contact"), near).violated
    verdict = judge(spec("human_clearance"), near)
    assert verdict.robustness == pytest.approx(-0.05, abs=0.01)
    assert verdict.who == ("robot1", "human0")


def test_a_moving_robot_that_touches_a_person_is_to_blame():
    verdict = judge(spec("no_robot_human_contact"), passing(0.3))
    assert verdict.violated
    assert verdict.violated_at == pytest.approx(3.3, abs=0.1)
    assert verdict.evidence["contacts"] == 1


def test_a_person_who_walks_into_a_robot_at_rest_is_counted_apart():
    script = Script(
        robots=[Robot((0, 0))],
        humans=[Human(lambda t: (3.0 - 0.5 * min(t, 5.5), 0.0))],
        seconds=8.0,
    )
    verdict = judge(spec("no_robot_human_contact"), script)
    assert not verdict.violated
    assert verdict.evidence["at_rest"]["contacts"] == 1
    assert verdict.evidence["at_rest"]["narrowest"] < 0.0
    assert judge(spec("no_robot_human_contact", count_at_rest=True), script).violated


def test_a_robot_that_is_pushed_still_counts_as_at_rest():
    script = Script(
        robots=[Robot(lambda t: (-max(0.0, 0.5 * (t - 5.2)), 0.0, 0.0))],
        humans=[Human(lambda t: (3.0 - 0.5 * t, 0.0))],
        seconds=8.0,
        command=lambda t: np.zeros((1, 3)),
    )
    verdict = judge(spec("no_robot_human_contact"), script)
    assert not verdict.violated
    assert verdict.evidence["at_rest"]["contacts"] == 1


def met_by_a_person(at, *, meets: float, command=lambda t: np.zeros((1, 3)), away=None) -> Script:
    """A robot that a person at 0.5 m/s reaches at the time ``meets`` [s]."""

    def person(t: float) -> tuple[float, float]:
        back = 0.4 if away is not None and away[0] <= t < away[1] else 0.0
        return (0.465 + 0.5 * (meets - t) + back, 0.0)

    return Script([Robot(at)], [Human(person)], seconds=meets + 1.5, command=command)


def stands_since(time: float):
    """Drives on the spot's far side at 0.3 m/s along y until ``time``, at rest at the origin."""
    return lambda t: (0.0, -0.3 * max(0.0, time - t), 0.0)


@pytest.mark.parametrize(("ticks", "moves"), [(0, True), (1, True), (2, False), (3, False)])
def test_a_robot_moves_at_a_touch_if_it_did_in_that_tick_or_in_the_one_before(ticks, moves):
    touch = 3.0
    script = met_by_a_person(stands_since(touch - (ticks + 0.5) * 0.05), meets=touch - 0.02)
    verdict = judge(spec("no_robot_human_contact"), script)
    assert (verdict.violated, verdict.evidence["contacts"]) == (moves, int(moves))
    assert verdict.evidence["at_rest"]["contacts"] == 1 - moves


def test_a_robot_that_rolls_after_a_push_is_not_moving_when_it_is_touched_again():
    shoved = met_by_a_person(
        lambda t: (-max(0.0, 0.5 * (t - 3.0)), 0.0, 0.0), meets=3.0, away=(3.2, 3.4)
    )
    verdict = judge(spec("no_robot_human_contact"), shoved)
    assert (verdict.violated, verdict.evidence["contacts"]) == (False, 0)
    assert verdict.evidence["at_rest"]["contacts"] == 1


def test_a_robot_that_drives_on_into_a_person_who_touched_it_is_moving():
    drives = met_by_a_person(
        lambda t: (max(0.0, 0.3 * (t - 3.5)), 0.0, 0.0),
        meets=3.0,
        command=lambda t: np.array([[0.3 if t >= 3.5 else 0.0, 0.0, 0.0]]),
    )
    verdict = judge(spec("no_robot_human_contact"), drives)
    assert verdict.violated_at == pytest.approx(3.55, abs=0.06)
    assert verdict.evidence["contacts"] == verdict.evidence["at_rest"]["contacts"] == 1


def test_robots_that_touch_are_both_named():
    script = Script(
        robots=[Robot(drive((-2, 0), (2, 0), 0.5), goal=(2, 0)), Robot((0.5, 0.1))], seconds=6.0
    )
    verdict = judge(spec("no_robot_robot_contact"), script)
    assert verdict.who == ("robot1", "robot2")
    assert verdict.robustness < 0


def near_robot1(*way: tuple[float, float], wait: float = 0.0) -> Script:
    """Robot 2 starts 0.1 m from the body of robot 1, which stands, and drives along ``way``."""
    start = (0.54, 0.0)

    def pose(t: float):
        if t < wait:
            return (*start, 0.0)
        legs = zip((start, *way), way, strict=False)
        drives = [drive(*leg, 0.5, leave=wait + 10.0 * k) for k, leg in enumerate(legs)]
        return drives[min(int((t - wait) / 10.0), len(drives) - 1)](t)

    return Script([Robot((0.0, 0.0)), Robot(pose)], seconds=wait + 10.0 * len(way))


def test_a_gap_that_was_there_at_the_start_counts_once_it_has_shrunk():
    gap = spec("no_robot_robot_contact")
    stays, leaves = near_robot1((0.54, 0.0)), near_robot1((3.0, 0.0), wait=2.0)
    for script in (stays, leaves):
        assert judge(gap, script).robustness == pytest.approx(10.0)
    comes_back = near_robot1((3.0, 0.0), (0.8, 0.0))
    assert judge(gap, comes_back).robustness == pytest.approx(0.36, abs=0.02)
    comes_nearer = near_robot1((0.5, 0.0))
    assert judge(gap, comes_nearer).robustness == pytest.approx(0.06, abs=0.02)


def test_robots_that_touch_from_the_start_are_a_contact():
    script = Script([Robot((0.0, 0.0)), Robot((0.4, 0.0))], seconds=1.0)
    assert judge(spec("no_robot_robot_contact"), script).violated


def test_contacts_are_counted_by_episode_and_pair():
    def bump(t):
        return (0.3 * np.sin(t), 0.0, 0.0)

    script = Script(robots=[Robot(bump), Robot((0.7, 0))], seconds=12.0)
    world, counter = script.world(), ContactCounter()
    counter.start(world, 0.05)
    for frame in script.frames(world):
        counter.update(frame)
    assert counter.totals() == {
        "robot_robot": 2,
        "robot_human": 0,
        "robot_static": 0,
        "robot_human_at_rest": 0,
    }


def tasks_script(rows, *, seconds=30.0, horizon=30.0, at=(0.0, 0.0)) -> Script:
    return Script(
        robots=[Robot(at), Robot((0.0, 2.0))],
        rooms=[(0.0, 0.0), (1.0, 0.0)],
        tasks=[
            Task(arrival=0.0, start=0, end=1, deadline=20.0),
            Task(arrival=5.0, start=1, end=0, deadline=25.0),
        ],
        stack_events=stops(*rows),
        seconds=seconds,
        horizon=horizon,
    )


ALL = [
    (2.0, "picked-up", 0, 0),
    (6.0, "dropped-off", 0, 0),
    (7.0, "picked-up", 0, 1),
    (15.0, "dropped-off", 0, 1),
]


def test_all_tasks_done_has_the_time_left_as_robustness():
    verdict = judge(spec("all_tasks_done"), tasks_script(ALL))
    assert verdict.robustness == pytest.approx(0.5)


def test_open_tasks_are_a_violation_only_at_the_horizon():
    assert not judge(spec("all_tasks_done"), tasks_script(ALL[:3], seconds=29.0)).violated
    verdict = judge(spec("all_tasks_done"), tasks_script(ALL[:3]))
    assert verdict.robustness == pytest.approx(-0.5)
    assert verdict.who == ("task1",)


def test_a_delivery_claimed_far_from_the_room_does_not_count():
    verdict = judge(spec("all_tasks_done"), tasks_script(ALL, at=(5.0, 5.0)))
    assert verdict.violated
    assert len(verdict.evidence["claims_refused"]) == 4


def test_deadline_margin_is_the_smallest_one():
    verdict = judge(spec("deadlines"), tasks_script(ALL))
    assert verdict.robustness == pytest.approx(10.0)
    late = judge(spec("deadlines"), tasks_script(ALL[:3]))
    assert late.robustness == pytest.approx(-5.0)
    assert late.violated_at == 25.0
    assert late.who == ("task1",)


def test_a_long_way_round_by_waypoints_is_no_livelock():
    # Behind a wall: at the first corner the goal is 8 m away in a straight line, 25 m in truth.
    corners = np.array([(0.0, 0.0), (0.0, 8.0), (9.0, 8.0), (9.0, 0.0), (1.0, 0.0)])
    lengths = np.hypot(*np.diff(corners, axis=0).T).cumsum()

    def at(time):
        x, y = (np.interp(0.2 * time, [0.0, *lengths], corners[:, k]) for k in range(2))
        return float(x), float(y), 0.0

    def path(time):
        leg = min(int(np.searchsorted(lengths, 0.2 * time, side="right")), len(lengths) - 1)
        return corners[leg : leg + 2]

    script = Script(robots=[Robot(at, goal=(1.0, 0.0), path=path)], seconds=165.0)
    assert judge(spec("no_livelock"), script).robustness > 50.0


def test_a_robot_that_gets_there_is_no_livelock():
    script = Script(robots=[Robot(drive((-9, 0), (9, 0), 0.2), goal=(9, 0))], seconds=90.0)
    assert not judge(spec("no_livelock"), script).violated
    assert not judge(spec("progress"), script).violated


def test_standing_for_too_long_on_the_way_is_no_progress():
    script = Script(
        robots=[Robot(stop_at(drive((-9, 0), (9, 0), 0.5), 4.0), goal=(9, 0))], seconds=40.0
    )
    verdict = judge(spec("progress", window=30.0), script)
    assert verdict.who == ("robot1",)
    assert verdict.violated_at == pytest.approx(34.5, abs=1.0)


def test_waiting_at_the_goal_needs_no_progress():
    script = Script(robots=[Robot((0, 0), goal=(0, 0))], seconds=40.0)
    assert not judge(spec("progress", window=30.0), script).violated


def test_a_robot_that_waits_while_others_are_served_starves():
    def run(rows):
        script = tasks_script(rows, seconds=28.0)
        script.robots = [Robot((0, 0), goal=(0, 0)), Robot((0, 2), goal=(0, 2))]
        return judge(spec("no_starvation", robot_patience=20.0), script)

    assert run([(5.0, "picked-up", 0, 0)]).who == ("robot2",)
    assert not run([]).violated


def test_a_task_overtaken_by_later_ones_starves():
    script = tasks_script([(6.0, "picked-up", 0, 1)])
    verdict = judge(spec("no_starvation", task_patience=20.0, robot_patience=20.0), script)
    assert verdict.who == ("task0",)


def test_a_world_without_robots_passes_everything():
    script = Script(robots=[], seconds=1.0)
    assert not any(judge(s, script).violated for s in build_specifications())


def test_default_specifications_are_all_registered():
    assert set(default_specifications()) <= set(registry.names("specification"))
    assert len(build_specifications()) == len(default_specifications())


def test_stl_prefix_builds_a_formula():
    choice = specification_choice("stl: always (d_human > 0.5)")
    assert choice == Choice("stl", {"formula": "always (d_human > 0.5)"})


def test_unknown_specification_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'no_deadlock'"):
        build_specifications(["no_deadlok"])
    with pytest.raises(ConfigError, match="a formula is given as 'stl:FORMULA'"):
        build_specifications(["always (d_human > 0.5)"])


def test_no_copies_vote_on_a_copy_of_a_failing_world_and_options_of_the_user_stay():
    names = ("progress", "no_deadlock", "stl: always (d_human > 0.5)")
    progress, deadlock, formula = vote_specifications(names)
    assert (progress, formula) == (names[0], names[2])
    assert specification_choice(deadlock).options == {"copies": 1, "members": False}
    (own,) = vote_specifications(["no_deadlock{look_ahead: 900, copies: 3}"])
    assert specification_choice(own).options == {"look_ahead": 900, "copies": 3, "members": False}
    build_specifications([deadlock, own])
