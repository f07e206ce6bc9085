"""Edges come from motion, geometry, goals and paths; from what the stack says where they end."""

import dataclasses

import numpy as np
from frames import DT, Human, Robot, Script, corridor, drive, room_resource

from mrta_falsify.core.fleet import BlockedBy, StackEvent, Tells
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Resource, Task
from mrta_falsify.specs.deadlock.blocked_by import BlockedByTracker

SPOTS = [(2.0, 0.0), (3.0, 0.0), (4.0, 0.0), (5.0, 0.0)]


def last_edges(script: Script) -> set[BlockedBy]:
    *_, frame = script.frames()
    return set(frame.blocked_by)


def in_queue(*places: int, **more) -> Script:
    """A robot at the room's point and robots at the given spots."""
    return Script(
        robots=[Robot((0, 0), goal=(0, 0)), *(Robot(SPOTS[k], goal=SPOTS[k]) for k in places)],
        rooms=[(0.0, 0.0)],
        resources=[room_resource(0, (0.0, 0.0), SPOTS)],
        tasks=[Task(arrival=0.0, start=0, end=0, deadline=800.0, pickup_time=20.0)],
        **{"seconds": 3.0, **more},
    )


def test_a_robot_that_moves_has_no_edge():
    script = Script(robots=[Robot(drive((0, 0), (9, 0), 0.5), goal=(9, 0))], seconds=5.0)
    assert not last_edges(script)


def test_a_robot_without_a_goal_waits_for_a_task():
    assert last_edges(Script(robots=[Robot((0, 0))], seconds=3.0)) == {BlockedBy(0, "task")}


def test_a_robot_parked_at_its_parking_spot_waits_for_a_task():
    script = Script(robots=[Robot((1, 1), goal=(1, 1))], parking=[(1, 1)], seconds=3.0)
    assert last_edges(script) == {BlockedBy(0, "task")}


def test_a_robot_ahead_is_a_barrier_and_one_behind_is_not():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0)), Robot((0.7, 0)), Robot((-0.7, 0))], seconds=3.0
    )
    assert {e for e in last_edges(script) if e.robot == 0} == {BlockedBy(0, "barrier", 1)}


def test_a_robot_beside_is_no_barrier():
    script = Script(robots=[Robot((0, 0), goal=(5, 0)), Robot((0, 0.61))], seconds=3.0)
    assert not {e for e in last_edges(script) if e.robot == 0 and e.cause == "barrier"}


def test_the_path_decides_what_is_ahead():
    around = [(0, 0), (0, 2), (4, 2), (4, 0)]
    script = Script(robots=[Robot((0, 0), goal=(4, 0), path=around), Robot((0, 0.7))], seconds=3.0)
    assert BlockedBy(0, "barrier", 1) in last_edges(script)


def test_only_the_nearest_obstacle_on_the_path_counts():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0)), Robot((0.65, 0)), Robot((1.7, 0))], seconds=3.0
    )
    assert {e for e in last_edges(script) if e.robot == 0} == {BlockedBy(0, "barrier", 1)}


def test_two_robots_abreast_are_both_named():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0)), Robot((0.6, 0.31)), Robot((0.6, -0.31))], seconds=3.0
    )
    assert {e.other for e in last_edges(script) if e.robot == 0} == {1, 2}


def test_a_person_ahead_is_named():
    script = Script(robots=[Robot((0, 0), goal=(5, 0))], humans=[Human((1.0, 0.2))], seconds=3.0)
    assert last_edges(script) == {BlockedBy(0, "human", 0)}


def test_a_solid_on_the_path_is_named():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0))], furniture=[rectangle(0.4, 0.4, (0.7, 0))], seconds=3.0
    )
    assert last_edges(script) == {BlockedBy(0, "wall", -1, "bed0")}


def test_the_head_of_a_queue_waits_for_the_robot_in_the_room():
    assert BlockedBy(1, "queue", 0, "room0") in last_edges(in_queue(0))


def test_a_queue_is_a_chain():
    edges = last_edges(in_queue(0, 1, 2, 3))
    assert {(e.robot, e.other) for e in edges} == {(1, 0), (2, 1), (3, 2), (4, 3)}


def test_a_robot_that_is_served_has_no_edge_until_its_time_is_up():
    assert not [e for e in last_edges(in_queue(seconds=20.0)) if e.robot == 0]
    assert BlockedBy(0, "stalled") in last_edges(in_queue(seconds=40.0))


