"""Every scene has its picture, and the moments it shows exist."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mrta_falsify.testing.watching import watch, went_well
from tests.scenes.moments import SCENES
from tests.scenes.pictures import FOLDER

QUICK = ("idle_robots_make_room", "queue_tail_then_place")
PAGE = Path(__file__).parents[2] / "docs" / "zoo.md"


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_moments_of_a_scene_come_in_order_and_within_its_run(scene):
    outcome = watch(scene.world(), *scene.settings)
    times = [moment.time for moment in scene.moments(scene.world(), outcome.trace)]
    assert times == sorted(times)
    assert times[0] >= 0.0
    assert times[-1] <= outcome.sim_time


def test_page_shows_every_picture_and_every_picture_is_there():
    page = PAGE.read_text(encoding="utf-8")
    for scene in SCENES:
        assert f"(pictures/scenes/{scene.name}.png)" in page
        assert (FOLDER / f"{scene.name}.png").is_file()


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(
            scene,
            id=scene.name,
            marks=pytest.mark.slow if scene.name in QUICK else pytest.mark.long,
        )
        for scene in SCENES
    ],
)
def test_scene_goes_well_in_bullet(scene):
    assert went_well(watch(scene.world(), *scene.settings, engine="bullet"))


@pytest.mark.long
def test_script_draws_a_picture(tmp_path):
    code = (
        "import pathlib, sys; from tests.scenes import pictures;"
        "pictures.FOLDER = pathlib.Path(sys.argv[1]); pictures.main(['idle_robot_moved_aside'])"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path], cwd=PAGE.parents[1], check=True)
    assert (tmp_path / "idle_robot_moved_aside.png").stat().st_size > 10_000
