import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import Blockage, HumanSpec, RobotSpec
from mrta_falsify.specs.deadlock.rest import longest_pause
from mrta_falsify.testing.wards import ward_layout
from simulator_interface.episode import Episode
from simulator_interface.people.crowd import Crowd
from simulator_interface.simulate import simulate

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))


def walker(route, **fields):
    return HumanSpec(name="walker", route=frozen_array(route), **fields)


def ward(*humans, **fields):
    robot = RobotSpec(name="robot1", pose=frozen_array([1.0, 3.5, 0.0]))
    changes = {"robots": (robot,), "humans": humans, "horizon": 20.0, **fields}
    return dataclasses.replace(ward_layout(), **changes)


def crowd_of(world):
    source = registry.build("costmap", Choice("layered", {"robot_radius": 0.3})).bind(world)
    return Crowd(
        world=world,
        model=registry.build("human_model", StackConfig().human_model),
        planner=registry.build("planner", Choice("astar")),
        source=source,
        dt=0.05,
    )


def positions(world):
    return np.array([frame.sensed.human_position for frame in take(world)])


def take(world):
    frames = Episode(world, KINEMATIC).frames()
    for frame in frames:
        yield frame
        if frame.sensed.time >= world.horizon:
            frames.close()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75])
def test_a_phase_starts_a_person_that_far_along_the_way(share):
    crowd = crowd_of(ward(walker([[1.0, 2.0], [13.0, 2.0]], start=share)))
    along = 24.0 * share
    expected = 1.0 + (along if along <= 12.0 else 24.0 - along)
    assert crowd.start()[0] == pytest.approx([expected, 2.0], abs=0.2)


def test_a_person_pauses_at_each_point_of_its_route_and_walks_on():
    place = positions(ward(walker([[1.0, 2.0], [4.0, 2.0]], pause=3.0), horizon=14.0))[:, 0]
    step = np.hypot(*np.diff(place, axis=0).T)
    still = np.flatnonzero(step < 1e-3) * 0.05
    first, second = still[still < 8.0], still[still > 8.0]
    assert first.min() == pytest.approx(3.0, abs=1.0)
    assert 1.5 < np.ptp(first) <= 3.05  # it slows down first
    assert place[round(first.min() / 0.05)] == pytest.approx([4.0, 2.0], abs=0.5)
    assert len(second) > 0
    assert place[round(second.min() / 0.05)] == pytest.approx([1.0, 2.0], abs=0.5)


def test_the_longest_pause_counts_those_of_people():
    assert longest_pause(ward(walker([[1.0, 2.0], [4.0, 2.0]], pause=300.0))) == 300.0


def test_people_walk_through_doors_and_come_back():
    world = ward(walker([[7.5, 1.0], [7.5, 6.0]], speed=1.2), horizon=16.0)
    way = positions(world)[:, 0]
    assert way[:, 1].max() > 5.6  # reached the room's far point
    assert way[-1, 1] < 5.0  # and is on the way back


def test_a_blocked_corridor_does_not_let_people_through():
    bed = Blockage(
        name="bed", polygon=frozen_array([[6, 0], [7, 0], [7, 4], [6, 4]]), start=0.0, end=99.0
    )
    world = ward(walker([[3.0, 2.0], [12.0, 2.0]]), events=(bed,))
    assert positions(world)[:, 0, 0].max() < 6.0


def test_a_person_who_left_is_no_longer_perceived():
    world = ward(walker([[9.0, 2.0]], leaves_at=1.0))
    running = Episode(world, KINEMATIC)
    for frame in running.frames():
        seen = running._without_absent(frame.sensed).human_position
        assert np.isfinite(seen).all() == (frame.sensed.time < 1.0)
        if frame.sensed.time > 2.0:
            break


def test_a_model_that_is_no_more_is_refused_only_where_people_walk():
    old = dataclasses.replace(KINEMATIC, human_model=Choice("social_force"))
    world = ward(walker([[3.0, 2.0], [12.0, 2.0]]), horizon=1.0)
    with pytest.raises(UnknownNameError, match=r"'social_force'.*by_sight"):
        simulate(world, old)
    empty = dataclasses.replace(world, humans=())
    assert simulate(empty, old).trace.digest == simulate(empty, KINEMATIC).trace.digest


def test_a_run_is_a_function_of_world_and_configuration():
    world = ward(walker([[3.0, 2.0], [12.0, 2.0]]), horizon=5.0)
    assert simulate(world, KINEMATIC).trace.digest == simulate(world, KINEMATIC).trace.digest
