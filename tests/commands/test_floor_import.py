"""Maps become floors: what is derived, what comes back, what is refused."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy import ndimage

from mrta_falsify.commands.export import export_nav2
from mrta_falsify.commands.floor_import import import_floor
from mrta_falsify.core.costmap import INSCRIBED, LETHAL
from mrta_falsify.core.errors import ConfigError, InputError
from scenic_worlds.layouts import load_layout
from simulator_interface.costmap_layers import CostmapOptions, build_costmap
from simulator_interface.formats.nav2 import read_nav2_map
from tests.drawn_maps import BORDER, PILLAR, ROOMS, ROOMS_TEXT, draw, origin, slam_grid, ward_grid
from tests.scenic_worlds.layout_checks import crowding, lane_clearance, unreachable


@pytest.fixture(scope="module")
def wards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    done = import_floor(draw(folder, ward_grid()), folder / "out")
    return done, load_layout(done.floor)


def aliases(levels: int = 9) -> str:
    """Ten lists of ten lists of ..., written in a line."""
    text = "&p0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"
    for i in range(1, levels):
        text = f"&p{i} [{text}{f', *p{i - 1}' * 9}]"
    return f"parking: {text}\n"


def lethal(world) -> np.ndarray:
    return build_costmap(world).cost == LETHAL


def reachable_with_all_spots_taken(world, radius: float = 0.22) -> list[str]:
    """Rooms whose entrance is cut off when robots wait on all spots of the other rooms."""
    cut_off = []
    for goal, resource in enumerate(world.resources):
        waiting = np.vstack([r.spots for r in world.resources if r is not resource])
        parked = np.vstack([waiting, world.parking])
        options = CostmapOptions(robot_radius=radius)
        costmap = build_costmap(world, parked=parked, options=options)
        parts, _ = ndimage.label(costmap.cost < INSCRIBED)
        cells = costmap.cells(np.array([r.entry[0] for r in world.resources]))
        labels = parts[cells[:, 0], cells[:, 1]]
        if not labels[goal] or len(set(labels.tolist())) > 1:
            cut_off.append(resource.name)
    return cut_off


def test_lanes_queues_and_parking_are_derived_from_a_map(wards):
    done, world = wards
    assert [room.name for room in done.rooms] == list(ROOMS)
    assert done.lanes == len(world.lanes) == 12
    assert all(room.spots == 3 for room in done.rooms)
    assert all(1.1 <= room.door <= 1.5 for room in done.rooms)
    assert done.parking == len(world.parking) >= 4
    assert unreachable(world) == []
    assert lane_clearance(world) >= 0.3
    assert crowding(world) >= 0.6
    assert done.warnings == ()


def test_robots_that_wait_and_park_leave_the_corridor_open(wards):
    assert reachable_with_all_spots_taken(wards[1]) == []


def test_the_lethal_cells_of_the_floor_are_those_of_the_map(wards):
    assert np.array_equal(lethal(wards[1]), ward_grid() != 0)


def test_unknown_cells_are_solid_unless_the_file_says_otherwise(tmp_path):
    path = draw(tmp_path, ward_grid(), rooms=ROOMS_TEXT + "unknown: free\n")
    assert np.array_equal(lethal(load_layout(path)), ward_grid() == 100)


def test_the_same_map_gives_the_same_floor_whatever_its_picture_is(wards, tmp_path):
    for ending, negate in (("pgm", True), ("png", False), ("bmp", True)):
        path = draw(tmp_path / ending, ward_grid(), ending=ending, negate=negate)
        assert load_layout(path).digest() == wards[1].digest()


@pytest.mark.parametrize("yaw", [np.pi / 2.0, 0.5])
def test_a_turned_map_is_the_turned_building(yaw, tmp_path):
    """The corner of the picture stays where it is; everything turns about it."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corner = np.array(origin())
    rooms = {name: turn @ (np.array(point) - corner) + corner for name, point in ROOMS.items()}
    text = "rooms:\n" + "".join(
        f"  - {{name: {name}, point: {point.round(6).tolist()}}}\n" for name, point in rooms.items()
    )
    world = load_layout(draw(tmp_path, ward_grid(), yaw=yaw, rooms=text))
    assert unreachable(world) == []
    assert lane_clearance(world) >= 0.3
    assert reachable_with_all_spots_taken(world) == []
    assert all(1.0 <= np.hypot(*(room.door[1] - room.door[0])) <= 1.6 for room in world.rooms)
    costmap = build_costmap(world)
    pillar = turn @ (np.array(PILLAR) - corner) + corner
    beside = turn @ (np.array(PILLAR) + np.array([0.0, 0.5]) - corner) + corner
    cells = costmap.cells(
        np.array([pillar, beside, world.bounds[:2] + 0.1, world.bounds[2:] - 0.1])
    )
    assert (costmap.cost[cells[:, 0], cells[:, 1]] == LETHAL).tolist() == [True, False, True, True]
    free_area = (costmap.cost != LETHAL).sum() * costmap.resolution**2
    assert free_area == pytest.approx((ward_grid() == 0).sum() * 0.05**2, rel=0.03)


