"""Whole missions on small wards with the kinematic engine; invariants hold at every tick."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from mission_course import KINEMATIC, area, run, ward, with_resources

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.fleet import FleetState, Phase
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Blockage, CommsOutage, Wall
from mrta_falsify.testing.wards import ward_layout
from simulator_interface.episode import Episode

NOBODY = frozen_array(np.zeros((0, 2)))


def outage(world, *links, start=3.0, end=23.0):
    event = CommsOutage(name="outage", robots=(), links=links, start=start, end=end)
    return dataclasses.replace(world, events=(event,))


# --- rooms -------------------------------------------------------------------------------


def test_two_robots_with_swapped_rooms_both_arrive():
    assert run(ward([0, 1], [(0, 0, 1), (0, 1, 0)])).done


def test_three_robots_to_one_room_go_in_one_by_one():
    result = run(ward([0, 1, 2], [(0, 0, 3), (0, 1, 3), (0, 2, 3)], rooms=4))
    assert result.done
    inside = [e.robot for e in result.events if e.kind == "granted" and e.resource == "ward_3"]
    assert sorted(inside) == [0, 1, 2]
    order = [e.kind for e in result.events if e.resource == "ward_3" and e.kind != "waits-for"]
    assert order[:2] == ["granted", "dropped-off"]


@pytest.mark.slow
def test_six_robots_to_one_room_with_three_spots_are_all_served():
    world = ward(list(range(6)), [(0, i, 6) for i in range(6)], rooms=7, horizon=400.0)
    result = run(world)
    assert result.done
    assert len(result.at("dropped-off", resource="ward_6")) == 6


def test_a_chain_of_stops_in_one_room_is_served_without_driving():
    result = run(ward([0], [(0, 0, 0), (0, 0, 1), (0, 1, 1)], rooms=2))
    assert result.done
    assert len(result.at("granted", robot=0)) == 1


def test_a_robot_sent_to_parking_comes_back_for_a_task_in_the_room_it_left():
    result = run(ward([0, 1], [(0, 1, 0), (9.0, 0, 1)], rooms=2))
    assert result.done
    assert result.at("makes-room", robot=0, resource="ward_0")


@pytest.mark.slow
def test_every_room_holds_a_parked_robot_and_every_room_is_asked_for():
    tasks = [(0.0, i, (i + 1) % 6) for i in range(6)]
    assert run(ward(list(range(6)), tasks, rooms=6, horizon=400.0)).done


@pytest.mark.slow
def test_without_waiting_spots_a_robot_stops_short_of_the_room():
    layout = ward_layout(rooms=3)
    bare = tuple(dataclasses.replace(r, spots=NOBODY) for r in layout.resources)
    layout = dataclasses.replace(layout, resources=bare)
    result = run(ward([0, 1, 2], [(0, 0, 2), (0, 1, 2), (0, 2, 0)], layout=layout))
    assert result.done


@pytest.mark.slow
def test_without_parking_an_idle_robot_still_makes_room():
    layout = dataclasses.replace(ward_layout(rooms=3), parking=NOBODY)
    result = run(ward([0, 1], [(0, 1, 0)], layout=layout, robot={"capacity": 1}))
    assert result.done
    tasks = [(0.0, 1, 0), (1.0, 1, 0)]
    assert run(ward([0, 1, 2], tasks, layout=layout, robot={"capacity": 1})).done


def test_an_idle_robot_on_a_waiting_spot_is_sent_away():
    layout = ward_layout(rooms=3)
    spot = tuple(layout.resources[2].spots[0])
    world = ward([2, 0, spot], [(0, 0, 2), (0, 2, 0)], layout=layout)
    assert run(world).done
    dawdle = dataclasses.replace(world.tasks[1], pickup_time=30.0)
    result = run(dataclasses.replace(world, tasks=(world.tasks[0], dawdle)))
    assert result.done
    assert result.at("makes-room", robot=2)


def test_localisation_noise_does_not_hide_an_arrival():
    robot = {"position_noise": 0.05, "heading_noise": 0.02}
    result = run(ward([0, 1, 2], [(0, 0, 1), (0, 1, 2), (0, 2, 0)], robot=robot))
    assert result.done
    assert result.time < 60.0


@pytest.mark.slow
def test_a_room_keeps_its_robot_for_the_service_time_of_the_visit():
    world = ward([0], [(0, 0, 1), (0, 0, 1)], rooms=2)
    visits = tuple(dataclasses.replace(r, service_time=8.0) for r in world.resources)
    quick, slow = run(world), run(dataclasses.replace(world, resources=visits))
    assert slow.time == pytest.approx(quick.time + 16.0, abs=2.0)  # two visits, not four stops


@pytest.mark.slow
def test_a_room_that_is_held_until_served_is_free_while_the_robot_is_still_inside():
    world = ward([0, 1], [(0, 0, 2), (0, 1, 2), (0, 2, 0)], rooms=3)
    rooms = tuple(dataclasses.replace(r, hold="until_served") for r in world.resources)
    result = run(dataclasses.replace(world, resources=rooms))
    first = result.at("released", resource="ward_0")[0]
    left = run(world).at("released", resource="ward_0")[0]
    assert first.time < left.time


# --- areas -------------------------------------------------------------------------------


def together_inside(result, box):
    x1, y1, x2, y2 = box
    x, y = result.pose[:, :, 0], result.pose[:, :, 1]
    return ((x > x1) & (x < x2) & (y > y1) & (y < y2)).sum(axis=1).max()


OPPOSITE = [(0, 0, 3), (0, 3, 0)]


def test_a_corridor_for_one_is_never_shared():
    box = (5.5, 0.0, 14.5, 4.0)
    world = ward([0, 3], OPPOSITE, rooms=4)
    result = run(with_resources(world, area("corridor", box)))
    assert result.done
    assert together_inside(result, box) == 1
    assert any(e.other >= 0 for e in result.at("waits-for", resource="corridor"))


def test_areas_too_close_to_wait_between_are_granted_together():
    first, second = (7.0, 0.0, 10.0, 4.0), (10.2, 0.0, 13.0, 4.0)
    world = with_resources(
        ward([0, 3], OPPOSITE, rooms=4), area("door", first), area("corridor", second)
    )
    result = run(world)
    assert result.done
    assert together_inside(result, (7.0, 0.0, 13.0, 4.0)) == 1
    times = {e.resource: e.time for e in result.at("granted", robot=0)}
    assert times["door"] == times["corridor"]


@pytest.mark.slow
def test_two_fit_where_the_capacity_is_two():
    box = (7.0, 0.0, 12.0, 4.0)
    world = ward([0, 3], OPPOSITE, rooms=4)
    result = run(with_resources(world, area("corridor", box, capacity=2)))
    assert result.done
    assert all(e.other < 0 for e in result.at("waits-for", resource="corridor"))


@pytest.mark.slow
def test_a_waiting_place_inside_an_area_is_not_taken_before_the_room_is_free():
    world = ward([0, 1, 2], [(0, 0, 3), (0, 1, 3), (0, 2, 3)], rooms=4)
    result = run(with_resources(world, area("corridor", (14.0, 0.0, 22.0, 4.0))))
    assert result.done


def test_a_lift_carries_its_robot_for_the_service_time():
    box = (8.0, 0.0, 11.0, 4.0)
    lift = area("elevator", box, service_time=10.0)
    result = run(with_resources(ward([0], [(0, 0, 3)], rooms=4), lift))
    assert result.done
    x = result.pose[:, 0, 0]
    at_rest = np.abs(np.diff(x)) < 1e-4
    assert (at_rest & (x[1:] > 8.5) & (x[1:] < 10.5)).sum() * 0.05 > 5.0


@pytest.mark.slow
def test_robots_wait_at_the_spots_of_an_area():
    spots = frozen_array([[7.5, 0.6], [6.3, 0.6], [14.5, 0.6]])
    corridor = area("corridor", (9.0, 0.0, 13.0, 4.0), spots=spots)
    world = ward([0, 1, 3], [(0, 0, 3), (0, 1, 3), (0, 3, 0)], rooms=4)
    assert run(with_resources(world, corridor)).done


# --- links, blockages, unreachable places ------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("link", ["dispatcher", "planner", "states", "leader"])
def test_a_mission_survives_the_loss_of_a_link(link):
    world = ward([0, 1], [(0, 0, 2), (0, 1, 0), (12.0, 2, 1)], rooms=3)
    result = run(outage(world, link))
    assert result.done
    assert [(e.robot, e.detail) for e in result.at("comms-lost")] == [(0, link), (1, link)]
    assert {e.time for e in result.at("comms-back")} == {result.at("comms-back")[0].time}
    if link == "dispatcher":
        late = result.at("assigned", task=2)[0]
        assert 23.0 <= late.time <= 24.0


@pytest.mark.slow
def test_robots_that_join_late_take_what_waits():
    world = ward([0, 1], [(0, 0, 2), (0, 1, 0)], rooms=3)
    late = tuple(dataclasses.replace(r, joins_at=15.0) for r in world.robots)
    result = run(dataclasses.replace(world, robots=late))
    assert result.done
    assert min(e.time for e in result.at("assigned")) >= 15.0


def test_a_blocked_corridor_is_planned_again_and_used_when_it_opens():
    world = ward([0], [(0, 0, 3)], rooms=4)
    wall = Blockage(name="bed", polygon=rectangle(0.4, 6.0, (10.0, 2.0)), start=4.0, end=30.0)
    result = run(dataclasses.replace(world, events=(wall,)))
    assert result.done
    lost = result.at("no-path")[0].time
    found = next(e.time for e in result.at("replanned") if e.time > lost)
    assert lost < 15.0
    assert 30.0 <= found < 30.2


@pytest.mark.slow
def test_an_unreachable_room_stops_one_robot_only():
    layout = ward_layout(rooms=3)
    door = Wall(
        name="bricks", polygon=rectangle(1.6, 0.3, tuple(layout.rooms[1].door.mean(axis=0)))
    )
    layout = dataclasses.replace(layout, walls=(*layout.walls, door))
    world = ward([0, 2], [(0, 0, 1), (0, 2, 0), (5, 0, 2)], layout=layout, horizon=70.0)
    result = run(world)
    assert [(e.robot, e.detail) for e in result.at("no-path")] == [(0, "unreachable")]
    assert {e.task for e in result.at("dropped-off")} == {1, 2}
    assert result.last.intent.phase[0] == Phase.PLANNING


# --- memory ------------------------------------------------------------------------------


def recorded(world, ticks):
    """What a stack was told in a run, tick by tick."""
    episode, fleets = Episode(world, KINEMATIC), []
    step = episode.stack.step

    def listen(state, fleet):
        fleets.append(fleet)
        return step(state, fleet)

    episode.stack.step = listen
    frames = episode.frames()
    for _ in range(ticks):
        next(frames)
    frames.close()
    return Episode(world, KINEMATIC).stack, fleets


def outputs(stack, state, fleets: list[FleetState]):
    seen = []
    for fleet in fleets:
        state, command, intent, events = stack.step(state, fleet)
        seen.append((command.twist.tobytes(), intent.goal.tobytes(), events, state.digest()))
    return seen


def test_a_forked_memory_continues_exactly_like_the_original():
    world = outage(ward([0, 1, 2], [(0, 0, 2), (0, 1, 2), (6, 2, 0)], rooms=3), "states")
    wall = Blockage(name="bed", polygon=rectangle(0.4, 2.0, (10.0, 1.0)), start=9.0, end=14.0)
    world = dataclasses.replace(world, events=(*world.events, wall))
    stack, fleets = recorded(world, 400)
    straight = outputs(stack, stack.start(), fleets)
    state = stack.start()
    for fleet in fleets[:170]:
        state, *_ = stack.step(state, fleet)
    fork, again = copy.deepcopy(state), copy.deepcopy(state)
    assert fork.digest() == state.digest()
    rest = fleets[170:]
    # both forks take turns on the same stack
    pairs = []
    for fleet in rest:
        state, command, *_ = stack.step(state, fleet)
        fork, other, *_ = stack.step(fork, fleet)
        pairs.append((command.twist.tobytes(), other.twist.tobytes()))
    assert all(a == b for a, b in pairs)
    assert [a for a, _ in pairs] == [row[0] for row in straight[170:]]
    assert outputs(stack, again, rest) == straight[170:]


def test_the_digest_of_the_memory_sees_the_smallest_change():
    stack, fleets = recorded(ward([0], [(0, 0, 1)], rooms=2), 40)
    state = stack.start()
    for fleet in fleets:
        state, *_ = stack.step(state, fleet)
    other = copy.deepcopy(state)
    other.missions[0].way.path[-1, 0] = np.nextafter(other.missions[0].way.path[-1, 0], np.inf)
    assert other.digest() != state.digest()
