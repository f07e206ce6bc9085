"""Nav2 maps: round trips, levels, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.nav2 import (
    OccupancyGrid,
    occupancy_of,
    read_nav2_map,
    write_costs,
    write_nav2_map,
    write_occupancy,
)
from simulator_interface.formats.written import number_in

TEXT = (
    "image: {image}\nmode: {mode}\nresolution: 0.05\norigin: [-1.5, 2.0, 0]\nnegate: {negate}\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
)


def write_map(folder: Path, pixels, *, mode="trinary", negate=0, text=TEXT, image="m.pgm") -> Path:
    pixels = np.asarray(pixels, dtype=np.uint8)
    (folder / "m.pgm").write_bytes(
        b"P5\n# a comment\n%d %d\n255\n" % pixels.shape[::-1] + pixels.tobytes()
    )
    (folder / "m.yaml").write_text(text.format(mode=mode, negate=negate, image=image))
    return folder / "m.yaml"


def costmap_of(cost) -> Costmap:
    return Costmap(np.asarray(cost, dtype=np.uint8), 0.05, np.array([-12.5, -35.0]))


@settings(max_examples=20, deadline=None)
@given(arrays(np.uint8, (5, 7), elements=st.sampled_from([0, 1, 99, 252, 253, 254, 255])))
def test_writing_and_reading_a_raw_map_keeps_every_published_value(tmp_path_factory, cost):
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    write_nav2_map(costmap_of(cost), path, mode="raw")
    grid = read_nav2_map(path)
    np.testing.assert_array_equal(grid.data, occupancy_of(costmap_of(cost)).data)
    assert grid.resolution == 0.05
    assert grid.origin.tolist() == [-12.5, -35.0]


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_a_map_read_and_written_again_is_equal_byte_for_byte(tmp_path, mode):
    values = [[0, 100, 0], [100, 100, 0]] if mode == "trinary" else [[0, 1, 50], [98, 99, 100]]
    grid = OccupancyGrid(
        data=np.array(values, dtype=np.int8), resolution=0.1, origin=np.array([1.0, 2.5])
    )
    paths = [tmp_path / "a" / "m.yaml", tmp_path / "b" / "m.yaml"]
    for path in paths:
        path.parent.mkdir()
    write_occupancy(grid, paths[0], mode=mode)
    again = read_nav2_map(paths[0])
    np.testing.assert_array_equal(again.data, grid.data)
    write_occupancy(again, paths[1], mode=mode)
    for suffix in (".yaml", ".pgm"):
        one, two = (path.with_suffix(suffix).read_bytes() for path in paths)
        assert one == two


def test_every_value_from_0_to_100_survives_scale_mode(tmp_path):
    grid = OccupancyGrid(
        data=np.arange(101, dtype=np.int8)[None], resolution=0.1, origin=np.zeros(2)
    )
    write_occupancy(grid, tmp_path / "m.yaml", mode="scale")
    np.testing.assert_array_equal(read_nav2_map(tmp_path / "m.yaml").data, grid.data)


def test_unknown_cells_survive_trinary_mode_and_are_refused_in_scale_mode(tmp_path):
    costmap = costmap_of([[255, 254], [253, 0]])
    write_nav2_map(costmap, tmp_path / "m.yaml")
    assert read_nav2_map(tmp_path / "m.yaml").data.tolist() == [[-1, 100], [0, 0]]
    with pytest.raises(FormatError, match="1 cells are unknown; mode scale"):
        write_nav2_map(costmap, tmp_path / "m.yaml", mode="scale")


def test_a_turned_map_keeps_its_angle(tmp_path):
    grid = OccupancyGrid(
        data=np.array([[0, 100]], dtype=np.int8), resolution=0.1, origin=np.zeros(2), yaw=0.25
    )
    write_occupancy(grid, tmp_path / "m.yaml")
    assert read_nav2_map(tmp_path / "m.yaml").yaw == 0.25


def test_the_first_row_of_the_picture_is_the_northernmost(tmp_path):
    grid = read_nav2_map(write_map(tmp_path, [[0, 0, 0], [254, 254, 254]]))
    assert grid.data.tolist() == [[0, 0, 0], [100, 100, 100]]
    write_costs(costmap_of([[1, 2], [3, 4]]), tmp_path / "c.pgm")
    assert (tmp_path / "c.pgm").read_bytes() == b"P5\n2 2\n255\n\x03\x04\x01\x02"


def test_grey_levels_follow_the_thresholds_of_nav2(tmp_path):
    # p = (255 - grey) / 255: 0.647 unknown, 0.651 occupied, 0.251 unknown, 0.247 free
    pixels = [[90, 89, 191, 192]]
    assert read_nav2_map(write_map(tmp_path, pixels)).data.tolist() == [[-1, 100, -1, 0]]
    assert read_nav2_map(write_map(tmp_path, pixels, mode="scale")).data.tolist() == [
        [99, 100, 0, 0]
    ]
    assert read_nav2_map(write_map(tmp_path, [[0, 100, 101]], mode="raw")).data.tolist() == [
        [0, 100, -1]
    ]
    assert read_nav2_map(write_map(tmp_path, [[254, 0]], negate=1)).data.tolist() == [[100, 0]]
    assert read_nav2_map(write_map(tmp_path, [[254, 0]], negate="true")).data.tolist() == [[100, 0]]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("origin: [-1.5, 2.0, 0]", "origin: [0, 0]", "origin has shape"),
        ("resolution: 0.05", "resolution: -1", "resolution is -1.0 m; it must be > 0"),
        ("resolution: 0.05", "resolution: .nan", "resolution is nan m; it must be finite"),
        ("resolution: 0.05\n", "", "resolution is missing"),
        ("{mode}", "fancy", "mode is 'fancy'; it must be one of 'trinary', 'scale', 'raw'"),
        ("{image}", "map.gif", "it must be a .pgm, .png, .bmp file"),
        ("{image}", "none.pgm", "cannot be read: No such file"),
        ("{negate}", "2", "negate is 2; it must be 0 or 1"),
        ("free_thresh: 0.25", "free_thresh: 0.7", "free_thresh is 0.7; it must be below"),
        ("mode: {mode}", "mode: [trinary]", r"mode is \['trinary'\]; it must be one of"),
        ("resolution: 0.05", "resolution: fine", "resolution is 'fine'; it must be a number"),
        ("{image}", "../m.gif", "must lie in the folder of this file"),
    ],
)
def test_a_broken_description_is_refused_in_words(tmp_path, old, new, said):
    path = write_map(tmp_path, [[0]], text=TEXT.replace(old, new))
    with pytest.raises(FormatError, match=said):
        read_nav2_map(path)


@pytest.mark.parametrize(
    ("line", "note"),
    [
        ("sensor_height: 0.7", "sensor_height of the map is not used"),
        ("frame_id: map\nmap_frame: 1", "frame_id and map_frame of the map are not used"),
        ("mod: raw", "mod of the map is not used (did you mean mode?)"),
        ("0: raw", "0 of the map is not used"),
    ],
)
def test_what_nav2_does_not_read_is_told_in_one_note(tmp_path, line, note):
    grid = read_nav2_map(write_map(tmp_path, [[254, 0]], text=f"{TEXT}{line}\n"))
    assert grid.data.tolist() == [[0, 100]]
    assert grid.notes == (note,)


def test_numbers_are_read_as_nav2_reads_them(tmp_path):
    text = TEXT.replace("0.05", "5e-2").replace("-1.5", '"-1.5"').replace("{mode}", "Trinary")
    grid = read_nav2_map(write_map(tmp_path, [[254, 0]], negate="yes", text=text))
    assert (grid.resolution, grid.origin.tolist(), grid.notes) == (0.05, [-1.5, 2.0], ())
    assert grid.data.tolist() == [[100, 0]]


@pytest.mark.parametrize(
    ("written", "number"),
    [("1_000", 1000.0), ("1_", 1.0), ("-.INF", -math.inf), ("1e1_", None), ("_1", None)],
)
def test_underscores_in_numbers_are_those_of_yaml(written, number):
    assert number_in(written) == number


@pytest.mark.parametrize("image", ["/home/them/maps/m.pgm", "maps/m.pgm", "../m.pgm"])
def test_a_picture_named_as_on_another_machine_is_read_beside_the_map(tmp_path, image):
    grid = read_nav2_map(write_map(tmp_path, [[254, 0]], image=image))
    assert grid.data.tolist() == [[0, 100]]
    assert grid.notes == (f"the map's image {image} was read as m.pgm beside the map",)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"P5\n", "is a broken picture"),
        (b"", "is not a picture"),
        (b"P5\n4 4\n255\n\0\0\0", "is a broken picture"),
        (b"P5\n1 1\n65535\n\0\0", "more than 8 bits per channel"),
        (b"P5\n5000 5000\n255\n", "25000000 pixels; 1 to"),
        (b"P5\n999999 999999\n255\n", "too many pixels"),
    ],
)
def test_a_broken_picture_is_refused_in_words(tmp_path, content, said):
    path = write_map(tmp_path, [[0]])
    (tmp_path / "m.pgm").write_bytes(content)
    with pytest.raises(FormatError, match=said):
        read_nav2_map(path)