@pytest.mark.slow
def test_a_ragged_map_with_specks_becomes_a_floor_and_its_specks_are_told(tmp_path):
    path = draw(tmp_path, slam_grid())
    done = import_floor(path, tmp_path / "out")
    assert done.map.specks > 20
    assert any("solid specks" in said for said in done.warnings)
    raw = load_layout(done.floor)
    assert unreachable(raw) == []
    assert lethal(raw)[slam_grid() != 0].all()


def test_what_a_ragged_map_has_too_much_may_be_left_out(tmp_path):

    path = draw(tmp_path, slam_grid(), rooms=ROOMS_TEXT + "least_patch: 0.02\n")
    done = import_floor(path, tmp_path / "out")
    assert done.map.specks == 0
    assert done.map.left_out > 20
    world = load_layout(done.floor)
    assert unreachable(world) == []
    assert lane_clearance(world) >= 0.28
    assert reachable_with_all_spots_taken(world) == []
    assert all(room.spots >= 2 for room in done.rooms)
    assert all(1.0 <= room.door <= 1.6 for room in done.rooms)


def test_a_room_may_be_an_area_and_bring_its_own_queue_and_door(tmp_path):
    rooms = ROOMS_TEXT.replace(
        "point: [3.5, 2.0]", "area: [[0.1, 0.1], [7.3, 0.1], [7.3, 3.4], [0.1, 3.4]]"
    ).replace("point: [12.0, 2.0]", "point: [12.0, 2.0], queue: [[10.5, 4.2], [9.4, 4.2]]")
    done = import_floor(
        draw(tmp_path, ward_grid(), rooms=rooms + "parking: [[15.5, 5.5]]\n"), tmp_path / "out"
    )
    lab, ward = done.rooms[:2]
    assert 1.7 <= lab.point[1] <= 1.8  # the middle between its walls
    assert 1.5 < lab.point[0] < 6.0
    assert ward.spots_given
    assert done.parking_given
    world = load_layout(done.floor)
    assert world.resources[1].spots.tolist() == [[10.5, 4.2], [9.4, 4.2]]
    assert world.parking.tolist() == [[15.5, 5.5]]


def test_what_was_derived_can_be_changed_and_imported_again(wards, tmp_path):
    done, world = wards
    data = yaml.safe_load(done.derived.read_text())
    data["rooms"][0]["queue"] = [[5.0, 4.2]]
    changed = tmp_path / "mine.yaml"
    changed.write_text(yaml.safe_dump(data))
    path = draw(tmp_path, ward_grid())
    again = import_floor(path, tmp_path / "out", rooms=changed)
    second = load_layout(again.floor)
    assert second.resources[0].spots.tolist() == [[5.0, 4.2]]
    for one, two in zip(world.resources[1:], second.resources[1:], strict=True):
        assert two.spots == pytest.approx(one.spots, abs=1e-3)
    assert second.parking == pytest.approx(world.parking, abs=1e-3)


def test_the_users_scenario_and_file_of_rooms_are_never_overwritten(tmp_path):
    path = draw(tmp_path, ward_grid())
    first = import_floor(path, tmp_path / "out")
    first.scenario.write_text("mine")
    rooms = first.derived.read_text() + "# mine\n"
    first.derived.write_text(rooms)
    again = import_floor(path, tmp_path / "out", rooms=first.derived)
    assert again.scenario_kept
    assert first.scenario.read_text() == "mine"
    assert again.derived is None
    assert first.derived.read_text() == rooms


def test_a_larger_fleet_keeps_farther_from_everything(tmp_path):
    path = draw(tmp_path, ward_grid(door=1.6))
    world = load_layout(import_floor(path, tmp_path / "out", radius=0.35).floor)
    assert lane_clearance(world) >= 0.35
    assert crowding(world) >= 0.7
    spots = np.vstack([r.spots for r in world.resources])
    gaps = np.hypot(*(spots[:, None] - spots[None]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(spots), dtype=bool)].min() >= 1.1
    assert reachable_with_all_spots_taken(world, 0.35) == []
    assert "with body_radius 0.35" in (tmp_path / "out" / "wards.scenic").read_text()


