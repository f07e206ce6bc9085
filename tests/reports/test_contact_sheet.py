"""Pictures of sampled worlds."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from matplotlib.image import imread

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import (
    Blockage,
    CommsOutage,
    Furniture,
    HumanSpec,
    RobotSpec,
    Task,
    World,
)
from mrta_falsify.testing.wards import ward_layout
from reports import contact_sheet, schedule_plot
from reports.colours import PAINTS, robot_colour
from reports.floor_scene import Extent, Role, start_of


def world_with_bed_at(x: float, **changes) -> World:
    layout = ward_layout(rooms=2)
    bed = Furniture(
        name="bed", kind="bed", polygon=frozen_array(rectangle(1.0, 0.6) + np.array([x, 1.5]))
    )
    robot = RobotSpec(name="robot1", pose=frozen_array([*layout.rooms[0].point, 0.0]))
    world = dataclasses.replace(
        layout,
        furniture=(*layout.furniture, bed),
        robots=(robot,),
        humans=(HumanSpec(name="$x_1$", route=frozen_array([[1.0, 1.0], [3.0, 1.2]])),),
        tasks=(Task(arrival=0.0, start=0, end=1, deadline=100.0),),
    )
    return dataclasses.replace(world, **changes)


def colours_of(path) -> set[tuple[int, int, int]]:
    image = (imread(path)[..., :3] * 255).round().astype(int)
    return set(map(tuple, image.reshape(-1, 3)))


def rgb(colour: str) -> tuple[int, int, int]:
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


def test_furniture_that_moves_between_worlds_is_in_colour_and_the_rest_pale(tmp_path):
    path = tmp_path / "sheet.png"
    worlds = [world_with_bed_at(2.0), world_with_bed_at(3.0)]
    contact_sheet.write_contact_sheet(worlds, path, title="beds", captions=["000", "001"])
    assert rgb(PAINTS[Role.SAMPLED_FURNITURE].fill) in colours_of(path)
    same = [worlds[0], worlds[0]]
    contact_sheet.write_contact_sheet(same, path, title="beds", captions=["000", "001"])
    assert rgb(PAINTS[Role.SAMPLED_FURNITURE].fill) not in colours_of(path)
    assert rgb(robot_colour(0)) in colours_of(path)


def test_equal_worlds_give_equal_files(tmp_path):
    for name in ("a.png", "b.png"):
        contact_sheet.write_contact_sheet(
            [world_with_bed_at(2.0)], tmp_path / name, title="one", captions=["000"]
        )
        contact_sheet.write_world_picture(world_with_bed_at(2.0), tmp_path / f"world_{name}")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "world_a.png").read_bytes() == (tmp_path / "world_b.png").read_bytes()


def test_events_are_drawn_in_their_time(tmp_path):
    polygon = frozen_array(rectangle(1.0, 0.6) + np.array([2.0, 1.5]))
    events = (
        Blockage(name="bed_1", polygon=polygon, start=20.0, end=1e9),
        CommsOutage(name="outage", robots=(), start=5.0, end=50.0),
    )
    world = world_with_bed_at(4.0, events=events)
    path = tmp_path / "world.svg"
    contact_sheet.write_world_picture(world, path, title="a $title$")
    assert path.stat().st_size > 1000
    assert schedule_plot.last_time(world) == 100.0


@pytest.mark.parametrize("count", [1, 2, 5, 8, 24])
def test_panels_fill_the_sheet_and_fit_on_it(count):
    grid = contact_sheet.plan_grid(count, Extent(0.0, 0.0, 25.0, 40.0), 6)
    width, height = grid.size
    assert grid.columns * grid.rows >= count
    assert grid.columns * grid.rows - count < grid.columns
    assert width <= contact_sheet.SHEET_WIDTH + 2 * contact_sheet.GAP
    assert height > grid.rows * grid.map_height


def test_a_world_without_anything_in_it_is_drawn_too(tmp_path):
    empty = World(name="empty", bounds=frozen_array([0.0, 0.0, 4.0, 3.0]))
    contact_sheet.write_contact_sheet([empty], tmp_path / "s.png", title="e", captions=["0"])
    contact_sheet.write_world_picture(empty, tmp_path / "w.png")
    assert (tmp_path / "s.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("share", "repeat", "expected"),
    [(0.0, False, (0.0, 0.0)), (0.5, False, (2.0, 0.0)), (0.75, True, (2.0, 0.0))],
)
def test_a_person_begins_at_its_share_of_the_route(share, repeat, expected):
    route = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert start_of(route, share, repeat=repeat) == pytest.approx(expected)
