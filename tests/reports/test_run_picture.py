from __future__ import annotations

import dataclasses

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import _pylab_helpers
from PIL import Image

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage
from reports import run_picture
from reports.colours import costmap_image, robot_colour
from reports.contents import RunView
from reports.run_picture import runs_of


@pytest.fixture
def view(hall, hall_trace):
    verdicts = (
        Verdict(spec="no_deadlock", robustness=-3.0, violated=True, violated_at=4.0, who=("a",)),
        Verdict(spec="human_clearance", robustness=np.inf, violated=False),
    )
    cost = np.zeros((100, 140), dtype=np.uint8)
    cost[10, 10:20] = LETHAL
    return RunView(
        world=hall,
        trace=hall_trace,
        verdicts=verdicts,
        costmap=Costmap(cost, 0.1, frozen_array([-0.5, -0.5])),
        facts=(("simulated", "10.0 s"),),
    )


def _texts(figure):
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_the_picture_names_rooms_robots_and_verdicts(view):
    texts = _texts(run_picture.draw_run(view))
    assert {"0 store", "1 ward", "robot1", "no_deadlock", "violated", "holds", "-3"} <= set(texts)
    assert "unbounded" in texts
    assert "at 4.0 s  a" in texts


def test_stops_that_have_no_room_above_a_place_are_counted(view, monkeypatch):
    assert "+1" not in _texts(run_picture.draw_run(view))
    monkeypatch.setattr(run_picture, "MAX_STOPS", 0)
    assert "+1" in _texts(run_picture.draw_run(view))


def test_equal_runs_give_equal_pictures(view, tmp_path):
    run_picture.write_picture(view, tmp_path / "a.png")
    run_picture.write_picture(view, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert min(image.size) > 600


def test_drawing_leaves_no_global_figure_and_no_changed_setting(view, tmp_path):
    before = dict(mpl.rcParams)
    run_picture.write_picture(view, tmp_path / "a.png")
    assert _pylab_helpers.Gcf.figs == {}
    assert dict(mpl.rcParams) == before


def test_a_run_without_a_kept_trace_is_drawn_from_the_world(view):
    bare = dataclasses.replace(view.trace, columns={}, events=(), paths=(), edges=())
    texts = _texts(run_picture.draw_run(dataclasses.replace(view, trace=bare, costmap=None)))
    assert "robot2" in texts


def test_a_blockage_is_labelled_with_its_time(view):
    event = Blockage(name="b", polygon=rectangle(1.0, 1.0, (3.0, 3.0)), start=5.0, end=25.0)
    world = dataclasses.replace(view.world, events=(event,))
    assert "blocked 5-25 s" in _texts(run_picture.draw_run(dataclasses.replace(view, world=world)))


def test_room_names_are_text_not_formulas(view, tmp_path):
    room = dataclasses.replace(view.world.rooms[0], name="Dr. $\\frac Who_1^2$ & <b>")
    world = dataclasses.replace(view.world, rooms=(room, view.world.rooms[1]))
    run_picture.write_picture(dataclasses.replace(view, world=world), tmp_path / "a.png")


def test_costmap_colours_tell_free_inflated_inscribed_lethal_and_unknown_apart():
    cost = np.array([[0, 120, INSCRIBED, LETHAL, UNKNOWN]], dtype=np.uint8)
    image = costmap_image(Costmap(cost, 0.05, frozen_array([0.0, 0.0])))
    assert image.shape == (1, 5, 3)
    assert len({tuple(colour) for colour in image[0]}) == 5


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ([], []),
        ([0, 0], []),
        ([1], [(0, 0)]),
        ([1, 1, 0, 1], [(0, 1), (3, 3)]),
        ([0, 1, 1], [(1, 2)]),
    ],
)
def test_runs_are_first_and_last_index(flags, expected):
    assert runs_of(flags) == expected


def test_robot_colours_are_distinct_for_twelve_robots():
    assert len({robot_colour(number) for number in range(12)}) == 12