def test_a_door_too_narrow_for_the_fleet_is_told_with_room_width_and_place(tmp_path):
    path = draw(tmp_path, ward_grid(door=0.6))
    assert len(import_floor(path, tmp_path / "small", radius=0.2).rooms) == 4
    with pytest.raises(InputError) as caught:
        import_floor(path, tmp_path / "large", radius=0.4)
    said = str(caught.value)
    assert "'ward'" in said
    assert "by a robot of 0.4 m radius" in said
    assert "narrows to 0.5" in said or "narrows to 0.6" in said
    assert "every doorway must be at least 0.95 m wide" in said
    assert not (tmp_path / "large").exists()


def test_a_room_without_any_door_is_said_to_be_closed_off(tmp_path):
    grid = ward_grid()
    row = round(7.4 / 0.05) + BORDER + 3
    grid[row, BORDER + 3 : BORDER + 3 + 170] = 100
    with pytest.raises(InputError, match=r"'store' cannot be reached .* closes 'store' off"):
        import_floor(draw(tmp_path, grid), tmp_path / "out")


@pytest.mark.slow
def test_the_aws_hospital_comes_back_through_its_map(tmp_path):
    shipped = load_layout("aws_hospital")
    yaml_file, _ = export_nav2(shipped, tmp_path / "map.yaml")
    rooms = [f"  - {{name: {r.name}, point: {r.point.tolist()}}}\n" for r in shipped.rooms]
    (tmp_path / "map.rooms.yaml").write_text("rooms:\n" + "".join(rooms))
    world = load_layout(yaml_file)
    was, now = lethal(shipped), lethal(world)
    assert was.shape == now.shape
    assert now[was].all()
    assert (now & ~was).mean() < 0.002  # pockets that no robot fits into
    assert unreachable(world) == []
    assert reachable_with_all_spots_taken(world) == []
    assert len(world.lanes) == 30


# --- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rooms", "words"),
    [
        ("rooms: [{name: a, point: [3.5, 2.0]}]", "names one room"),
        ("rooms: []", "rooms is empty"),
        ("roms: []", "did you mean 'rooms'"),
        ("[1, 2]", "is not a floor file"),
        (ROOMS_TEXT.replace("ward", "lab"), r"rooms\[1\]\.name is 'lab' again"),
        (ROOMS_TEXT.replace("name: lab", r'name: "a\eb"'), "it must be one line"),
        (
            ROOMS_TEXT.replace("[3.5, 2.0]", "[1.0, 3.6]"),
            r"'lab' is \[1.0, 3.6\] m, 0.00 m from an obstacle; .* there is room at \[0.97, 3.92\]",
        ),
        (ROOMS_TEXT.replace("[3.5, 2.0]", "[99.0, 2.0]"), "must lie within the floor"),
        (ROOMS_TEXT.replace("[3.5, 2.0]", "[1, 2, 3]"), r"must be \[x, y\]"),
        (
            ROOMS_TEXT.replace("point: [3.5, 2.0]", "area: [[0, 3.5], [2, 3.5], [2, 3.7]]"),
            "holds no place where a robot",
        ),
        (ROOMS_TEXT + "parking: [[8.3, 5.5]]", r"parking\[0\] is \[8.3, 5.5\] m"),
        (ROOMS_TEXT + "map: other.yaml", "name no other"),
        (ROOMS_TEXT + aliases(), "aliases .* unfold to 1.1e\\+09 values"),
    ],
)
def test_bad_rooms_are_answered_with_one_sentence(tmp_path, rooms, words):
    path = draw(tmp_path, ward_grid(), rooms=rooms)
    with pytest.raises(InputError, match=words) as caught:
        import_floor(path, tmp_path / "out")
    assert "wards.rooms.yaml" in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("image: wards.pgm", "image: none.pgm", "cannot be read: No such file"),
        ("image: wards.pgm", "image: ../none.pgm", "must lie in the folder"),
        ("image: wards.pgm", "image: /etc/passwd", "must lie in the folder"),
        ("image: wards.pgm", "image: ''", "must lie in the folder"),
        ("image: wards.pgm", 'image: "a\\0.pgm"', "must lie in the folder"),
        ("image: wards.pgm", "image: wards.yaml", "it must be a .pgm, .png, .bmp file"),
        ("resolution: 0.05", "resolution: 0", "resolution is 0.0 m; it must be > 0"),
        ("resolution: 0.05", "resolution: 50", "metres, not millimetres|at most 40000 m"),
        ("resolution: 0.05", "resolution: abc", "resolution"),
        ("yaw", "", ""),
    ],
)
def test_a_bad_map_is_answered_with_one_sentence(tmp_path, old, new, words):
    path = draw(tmp_path, ward_grid())
    text = path.read_text().replace(old, new)
    if old == "yaw":
        text, words = text.replace(", 0.0]", ", .inf]"), "origin.* must be finite"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        import_floor(path, tmp_path / "out")
    assert "\n" not in str(caught.value)