def test_the_robot_leaving_the_room_holds_it_until_it_is_out():
    script = in_queue(0)
    script.robots[0] = Robot(drive((0, 0), (0, -9), 0.5), goal=(0, -9))
    assert BlockedBy(1, "queue", 0, "room0") in last_edges(script)
    script.seconds = 14.0
    assert BlockedBy(1, "queue", 0, "room0") not in last_edges(script)


def test_a_follower_waits_for_the_neighbour_that_moves():
    script = Script(
        robots=[Robot((0, 0), goal=(-5, 0)), Robot(drive((0, 2), (9, 2), 0.3), goal=(9, 2))],
        seconds=4.0,
    )
    assert last_edges(script) == {BlockedBy(0, "cluster", 1)}


def test_a_robot_far_from_all_others_that_stands_without_reason_is_stalled():
    assert last_edges(Script(robots=[Robot((0, 0), goal=(5, 0))], seconds=3.0)) == {
        BlockedBy(0, "stalled")
    }


def test_claims_of_the_stack_change_nothing():
    script = in_queue(0, 1)
    world = script.world()
    honest, liar = BlockedByTracker(world, DT), BlockedByTracker(world, DT)
    for frame in script.frames(world):
        count = len(frame.sensed.pose)
        lies = dataclasses.replace(
            frame.intent,
            phase=np.full(count, 5),
            leader=np.zeros(count, dtype=np.int64),
            cluster=np.zeros(count, dtype=np.int64),
            queue=np.arange(count),
            waits_for=("nothing",) * count,
            slack=np.ones(count),
        )
        told = liar.update(frame.sensed, lies, frame.served)
        assert told == honest.update(frame.sensed, frame.intent, frame.served)


def test_edges_are_the_same_object_while_nothing_changes():
    script = in_queue(0, 1)
    last = [frame.blocked_by for frame in script.frames()][-10:]
    assert all(edges is last[0] for edges in last)


def test_a_corridor_cut_by_a_waiting_robot_is_no_path_because_of_it():
    script = Script(
        robots=[Robot((-2, 0), goal=(4, 0), no_path=True), Robot((1, 0)), Robot((-5, 0))],
        walls=corridor(),
        bounds=(-6.0, -0.7, 6.0, 0.7),
        seconds=3.0,
    )
    assert {e for e in last_edges(script) if e.robot == 0} == {BlockedBy(0, "no-path", 1)}


def in_a_lift(seconds: float) -> Script:
    """A robot that drives into a lift, where it stands; its goal is a room behind."""
    area = rectangle(2.0, 2.0, (5.0, 0.0))
    lift = Resource(
        name="lift", kind="elevator", request_area=area, release_area=area, service_time=20.0
    )
    robot = Robot(drive((0, 0), (5, 0), 1.0), goal=(9, 0))
    return Script(robots=[robot], rooms=[(9.0, 0.0)], resources=[lift], seconds=seconds)


def test_a_robot_in_a_lift_is_served_until_its_time_is_up():
    assert not last_edges(in_a_lift(28.0))
    assert last_edges(in_a_lift(34.0)) == {BlockedBy(0, "stalled")}


def test_pushed_furniture_is_named_where_it_stands_now():
    script = Script(
        robots=[Robot((0, 0), goal=(5, 0))],
        rooms=[(5.0, 0.0)],
        furniture=[rectangle(0.4, 2.0, (-5.0, 5.0))],
        seconds=3.0,
    )
    world = script.world()
    world = dataclasses.replace(
        world, furniture=(dataclasses.replace(world.furniture[0], movable=True),)
    )
    frames = list(script.frames())

    def named(x: float, y: float, turn: float) -> set[BlockedBy]:
        tracker = BlockedByTracker(world, DT)
        edges: tuple[BlockedBy, ...] = ()
        for frame in frames:
            share = frame.sensed.time / 3.0  # it is pushed there
            pose = np.array([[-5.0 + share * (x + 5.0), 5.0 + share * (y - 5.0), share * turn]])
            sensed = dataclasses.replace(frame.sensed, furniture_pose=pose)
            edges = tracker.update(sensed, frame.intent, frame.served)
        return set(edges)

    assert named(0.8, 0.0, 0.0) == {BlockedBy(0, "wall", -1, "bed0")}
    assert named(0.8, 0.6, np.pi / 2.0) == {BlockedBy(0, "stalled")}
    assert named(0.8, 0.6, 0.0) == {BlockedBy(0, "wall", -1, "bed0")}


