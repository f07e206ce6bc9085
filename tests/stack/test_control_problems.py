"""Reference problems of control with known answers, on exact unicycles without physics."""

from __future__ import annotations

import copy
import dataclasses
import itertools

import numpy as np
import pytest
from control_course import NO_PATH, Course, box, line

from mrta_falsify.core.defects import with_defects
from mrta_falsify.specs.contacts import DRIVING_SPEED
from mrta_falsify.stack.control.cluster import ClusterCbf
from mrta_falsify.stack.control.decentralised import DecentralisedCbf

CORRIDOR = [(-9, -1.25, 9, -1.25), (-9, 1.25, 9, 1.25)]
CONTACT = 0.48  # m between centres; farther apart two bodies cannot touch


def cluster(*, defects=(), **options):
    return with_defects(ClusterCbf, defects)(ClusterCbf.Options(**options))


def decentralised(**options):
    return DecentralisedCbf(DecentralisedCbf.Options(**options))


def crossing():
    return Course(
        pose=[[-4, 0, 0], [0, -4, np.pi / 2]],
        paths=[line((-4, 0), (4, 0)), line((0, -4), (0, 4))],
    )


def corridor(offset):
    return Course(
        pose=[[-6, -offset, 0], [6, offset, np.pi]],
        paths=[line((-6, -offset), (6, -offset)), line((6, offset), (-6, offset))],
        walls=CORRIDOR,
    )


def idle_in_the_way(active=False):
    return Course(
        pose=[[-4, 0, 0], [0, 0.1, np.pi / 2]],
        paths=[line((-4, 0), (4, 0)), NO_PATH],
        active=[True, active],
        walls=CORRIDOR,
    )


def roundabout():
    angles = np.arange(4) * np.pi / 2
    starts = [(-4 * np.cos(a), -4 * np.sin(a)) for a in angles]
    return Course(
        pose=[[*p, a] for p, a in zip(starts, angles, strict=True)],
        paths=[line(p, (-p[0], -p[1])) for p in starts],
    )


@pytest.mark.parametrize("controller", [cluster(), decentralised()], ids=["cluster", "alone"])
def test_two_robots_cross_without_contact(controller):
    course = crossing().run(controller, 25)
    assert course.arrived().all()
    assert course.narrowest_robot > CONTACT


@pytest.mark.parametrize("controller", [cluster(), decentralised()], ids=["cluster", "alone"])
def test_robots_on_right_hand_lanes_pass_each_other_at_speed(controller):
    course = corridor(0.5).run(controller, 25)
    assert course.arrived().all()
    assert course.time < 18.0
    assert course.narrowest_robot > 0.6
    assert course.narrowest_wall > 0.2


def test_head_on_in_a_corridor_the_worse_ranked_robot_makes_room():
    course = corridor(0.0).run(cluster(), 50)
    assert course.arrived().all()
    assert course.narrowest_robot > CONTACT
    assert course.narrowest_wall > 0.05


def test_robot_overtakes_an_idle_one_that_cannot_be_asked_to_move():
    course = idle_in_the_way(active=True).run(cluster(), 40)
    assert course.arrived().all()
    assert course.narrowest_robot > CONTACT
    assert np.hypot(*(course.pose[1, :2] - [0, 0.1])) < 0.05


def test_idle_robot_is_moved_aside_by_the_leader():
    course = idle_in_the_way().run(cluster(), 25)
    assert course.arrived().all()
    assert course.time < 15.0
    assert np.hypot(*(course.pose[1, :2] - [0, 0.1])) > 0.3
    assert course.narrowest_robot > CONTACT
    assert course.narrowest_wall > 0.1


def test_four_robots_clear_a_roundabout():
    course = roundabout().run(cluster(), 60)
    assert course.arrived().all()
    assert course.narrowest_robot > CONTACT


def test_follower_keeps_its_distance_behind_a_worse_ranked_robot():
    course = Course(
        pose=[[-4, 0, 0], [-3, 0, 0]], paths=[line((-4, 0), (6, 0)), line((-3, 0), (7, 0))]
    ).run(cluster(), 30)
    assert course.arrived().all()
    assert course.narrowest_robot > 0.8


def test_lead_passes_on_as_the_cluster_shrinks():
    course = Course(
        pose=[[0, 0, np.pi / 2], [0, -2, 0], [0, -5, 0]],
        paths=[line((0, 0), (0, 9)), line((0, -2), (8, -2)), line((0, -5), (8, -5))],
    )
    controller = cluster(followers="brake")
    course.run(controller, 12)
    leaders = [result.leader.tolist() for *_, result in course.log]
    changes = [leaders[0]] + [b for a, b in itertools.pairwise(leaders) if a != b]
    assert changes == [[0, 0, 0], [0, 1, 1], [0, 1, 2]]


