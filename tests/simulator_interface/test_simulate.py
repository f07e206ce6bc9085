import dataclasses
from types import SimpleNamespace

import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import RobotSpec
from mrta_falsify.testing.wards import ward_layout
from simulator_interface.scenic_bridge.scene_contract import places_of_scene
from simulator_interface.simulate import frames_of, simulate

KINEMATIC = dataclasses.replace(StackConfig(), engine=Choice("kinematic"))


def short_ward():
    robot = RobotSpec(name="robot1", pose=frozen_array([1.0, 3.5, 0.0]))
    return dataclasses.replace(ward_layout(), robots=(robot,), tasks=(), horizon=1.0)


def test_frames_begin_at_0_and_end_at_the_horizon_like_a_simulation():
    times = [frame.sensed.time for frame in frames_of(short_ward(), KINEMATIC)]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(1.0)
    assert len(times) == len(simulate(short_ward(), KINEMATIC).trace)


def test_frames_of_a_scripted_world_need_its_program():
    world = dataclasses.replace(short_ward(), scripted="its compose block")
    with pytest.raises(WorldError, match=r"its compose block; run the program"):
        next(frames_of(world, KINEMATIC))


def test_a_scene_without_a_floor_is_refused_with_the_line_to_add():
    with pytest.raises(WorldError, match=r"begin it with the line `model scenic_worlds\.model`"):
        places_of_scene(SimpleNamespace(params={}))