def test_robots_that_swap_places_are_named_anew_for_who_has_no_path():
    """Answers are kept by place; the robot at a place may be another one later."""

    def cut_by(robot: int) -> Script:
        rests, drives = Robot((1.0, 0)), Robot(drive((-5, 0), (-3.5, 0), 0.4))
        return Script(
            robots=[
                Robot((-2, 0), goal=(4, 0), no_path=True),
                *([rests, drives] if robot == 1 else [drives, rests]),
            ],
            walls=corridor(),
            bounds=(-6.0, -0.7, 6.0, 0.7),
            seconds=3.0,
        )

    tracker = BlockedByTracker(cut_by(1).world(), DT)

    def no_path_of(script: Script, begin: int) -> set[BlockedBy]:
        edges: tuple[BlockedBy, ...] = ()
        for frame in script.frames():
            tick = begin + frame.sensed.tick
            sensed = dataclasses.replace(frame.sensed, tick=tick, time=tick * DT)
            edges = tracker.update(sensed, frame.intent, frame.served)
        return {edge for edge in edges if edge.robot == 0}

    assert no_path_of(cut_by(1), 0) == {BlockedBy(0, "no-path", 1)}
    assert no_path_of(cut_by(2), 100) == {BlockedBy(0, "no-path", 2)}


def no_path_past(furniture) -> set[BlockedBy]:
    return last_edges(
        Script(
            robots=[Robot((-2, 0), goal=(4, 0), no_path=True)],
            walls=corridor(),
            furniture=furniture,
            bounds=(-6.0, -0.7, 6.0, 0.7),
            seconds=3.0,
        )
    )


def test_the_bed_that_fills_the_only_way_is_named_where_there_is_no_path():
    aside, across = rectangle(0.4, 0.2, (-4.0, 0.4)), rectangle(0.6, 1.0, (1.0, 0.0))
    assert no_path_past([aside, across]) == {BlockedBy(0, "no-path", -1, "bed1")}


def test_a_bed_that_leaves_a_gap_too_narrow_for_the_robot_is_named_as_well():
    narrow = rectangle(0.6, 0.6, (1.0, -0.2))
    assert no_path_past([narrow]) == {BlockedBy(0, "no-path", -1, "bed0")}


def test_two_beds_of_which_either_closes_the_way_are_named_together():
    beds = [rectangle(0.6, 1.0, (0.5, 0.0)), rectangle(0.6, 1.0, (2.0, 0.0))]
    aside = rectangle(0.4, 0.2, (-4.0, 0.4))
    assert no_path_past([beds[0], aside, beds[1]]) == {
        BlockedBy(0, "no-path", -1, "bed0"),
        BlockedBy(0, "no-path", -1, "bed2"),
    }


def test_two_beds_side_by_side_that_fill_the_way_are_named_together():
    beds = [rectangle(0.6, 0.5, (1.0, 0.25)), rectangle(0.6, 0.5, (1.0, -0.25))]
    found = {edge.resource for edge in no_path_past(beds)}
    assert found == {"bed0", "bed1"}


def no_path_across(furniture, walls=()) -> set[BlockedBy]:
    """What a robot is told to lack a path for on an open floor, 6 m x 3 m, with walls or none."""
    return last_edges(
        Script(
            robots=[Robot((-2, 0), goal=(2, 0), no_path=True)],
            walls=list(walls),
            furniture=furniture,
            bounds=(-3.0, -1.5, 3.0, 1.5),
            seconds=3.0,
        )
    )


#: halves of a wall across that floor, with a gap of 1 m in the middle
GAP = (rectangle(0.2, 1.0, (0.0, 1.0)), rectangle(0.2, 1.0, (0.0, -1.0)))


def test_a_cart_beside_a_wide_way_closes_nothing():
    cart = rectangle(0.6, 0.6, (0.0, 0.0))
    assert no_path_across([cart]) == {BlockedBy(0, "no-path")}


def test_a_cart_against_a_wall_that_closes_the_way_closes_nothing():
    wall, cart = rectangle(0.2, 3.0, (0.0, 0.0)), rectangle(0.6, 0.6, (0.0, 0.0))
    assert no_path_across([cart], [wall]) == {BlockedBy(0, "no-path", -1, "unreachable")}