def png_bomb(cols: int, rows: int) -> bytes:
    """The head of a PNG that claims many pixels."""
    head = struct.pack(">IIBBBBB", cols, rows, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(b"\0" * 100)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not a picture"),
        (b"GIF89a" + b"\0" * 50, "is not a picture"),
        (png_bomb(5000, 5000), "5000 x 5000 = 25000000 pixels; 1 to 16000000"),
        (png_bomb(60000, 60000), "too many pixels"),
        (png_bomb(300, 300), "is a broken picture"),
        (b"P5\n400 400\n255\n\0\0", "is a broken picture"),
    ],
)
def test_a_picture_that_is_none_is_refused(tmp_path, content, words):
    path = draw(tmp_path, ward_grid(), ending="png")
    (tmp_path / "wards.png").write_bytes(content)
    with pytest.raises(InputError, match=words):
        import_floor(path, tmp_path / "out")


def test_a_floor_that_is_no_map_takes_no_file_of_rooms(tmp_path):
    file = tmp_path / "clinic.yaml"
    file.write_text("bounds: [0, 0, 9, 9]\n" + "rooms: [{name: a, point: [2, 2]}]\n")
    with pytest.raises(InputError, match="it is no Nav2 map"):
        import_floor(file, tmp_path / "out", rooms=file)


def test_one_room_is_told_with_what_to_do(tmp_path):
    rooms = "rooms:\n  - {name: lab, point: [12.0, 2.0]}\n"
    with pytest.raises(InputError, match=r"names one room, 'lab'; deliveries need two \(add"):
        import_floor(draw(tmp_path, ward_grid(), rooms=rooms), tmp_path / "out")


def test_a_radius_that_no_robot_has_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"--radius is 7.0 m; it must be 0.05 to 1.0 m"):
        import_floor(tmp_path / "no.yaml", tmp_path, radius=7.0)


# --- as Nav2 reads pictures ------------------------------------------------------------------


def test_opacity_counts_as_nav2_counts_it(tmp_path):
    """Trinary averages it in, scale makes what is not opaque unknown."""
    pixels = np.array([[[0, 0, 0, 255], [254, 254, 254, 255], [254, 254, 254, 0]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "m.png")
    text = (
        "image: m.png\nresolution: 1\norigin: [0, 0, 0]\nnegate: 0\nmode: {}\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    (tmp_path / "m.yaml").write_text(text.format("trinary"))
    assert read_nav2_map(tmp_path / "m.yaml").data.tolist() == [[100, 0, -1]]
    (tmp_path / "m.yaml").write_text(text.format("scale"))
    assert read_nav2_map(tmp_path / "m.yaml").data.tolist() == [[100, 0, -1]]
    (tmp_path / "m.yaml").write_text(text.format("raw"))
    assert read_nav2_map(tmp_path / "m.yaml").data.tolist() == [[0, -1, -1]]


def test_the_grey_of_the_map_saver_is_told_where_it_reads_as_free(tmp_path):
    grid = ward_grid()
    path = draw(tmp_path, grid)
    grey = np.where(grid < 0, 205, np.where(grid > 65, 0, 254)).astype(np.uint8)
    Image.fromarray(grey[::-1]).save(tmp_path / "wards.pgm")
    done = import_floor(path, tmp_path / "out")
    assert any("grey level 205" in said and "free_thresh: 0.196" in said for said in done.warnings)
    path.write_text(path.read_text().replace("free_thresh: 0.25", "free_thresh: 0.196"))
    assert import_floor(path, tmp_path / "out").warnings == ()


def test_waiting_spots_that_close_a_room_off_are_told(tmp_path):
    row = [[x, y] for x in (3.0, 3.5, 4.0) for y in (4.3, 4.9)]
    rooms = ROOMS_TEXT.replace("[12.0, 2.0]", f"[12.0, 2.0], queue: {row}")
    done = import_floor(draw(tmp_path, ward_grid(), rooms=rooms), tmp_path / "out")
    assert any("close off lab (" in said for said in done.warnings)
