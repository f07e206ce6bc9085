"""What formulas read off a frame."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.specs.signals import SignalReader
from tests.specs.frames import Robot, Script

GAPS = {"gap_robot": [1.0, 4.0], "gap_static": [2.0, 5.0], "gap_human": [3.0, 60.0]}


@pytest.mark.parametrize(
    ("name", "of_fleet", "of_second"),
    [("d_robot", 1.0, 4.0), ("d_static", 2.0, 5.0), ("d_human", 3.0, 10.0)],
)
def test_each_gap_is_read_from_its_own_column_and_capped(name, of_fleet, of_second):
    script = Script(robots=[Robot((0.0, 0.0)), Robot((5.0, 0.0))], seconds=0.1)
    world = script.world()
    frame = next(iter(script.frames(world)))
    gaps = {column: np.array(values) for column, values in GAPS.items()}
    frame = dataclasses.replace(frame, sensed=dataclasses.replace(frame.sensed, **gaps))
    assert SignalReader(world, (name,), ((name, 1),)).read(frame) == [of_fleet, of_second]