def test_of_two_ways_closed_by_a_cart_and_a_wall_the_cart_is_named():
    cart, beside = rectangle(0.5, 0.9, (0.0, 0.0)), rectangle(0.6, 0.6, (1.0, 1.0))
    assert no_path_across([beside, cart], GAP) == {BlockedBy(0, "no-path", -1, "bed1")}


def test_a_cart_is_named_that_leaves_a_gap_for_bold_planners_only():
    cart = rectangle(0.5, 0.4, (0.0, -0.3))  # leaves 0.6 m of 1 m
    assert no_path_across([cart], GAP) == {BlockedBy(0, "no-path", -1, "bed0")}


def test_walls_too_close_for_a_cautious_planner_are_not_blamed_on_a_cart():
    lane = (rectangle(0.2, 1.22, (0.0, 0.89)), rectangle(0.2, 1.22, (0.0, -0.89)))
    cart = rectangle(0.4, 0.4, (0.8, 0.9))
    assert no_path_across([cart], lane) == {BlockedBy(0, "no-path")}


def test_a_stack_that_tells_no_paths_is_taken_to_drive_the_shortest_way():
    def edges(*, paths: bool) -> set[BlockedBy]:
        wall = rectangle(0.2, 4.0, (0.0, 0.0))
        script = Script(
            robots=[Robot((-0.6, 0), goal=(0.8, 0), no_path=True), Robot((-0.6, 0.8))],
            walls=[wall],
            bounds=(-4.0, -2.1, 4.0, 4.0),
            seconds=3.0,
        )
        tracker = BlockedByTracker(script.world(), DT)
        for frame in script.frames():
            seen = frame.sensed, frame.intent, frame.served
            found = tracker.update(*seen, Tells(paths=paths))
        return {edge for edge in found if edge.robot == 0}

    assert {edge.cause for edge in edges(paths=True)} == {"no-path"}
    assert edges(paths=False) == {BlockedBy(0, "barrier", 1)}


# --- locks of areas that nobody is in --------------------------------------------------------


def locked(*events: tuple[int, str, int], waits_for: str = "", way: float = 5.0) -> set[BlockedBy]:
    """Edges of robot 0 before an area; ``events``: tick, kind and robot."""
    area = Resource(
        name="lane",
        kind="corridor",
        request_area=rectangle(2.0, 1.0, (2.5, 0.0)),
        release_area=rectangle(2.0, 1.0, (2.5, 0.0)),
    )
    script = Script(
        robots=[
            Robot((0, 0), goal=(way, 0), waits_for=waits_for),
            Robot((0, 3), goal=(9, 3)),
            Robot((0, -3), goal=(9, -3)),
        ],
        resources=[area],
        seconds=3.0,
        stack_events=lambda tick: tuple(
            StackEvent(time=tick * DT, kind=kind, robot=robot, resource="lane")
            for at, kind, robot in events
            if at == tick
        ),
    )
    return {edge for edge in last_edges(script) if edge.robot == 0}


AT_EQUALS = {BlockedBy(0, "cluster", 1), BlockedBy(0, "cluster", 2)}


def test_a_robot_before_an_area_waits_for_who_was_granted_it():
    assert locked() == AT_EQUALS
    assert locked((5, "granted", 2)) == {BlockedBy(0, "queue", 2, "lane")}
    assert locked((5, "granted", 2), (9, "granted", 1)) == {BlockedBy(0, "queue", 1, "lane")}


def test_who_has_the_area_itself_or_does_not_go_there_waits_for_nobody_in_it():
    assert locked((5, "granted", 0)) == AT_EQUALS
    assert locked((5, "granted", 2), (9, "released", 2)) == AT_EQUALS
    assert locked((5, "granted", 2), way=1.2) == AT_EQUALS


def test_what_a_stack_says_it_waits_for_explains_a_robot_that_nothing_stands_before():
    assert locked(waits_for="robot3") == {BlockedBy(0, "queue", 2)}
    assert locked((5, "granted", 1), way=1.2, waits_for="lane") == {
        BlockedBy(0, "queue", 1, "lane")
    }
    assert locked(waits_for="lane") == AT_EQUALS
    assert locked(waits_for="a robot of another fleet") == AT_EQUALS