def test_brake_followers_wait_as_in_the_paper_and_yielding_ones_save_time():
    paper = corridor(0.5).run(cluster(followers="brake"), 40)
    ours = corridor(0.5).run(cluster(), 40)
    assert paper.arrived().all()
    assert ours.time < 0.75 * paper.time


def test_stuck_leader_hands_on_the_lead_and_its_memory_can_be_copied():
    course = Course(
        pose=[[0, 0, 0], [0, 2.5, 0]],
        paths=[line((0, 0), (5, 0)), line((0, 2.5), (0.2, 2.5))],
        walls=box(0.35, -1, 0.6, 1),
    )
    controller = cluster()
    for _ in range(150):
        course.step(controller)
    copied = copy.deepcopy(controller)
    course.paths[1] = line((0, 2.5), (9, 2.5))
    other = copy.deepcopy(course)
    leaders = []
    for _ in range(200):
        first, second = course.step(controller), other.step(copied)
        assert first.command.twist.tobytes() == second.command.twist.tobytes()
        leaders.append(int(first.leader[0]))
    assert 1 in leaders


@pytest.mark.parametrize("height", [0.19, 0.24, 0.26, 0.32])
@pytest.mark.parametrize("yaw", [0.0, -np.pi / 2, np.pi])
def test_robot_near_a_wall_leaves_without_touching_it(height, yaw):
    if height < 0.2 and yaw < 0:
        pytest.skip("nose in the wall")
    course = Course(
        pose=[[0, height, yaw]],
        paths=[line((0, height), (0, 0.8), (3, 0.8))],
        walls=[(-5, 0, 5, 0)],
    ).run(cluster(), 30)
    assert course.arrived().all()
    assert course.narrowest_wall > 0.0


@pytest.mark.parametrize(
    ("start", "velocity"),
    [((4, 0.0), (-1.3, 0)), ((4, 0.4), (-1.3, 0)), ((0, 5), (0, -1.3)), ((-8, 0.05), (1.3, 0))],
    ids=["ahead", "ahead, aside", "from the side", "from behind"],
)
@pytest.mark.parametrize("controller", [cluster(), decentralised()], ids=["cluster", "alone"])
def test_person_who_sees_nothing_never_meets_a_moving_robot(controller, start, velocity):
    course = Course(
        pose=[[-4, 0, 0]], paths=[line((-4, 0), (4, 0))], humans=[start], human_velocity=[velocity]
    ).run(controller, 30)
    assert course.arrived().all()
    assert all(speed < DRIVING_SPEED for *_, speed in course.struck)


