"""Furniture that people push is shown where it stands at the time shown."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PIL import Image

from reports import animation, run_picture
from reports.colours import PAINTS
from reports.contents import RunView
from reports.floor_drawings import draw_moment
from reports.floor_scene import Role, furniture_poses, movable_outlines
from reports.packing import pack
from tests.reports.test_packing import unpack


@pytest.fixture
def pushed(hall, hall_trace):
    """The hall with its table on wheels, and a run in which it goes 1 m east and turns."""
    table = dataclasses.replace(hall.furniture[0], movable=True)
    world = dataclasses.replace(hall, furniture=(table,))
    share = np.linspace(0.0, 1.0, len(hall_trace))
    pose = np.column_stack(
        [table.center[0] + share, np.full_like(share, table.center[1]), share * np.pi / 2.0]
    )
    columns = {**hall_trace.columns, "furniture_pose": pose[:, None, :]}
    return world, dataclasses.replace(hall_trace, columns=columns)


def test_furniture_is_where_the_trace_says(pushed):
    world, trace = pushed
    table = world.furniture[0]
    np.testing.assert_allclose(movable_outlines(world, trace, 0)[0], table.polygon)
    (last,) = movable_outlines(world, trace, -1)
    np.testing.assert_allclose(
        0.5 * (last.min(axis=0) + last.max(axis=0)), table.center + np.array([1.0, 0.0])
    )
    np.testing.assert_allclose(np.ptp(last, axis=0), np.ptp(table.polygon, axis=0)[::-1])


def test_a_trace_that_does_not_say_leaves_furniture_at_its_first_place(pushed, hall_trace):
    world, _ = pushed
    poses = furniture_poses(world, hall_trace)
    assert poses.shape == (len(hall_trace), 1, 3)
    np.testing.assert_allclose(poses[-1, 0], [*world.furniture[0].center, 0.0])


def test_picture_and_floor_plan_show_the_last_place(pushed, hall_trace):
    world, trace = pushed
    (outline,) = movable_outlines(world, trace, -1)
    figure = run_picture.draw_run(RunView(world=world, trace=trace))
    shown = [
        path.vertices[: len(outline)]
        for collection in figure.axes[0].collections
        for path in collection.get_paths()
    ]
    assert any(points.shape == outline.shape and np.allclose(points, outline) for points in shown)
    assert draw_moment(world, trace, trace.duration) != draw_moment(
        world, hall_trace, trace.duration
    )
    assert draw_moment(world, trace, 0.0) == draw_moment(world, hall_trace, 0.0)


def test_an_animation_moves_the_furniture(pushed, tmp_path):
    world, trace = pushed
    robots = np.full_like(trace.columns["pose"], 1e3)  # out of the picture
    people = np.full_like(trace.columns["human_position"], np.nan)
    columns = {**trace.columns, "pose": robots, "human_position": people}
    view = RunView(world=world, trace=dataclasses.replace(trace, columns=columns))
    animation.write_gif(view, tmp_path / "run.gif")
    colour = tuple(int(PAINTS[Role.FURNITURE].fill[k : k + 2], 16) for k in (1, 3, 5))
    places = []
    with Image.open(tmp_path / "run.gif") as image:
        for frame in (0, image.n_frames - 1):
            image.seek(frame)
            pixels = np.asarray(image.convert("RGB")).astype(int)
            rows, cols = np.nonzero((np.abs(pixels - colour) <= 3).all(axis=2))
            places.append((cols.mean(), np.ptp(cols), np.ptp(rows)))
    assert places[1][0] > places[0][0] + 20.0
    assert places[0][1] > places[0][2]
    assert places[1][1] < places[1][2]


def test_the_replay_of_a_page_has_every_place(pushed):
    world, trace = pushed
    data = unpack(pack(world, trace, ()))
    assert all(role != Role.FURNITURE for role, *_ in data["world"]["scene"])
    ((name, _, outline),) = data["world"]["pieces"]
    assert name == world.furniture[0].name
    local = np.array(outline).reshape(-1, 2) / 100.0
    np.testing.assert_allclose(
        local, world.furniture[0].polygon - world.furniture[0].center, atol=0.0051
    )
    ticks = np.round(np.array(data["time"]) / trace.dt).astype(int)
    wanted = trace.columns["furniture_pose"][ticks]
    np.testing.assert_allclose(data["pieces"] / 100.0, wanted[:, :, :2], atol=0.0051)
    np.testing.assert_allclose(
        data["pieces_turn"] / 256.0 * 2.0 * np.pi, wanted[:, :, 2], atol=0.013
    )
