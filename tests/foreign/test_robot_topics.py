"""What robots' topics carry, and what is read from them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from mrta_falsify.core.errors import ConfigError

pytest.importorskip("rosbags")

from simulator_interface.foreign.robot_topics import RobotTopics, Topics
from tests.foreign.plain_messages import make
from tests.foreign.seen_worlds import RAYS, tick_seen, world_seen


def topics_of(robots: int = 2, **names) -> RobotTopics:
    return RobotTopics(world_seen(robots), Topics(**names), make)


def filled(topics: RobotTopics, tick: dict) -> dict:
    return {topic.name: message for topic, message in topics.at_tick(tick)}


def test_each_robot_has_topics_of_its_own_and_the_clock_comes_last():
    names = [topic.name for topic, _ in topics_of().at_tick(tick_seen(0, 2))]
    assert names == [
        *("/robot1/odom", "/robot2/odom", "/robot1/scan", "/robot2/scan"),
        *("/people", "/tf", "/clock"),
    ]


def test_a_topic_without_a_name_is_left_out():
    topics = topics_of(scan="", people="", plan="")
    assert [topic.field for topic in topics.published if topic.robot < 1] == [
        *("tf_static", "map", "odom", "tf", "tasks", "clock"),
    ]
    assert "plan" not in {topic.field for topic in topics.heard}


def test_scans_are_best_effort_unless_reliable_ones_are_asked_for():
    def is_reliable(**names) -> dict[str, bool]:
        return {topic.field: topic.qos.is_reliable for topic in topics_of(**names).published}

    assert [field for field, reliable in is_reliable().items() if not reliable] == ["scan"]
    assert all(is_reliable(reliable_scan=True).values())


def test_what_is_published_once_is_kept_for_who_comes_later():
    latched = {t.field for t in topics_of().published if t.qos.is_transient_local}
    assert latched == {"map", "tf_static", "tasks"}


def test_time_is_in_whole_nanoseconds():
    clock = filled(topics_of(), tick_seen(7, 2))["/clock"].clock
    assert (clock.sec, clock.nanosec) == (0, 350_000_000)


def test_odometry_tells_pose_and_speed():
    pose = np.array([[1.0, 2.0, math.pi / 2.0]])
    tick = tick_seen(3, 1, pose=pose, velocity=np.array([[0.5, 0.1, -0.2]]))
    odom = filled(topics_of(1), tick)["/robot1/odom"]
    place, turn = odom.pose.pose.position, odom.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 0.0)
    assert (turn.z, turn.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    speed = odom.twist.twist
    assert (speed.linear.x, speed.linear.y, speed.angular.z) == (0.5, 0.1, -0.2)
    assert (odom.header.frame_id, odom.child_frame_id) == ("robot1/odom", "robot1/base_link")


def test_transforms_lead_from_the_map_to_each_robot():
    topics = topics_of()
    fixed = {topic.field: message for topic, message in topics.at_start()}["tf_static"]
    moving = filled(topics, tick_seen(4, 2))["/tf"]
    assert [(t.header.frame_id, t.child_frame_id) for t in fixed.transforms] == [
        ("map", "robot1/odom"),
        ("map", "robot2/odom"),
    ]
    assert [t.child_frame_id for t in moving.transforms] == ["robot1/base_link", "robot2/base_link"]
    assert moving.transforms[1].transform.translation.x == pytest.approx(10.04)


def test_the_map_tells_what_is_solid_and_what_is_unknown():
    ((_, grid),) = [row for row in topics_of().at_start() if row[0].field == "map"]
    assert grid.data == [100] * 5 + [-1] * 2 + [0] * 5
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (4, 3, 0.1)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.0, -2.0)


@pytest.mark.parametrize("yaw", [0.0, 2.5, -3.0])
@pytest.mark.parametrize("turned", [0.0, 2.0 * math.pi / RAYS / 3.0])
def test_a_scan_has_the_ranges_of_the_rays_and_where_the_first_one_points(yaw, turned):
    angles = yaw + turned + np.arange(RAYS) * 2.0 * math.pi / RAYS
    ranges = np.linspace(1.0, 3.0, RAYS)
    points = ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points[2] = np.inf
    tick = tick_seen(0, 1, pose=np.array([[0.0, 0.0, yaw]]), obstacle_points=points[None])
    scan = filled(topics_of(1), tick)["/robot1/scan"]
    assert scan.angle_min == pytest.approx(turned)
    assert scan.angle_increment == pytest.approx(2.0 * math.pi / RAYS)
    assert scan.angle_max == pytest.approx(turned + (RAYS - 1) * 2.0 * math.pi / RAYS)
    assert scan.ranges[2] == math.inf
    assert np.delete(scan.ranges, 2) == pytest.approx(np.delete(ranges, 2))


def test_a_scan_sees_robots_and_people_but_nothing_behind_them():
    far = np.full((2, RAYS, 2), np.inf)
    pose = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    tick = tick_seen(
        *(0, 2),
        pose=pose,
        obstacle_points=far,
        human_position=np.array([[0.0, 2.0], [np.nan, np.nan]]),
        human_velocity=np.array([[0.0, 0.5], [np.nan, np.nan]]),
        human_radius=np.array([0.3, 0.3]),
    )
    messages = filled(topics_of(), tick)
    ranges = messages["/robot1/scan"].ranges
    assert ranges[0] == pytest.approx(0.8)  # the other robot's front
    assert ranges[RAYS // 4] == pytest.approx(1.7)  # the person to the left
    assert np.isinf(np.delete(ranges, [0, RAYS // 4])).all()
    (person,) = messages["/people"].poses
    assert (person.position.x, person.position.y) == (0.0, 2.0)
    assert person.orientation.z == pytest.approx(math.sin(math.pi / 4.0))


def test_nothing_is_seen_beyond_the_largest_range():
    scan = filled(topics_of(1, range_max=1.5), tick_seen(0, 1))["/robot1/scan"]
    assert np.isinf(scan.ranges).all()
    assert scan.range_max == 1.5


def test_a_task_is_told_with_its_rooms():
    task = {"task": 0, "start": 0, "end": 1, "deadline": math.inf, "robot": ""}
    message = filled(topics_of(), tick_seen(0, 2, tasks=[task]))["/tasks"]
    told = json.loads(message.data)
    assert (told["start_room"], told["end_room"]) == ("west", "east")
    assert told["end_point"] == [9.0, 1.0]
    assert told["deadline"] is None


# --- what is heard --------------------------------------------------------------------------


def heard(topics: RobotTopics, field: str, robot: int = -1):
    return next(t for t in topics.heard if t.field == field and t.robot == robot)


@pytest.mark.parametrize("stamped", [False, True])
def test_a_command_is_read_with_its_stamp_if_it_has_one(stamped):
    topics = topics_of(stamped=stamped)
    topic = heard(topics, "cmd_vel", 1)
    message = make(topic.type)
    twist = message.twist if stamped else message
    twist.linear.x, twist.linear.y, twist.angular.z = 0.5, 0.1, -0.3
    if stamped:
        message.header.stamp.sec, message.header.stamp.nanosec = 2, 50
    said = topics.read(topic, message)
    assert said.twist == (0.5, 0.1, -0.3)
    assert said.stamp == (2_000_000_050 if stamped else None)


def test_goals_and_plans_are_read():
    topics = topics_of()
    goal = make("geometry_msgs/msg/PoseStamped")
    goal.pose.position.x, goal.pose.position.y = 3.0, 4.0
    assert topics.read(heard(topics, "goal_pose", 0), goal).goal == (3.0, 4.0)
    plan = make("nav_msgs/msg/Path")
    plan.poses = [goal, goal]
    topic = heard(topics, "plan", 0)
    assert topics.read(topic, plan).path.tolist() == [[3.0, 4.0], [3.0, 4.0]]
    plan.poses = []
    assert topics.read(topic, plan).path.shape == (0, 2)


def test_an_event_may_name_its_robot():
    topics = topics_of()
    message = make("std_msgs/msg/String")
    message.data = '{"kind": "picked-up", "robot": "robot2", "task": 0}'
    said = topics.read(heard(topics, "events"), message)
    assert said.event == {"kind": "picked-up", "robot": 1, "task": 0}
    message.data = "picked up"
    with pytest.raises(ConfigError, match="/events: 'picked up' is no event"):
        topics.read(heard(topics, "events"), message)


# --- names ----------------------------------------------------------------------------------


def test_names_of_robots_become_names_of_topics():
    world = world_seen(1)
    world["robots"][0]["name"] = "bed 3"
    topics = RobotTopics(world, Topics(), make)
    assert "/bed_3/odom" in {topic.name for topic in topics.published}


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"odom": "/odom"}, "2 topics are named /odom"),
        ({"cmd_vel": "cmd_vel"}, r"topics\.cmd_vel: 'cmd_vel' is no name of a topic"),
        ({"plan": "/{robot}/the plan"}, r"topics\.plan: '/robot1/the plan' is no name"),
    ],
)
def test_names_that_cannot_be_are_refused(names, said):
    with pytest.raises(ConfigError, match=said):
        topics_of(**names)


def test_a_single_robot_needs_no_namespace():
    topics = topics_of(1, odom="/odom", cmd_vel="/cmd_vel")
    assert "/odom" in {topic.name for topic in topics.published}
