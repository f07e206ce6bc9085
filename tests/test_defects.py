"""Each planted defect is caught by its specification in a world that the default stack passes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapely.geometry import Point, Polygon

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.defects import defect_names
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.plane import signed_distances
from mrta_falsify.core.world import Resource, RobotSpec
from mrta_falsify.specs.exclusive import ExclusiveUse
from mrta_falsify.specs.library import build_specifications
from mrta_falsify.testing.planted import EXCLUSIVE_USE, PLANTS
from mrta_falsify.testing.wards import ward_layout
from simulator_interface.simulate import simulate

BESIDE = np.array([0.7, 0.0])  # m, where a second robot stands in a room


def _judged(plant, *, planted):
    """Verdict of the plant's specification; the run ends when it is decided."""
    (specification,) = build_specifications((plant.specification,))
    config = StackConfig(engine=Choice("kinematic"), defects=(plant.defect,) if planted else ())

    def decided(frame: Frame) -> str:
        return "decided" if planted and specification.verdict().violated else ""

    simulate(
        plant.world(0), config, specifications=(specification,), keep_trace=False, stop=decided
    )
    return specification.verdict()


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
def test_the_right_specification_catches_the_defect_and_the_default_stack_passes(name):
    plant = PLANTS[name]
    assert not _judged(plant, planted=False).violated
    assert _judged(plant, planted=True).violated


def test_every_planted_defect_has_a_test_world():
    assert set(PLANTS) == set(defect_names())


@pytest.mark.parametrize("name", PLANTS)
def test_variants_of_a_test_world_differ_and_can_be_made_again(name):
    world = PLANTS[name].world
    digests = [world(seed).digest() for seed in range(5)]
    assert len(set(digests)) == 5
    assert world(3).digest() == digests[3]


# --- the specification that defects of queues need -------------------------------------


def _ward(robots):
    fleet = tuple(
        RobotSpec(name=f"robot{i + 1}", pose=frozen_array([1.0 + i, 1.0, 0.0]))
        for i in range(robots)
    )
    return dataclasses.replace(ward_layout(rooms=2), robots=fleet)


class _At:
    """As much of a frame as the specification looks at."""

    def __init__(self, time, *places, served=()):
        self.sensed = self
        self.time = time
        self.served = np.array(served or [0] * len(places))
        self.pose = np.array([[x, y, 0.0] for x, y in places])


def _exclusive(world, *frames):
    specification = ExclusiveUse(ExclusiveUse.Options())
    specification.start(world, 0.05)
    for frame in frames:
        specification.update(frame)
    return specification.verdict()


def test_a_room_with_two_robots_in_it_is_reported_with_their_names():
    world = _ward(3)
    room, corridor = world.rooms[0].point, np.array([8.0, 1.0])
    apart = _At(0.0, room, corridor, corridor + BESIDE)
    together = _At(1.0, room, corridor, room + BESIDE)
    verdict = _exclusive(world, apart, together, apart)
    assert verdict.violated
    assert verdict.violated_at == 1.0
    assert verdict.who == ("robot1", "robot3")
    assert verdict.evidence["resource"] == world.resources[0].name


def test_robustness_is_the_distance_of_the_robot_that_would_be_one_too_many():
    world = _ward(2)
    room, wall = world.rooms[0].point, world.rooms[0].area[:, 1].min()
    near, nearer = (_At(t, room, (room[0], wall - d)) for t, d in ((0.0, 0.5), (1.0, 0.4)))
    verdict = _exclusive(world, near, nearer)
    assert not verdict.violated
    assert verdict.robustness == pytest.approx(0.4)


def test_a_room_that_begins_overfull_is_judged_from_when_it_is_not():
    world = _ward(2)
    room, outside = world.rooms[0].point, np.array([8.0, 1.0])
    both = _At(0.0, room, room + BESIDE)
    assert not _exclusive(world, both, both).violated
    assert _exclusive(world, both, _At(1.0, room, outside), both).violated


@pytest.mark.parametrize("start", [-0.3, 0.002])
def test_how_near_a_robot_starts_counts_once_it_comes_nearer(start):
    world = _ward(2)
    room, wall = world.rooms[0].point, world.rooms[0].area[:, 1].min()

    def robustness(*distances: float) -> float:
        places = ((room[0], wall - d) for d in (start, *distances))
        frames = (_At(float(t), room, place) for t, place in enumerate(places))
        return _exclusive(world, *frames).robustness

    of_the_other_room = robustness()
    assert robustness(0.1, 0.5, 1.5) == of_the_other_room > 1.5
    assert robustness(0.1, 0.5, 1.5, 0.8) == pytest.approx(0.8)
    assert robustness(0.1, -0.2) == pytest.approx(-0.2)


def test_capacity_counts():
    world = _ward(2)
    roomy = dataclasses.replace(world.resources[0], capacity=2)
    world = dataclasses.replace(world, resources=(roomy, *world.resources[1:]))
    room = world.rooms[0].point
    far = np.array([8.0, 1.0])
    assert not _exclusive(world, _At(0.0, room, far), _At(1.0, room, room + BESIDE)).violated


def test_a_room_that_is_free_once_its_robot_is_served_has_room_for_the_next():
    world = _ward(2)
    rooms = tuple(dataclasses.replace(r, hold="until_served") for r in world.resources)
    world = dataclasses.replace(world, resources=rooms)
    room, outside = world.rooms[0].point, np.array([8.0, 1.0])
    alone, both = (room, outside), (room, room + BESIDE)
    first = _At(0.0, outside, outside), _At(1.0, *alone)
    assert _exclusive(world, *first, _At(2.0, *both)).violated
    served = _At(2.0, *alone, served=(1, 0)), _At(3.0, *both, served=(1, 0))
    assert not _exclusive(world, *first, *served).violated


def test_a_corridor_that_is_free_after_its_service_time_may_be_followed_into():
    area = rectangle(4.0, 4.0, (8.0, 0.0))
    lane = Resource(
        name="lane",
        kind="corridor",
        request_area=area,
        release_area=area,
        hold="until_served",
        service_time=2.0,
    )
    world = dataclasses.replace(_ward(2), resources=(lane,))
    inside, outside = (8.0, 0.0), (1.0, 1.0)
    enters = _At(0.0, outside, outside), _At(1.0, inside, outside)
    soon, late = (_At(time, inside, (8.5, 0.5)) for time in (2.9, 3.0))
    assert _exclusive(world, *enters, soon).violated
    assert not _exclusive(world, *enters, late).violated
    held = dataclasses.replace(world, resources=(dataclasses.replace(lane, hold="until_left"),))
    assert _exclusive(held, *enters, late).violated


def test_signed_distances_agree_with_shapely():
    polygon = np.array([[0, 0], [4, 0], [4, 3], [2, 1], [0, 3]], dtype=float)
    points = np.random.default_rng(1).uniform(-1, 5, (200, 2))
    shape = Polygon(polygon)
    expected = [
        shape.exterior.distance(Point(p)) * (-1 if shape.contains(Point(p)) else 1) for p in points
    ]
    assert signed_distances(polygon, points) == pytest.approx(np.array(expected))


def test_the_specification_can_be_named_by_its_class():
    (specification,) = build_specifications((EXCLUSIVE_USE,))
    assert isinstance(specification, ExclusiveUse)