@pytest.mark.parametrize("side", [(0.06, 0.4), (0.0, 0.4), (-0.19, -0.4), (-0.36, 0.32)])
@pytest.mark.parametrize("pace", [0.0, 0.3], ids=["stands", "walks to and fro"])
@pytest.mark.parametrize("controller", [cluster(), decentralised()], ids=["cluster", "alone"])
def test_robot_creeps_away_from_a_person_who_touches_it(controller, side, pace):
    course = Course(pose=[[0, 0, 0]], paths=[line((0, 0), (3, 0))], humans=[side])
    for tick in range(800):
        course.human_velocity = np.array([[pace if tick // 4 % 2 else -pace, 0.0]])
        course.step(controller)
    assert course.arrived().all()
    assert all(speed < DRIVING_SPEED for *_, speed in course.struck)


def test_robot_behind_a_person_stops_in_time_if_the_person_turns_round():
    controller = cluster()
    course = Course(
        pose=[[-4, 0, 0]],
        paths=[line((-4, 0), (9, 0))],
        humans=[(-3.2, 0.1)],
        human_velocity=[(0.75, 0)],
        engine_acceleration=1.0,
    )
    for _ in range(80):
        course.step(controller)
    course.human_velocity[:] = (-1.0, 0)
    course.run(controller, 20)
    assert course.arrived().all()
    assert all(speed < DRIVING_SPEED for *_, speed in course.struck)


def test_robot_goes_round_a_person_who_stands_in_its_way():
    course = Course(
        pose=[[-4, 0, 0]], paths=[line((-4, 0), (4, 0))], humans=[(0, 0.0)], human_velocity=[(0, 0)]
    ).run(cluster(), 30)
    assert course.arrived().all()
    assert not course.struck


# --- lost links -------------------------------------------------------------------------


def test_follower_without_its_leader_repeats_brakes_then_drives_alone():
    course = Course(
        pose=[[0, 0, 0], [0, 2, 0]], paths=[line((0, 0), (20, 0)), line((0, 2), (20, 2))]
    )
    controller = cluster()
    course.run(controller, 3)
    assert course.log[-1][2].leader.tolist() == [0, 0]
    course.leader_link[1] = False
    last = course.log[-1][2].command.twist[1].copy()
    for _ in range(4):
        np.testing.assert_array_equal(course.step(controller).command.twist[1], last)
    for _ in range(5):
        course.step(controller)
    assert course.velocity[1, 0] < last[0] - 0.1
    assert course.velocity[0, 0] > 0.6
    course.run(controller, 3)
    assert course.velocity[1, 0] > 0.6
    assert course.log[-1][2].leader.tolist() == [0, 1]
    course.leader_link[1] = True
    course.run(controller, 0.2)
    assert course.log[-1][2].leader.tolist() == [0, 0]


def test_robot_that_lost_the_states_stops_and_the_others_keep_clear():
    course = Course(
        pose=[[-4, 0, 0], [0, 0, 0]],
        paths=[line((-4, 0), (8, 0)), line((0, 0), (10, 0))],
    )
    controller = cluster()
    course.run(controller, 1)
    course.states[1] = False
    course.run(controller, 30)
    assert course.velocity[1, 0] == pytest.approx(0.0, abs=1e-3)
    assert course.arrived()[0]
    assert course.narrowest_robot > CONTACT
    course.states[1] = True
    course.run(controller, 25)
    assert course.arrived().all()


# --- planted defects --------------------------------------------------------------------


def test_defect_wrong_robot_makes_a_cluster_blind_to_walls():
    walls = box(0.0, -0.6, 0.4, 0.6)

    def drive(*defects):
        course = Course(
            pose=[[-3, 0, 0], [-3, 3, 0]],
            paths=[line((-3, 0), (3, 0)), line((-3, 3), (3, 3))],
            walls=walls,
        )
        return course.run(cluster(defects=defects), 8)

    assert drive().narrowest_wall > 0.05
    assert drive("cluster_rows_wrong_robot").pose[0, 0] > 0.0  # inside the wall


def test_defect_third_person_is_not_seen():
    def drive(*defects):
        course = Course(
            pose=[[-4, 0, 0]],
            paths=[line((-4, 0), (4, 0))],
            humans=[(20, 20), (21, 20), (0, 0)],
            human_velocity=np.zeros((3, 2)),
        )
        return course.run(cluster(defects=defects), 20).struck

    assert not drive()
    assert max(speed for *_, speed in drive("humans_unseen_beyond_two")) > 0.3


def test_defect_zero_commands_slow_the_followers_down():
    def drive(*defects):
        course = Course(
            pose=[[0, 0, 0], [0, 2, 0]], paths=[line((0, 0), (5, 0)), line((0, 2), (5, 2))]
        )
        return course.run(cluster(defects=defects), 15).time

    assert drive("follower_zero_command") > 1.3 * drive()


def test_defect_boxed_in_leader_starves_its_neighbours():
    def drive(*defects):
        course = Course(
            pose=[[0, 0, 0], [0, 2.5, 0]],
            paths=[line((0, 0), (5, 0)), line((0, 2.5), (3, 2.5))],
            walls=box(0.35, -1, 0.6, 1) + box(-0.9, -1, -0.6, 1),
        )
        return course.run(cluster(defects=defects), 20).arrived()[1]

    assert drive()
    assert not drive("fixed_priority_starves")


# --- other dynamics ---------------------------------------------------------------------


@pytest.mark.parametrize("build", [cluster, decentralised])
def test_holonomic_robots_cross_without_contact(build):
    course = crossing()
    course.run(build(dynamics="holonomic"), 30)
    assert course.arrived().all()
    assert course.narrowest_robot > CONTACT


def test_mirrored_scene_gives_mirrored_commands():
    course = Course(pose=[[0.0, 0.4, 0.3]], paths=[line((0, 0.4), (2, 1))], walls=[(-5, 0, 5, 0)])
    view = course.view()
    flip = np.array([1.0, -1.0])
    mirrored = dataclasses.replace(
        view,
        pose=view.pose * [1, -1, -1],
        target=view.target * flip,
        goal=view.goal * flip,
        path=tuple(path * flip for path in view.path),
        obstacle_points=view.obstacle_points * flip,
    )
    a = cluster().control(view).command.twist
    b = cluster().control(mirrored).command.twist
    np.testing.assert_allclose(a * [1, 1, -1], b, atol=1e-6)
