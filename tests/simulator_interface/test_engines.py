"""What only single engines do: Bullet's rays, options and window; MuJoCo that is not installed."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.errors import ConfigError, InputError
from mrta_falsify.core.world import Wall
from tests.contracts.test_engine_contract import (
    DT,
    NOBODY,
    build,
    busy_run,
    busy_world,
    drive,
    field_world,
    robot,
)


def test_exact_rays_agree_with_bullets_rays(hall):
    random = np.random.default_rng(3)
    angles = np.sort(random.uniform(0, 2 * np.pi, (12, 5)), axis=1)
    stones = tuple(
        Wall(
            name=f"stone{i}",
            polygon=frozen_array(
                random.uniform([1, 1], [11, 7])
                + 0.3 * np.stack([np.cos(angles[i]), np.sin(angles[i])], axis=1)
            ),
        )
        for i in range(12)
    )
    places = [(1.0, 1.0), (11.0, 7.0), (1.0, 7.0), (11.0, 1.0), (4.0, 1.0), (8.0, 7.2)]
    robots = tuple(
        robot(f"robot{i}", *place, random.uniform(-3, 3)) for i, place in enumerate(places)
    )
    clear = tuple(
        stone
        for stone in stones
        if min(np.hypot(*(stone.polygon.mean(axis=0) - place)) for place in places) > 0.8
    )
    assert len(clear) >= 6
    world = dataclasses.replace(
        hall, walls=hall.walls + clear, robots=robots, humans=(), tasks=(), events=()
    )
    twists = [[0, 0, 0]] * 3 + [[0, 0, 0.5], [0.1, 0, 1.0], [0.1, 0, -1.0]]
    seen = [drive(build("bullet", rays=r), world, twists, ticks=120) for r in ("exact", "bullet")]
    for k in (0, 60, 120):
        exact, bullet = (run[k].obstacle_points for run in seen)
        assert bullet == pytest.approx(exact, abs=2e-3)  # inf equals inf
        assert np.isfinite(exact).mean() > 0.9
    assert (seen[0][-1].pose == seen[1][-1].pose).all()


def test_an_earlier_engine_with_other_options_leaves_no_trace():
    fresh = busy_run("bullet")
    drive(
        build("bullet", contact_margin=0.02, solver_iterations=3),
        busy_world(),
        np.zeros((3, 3)),
        ticks=2,
    )
    assert busy_run("bullet") == fresh


def test_unknown_engine_option_is_refused():
    with pytest.raises(InputError, match="step_size"):
        build("bullet", stepsize=0.1)


def test_window_without_a_display_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(ConfigError, match="no display"):
        build("bullet", gui=True).start(field_world(), DT, NOBODY)


def test_mujoco_that_is_not_installed_is_refused_with_the_extra_that_brings_it(monkeypatch):
    for name in ("mujoco", "mujoco_bodies"):
        monkeypatch.delitem(sys.modules, f"simulator_interface.engines.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"pip install '\.\[mujoco\]'"):
        build("mujoco")
