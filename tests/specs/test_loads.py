"""Loads: how much a run asked of the stack."""

import numpy as np
import pytest
from frames import DT, Robot, Script

from mrta_falsify.core.feedback import LOADS
from mrta_falsify.specs.descriptors import Descriptors


def loads(script: Script) -> dict[str, float]:
    world = script.world()
    found = Descriptors(world, DT)
    for frame in script.frames(world):
        found.update(frame)
    return {name: found.values()[name] for name in LOADS}


def line(waiting: int, robots: int = 4, seconds: float = 20.0, apart: float = 0.6) -> Script:
    """The first robot stands in the way for good; ``waiting`` ones behind it want to pass."""
    stand = [Robot((0.0, 0.0), goal=(0.0, 0.0), path=())]
    for i in range(1, robots):
        goes = i <= waiting
        place = (-apart * i, 0.0) if goes else (-apart * i, 4.0)
        path = (place, (6.0, 0.0)) if goes else ()
        stand.append(Robot(place, goal=(6.0, 0.0) if goes else place, path=path))
    return Script(stand, seconds=seconds)


def test_a_run_in_which_nobody_waits_has_no_queue():
    quiet = loads(line(0))
    assert quiet["queue"] == quiet["waiting"] == quiet["chain"] == quiet["waited"] == 0.0


def test_each_load_grows_with_the_robots_that_wait():
    few, many = loads(line(1)), loads(line(3))
    for name in ("waiting", "chain", "waited"):
        assert 0.0 < few[name] < many[name], name


def test_waiting_counts_the_more_the_longer_it_lasts():
    short, long = loads(line(2, seconds=4.0)), loads(line(2, seconds=30.0))
    assert short["waiting"] < long["waiting"] <= 0.5
    assert short["waited"] < long["waited"]


def test_a_crowd_counts_who_is_near():
    near, far = loads(line(3, apart=0.5)), loads(line(3, apart=3.0))
    assert near["crowd"] > 2.0 * far["crowd"]


def test_loads_are_shares_of_the_fleet():
    small, large = loads(line(2, robots=3)), loads(line(2, robots=8))
    assert large["chain"] == pytest.approx(small["chain"] * 3.0 / 8.0)
    assert all(0.0 <= value <= 1.0 for value in (*small.values(), *large.values()))
    assert np.isfinite([*small.values()]).all()
