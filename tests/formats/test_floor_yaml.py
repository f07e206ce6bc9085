import numpy as np
import pytest
from shapely import union_all
from shapely.geometry import Polygon, box

from mrta_falsify.core.errors import FormatError, InputError, UnknownNameError
from simulator_interface.formats.floor_yaml import read_floor

ROOMS = "rooms: [{name: a, point: [1, 1]}, {name: b, point: [5, 1]}]\n"
WALLS = "walls: [{box: [0, 0, 6, 0.2]}, {line: [[0, 3], [6, 3]], thickness: 0.1}]\n"


def write(tmp_path, text, name="floor.yaml"):
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return file


def test_walls_are_boxes_lines_and_polygons(tmp_path):
    text = WALLS + "furniture: [{name: t, kind: table, polygon: [[2, 1], [3, 1], [3, 2]]}]\n"
    floor = read_floor(write(tmp_path, text + ROOMS))
    solid = union_all([Polygon(wall.polygon) for wall in floor.walls])
    assert solid.symmetric_difference(box(0, 0, 6, 0.2) | box(-0.05, 2.95, 6.05, 3.05)).area < 1e-9
    (table,) = floor.furniture
    assert (table.name, table.kind) == ("t", "table")
    assert floor.bounds == pytest.approx([-0.35, -0.3, 6.35, 3.35])
    assert [wall.name for wall in floor.walls] == ["wall_0", "wall_1"]


def test_a_wall_that_closes_on_itself_leaves_its_inside_free(tmp_path):
    text = "walls: [{line: [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]], thickness: 0.2}]\n"
    floor = read_floor(write(tmp_path, text + ROOMS))
    solid = union_all([Polygon(wall.polygon) for wall in floor.walls])
    assert solid.area == pytest.approx(20 * 0.2, rel=0.02)


def test_a_floor_may_take_its_walls_from_an_sdf_world(tmp_path):
    (tmp_path / "w.sdf").write_text(
        '<sdf version="1.6"><world name="w"><model name="m"><static>true</static><link name="l">'
        "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision></link>"
        "</model></world></sdf>"
    )
    floor = read_floor(write(tmp_path, "sdf: w.sdf\nbounds: [-3, -3, 6, 6]\n" + ROOMS))
    assert [item.name for item in floor.furniture] == ["m/l/c"]
    write(tmp_path, ROOMS + "bounds: [-3, -3, 6, 6]", "w.rooms.yaml")
    assert read_floor(tmp_path / "w.sdf").name == "w"


def test_a_map_needs_rooms_beside_it(tmp_path):
    (tmp_path / "m.pgm").write_bytes(b"P5\n4 4\n255\n" + bytes([254] * 16))
    write(tmp_path, "image: m.pgm\nresolution: 2.0\norigin: [0, 0, 0]\n", "m.yaml")
    with pytest.raises(FormatError, match=r"m\.rooms\.yaml beside it"):
        read_floor(tmp_path / "m.yaml")
    write(tmp_path, ROOMS, "m.rooms.yaml")
    floor = read_floor(tmp_path / "m.yaml")
    assert floor.name == "m"
    assert np.array_equal(floor.bounds, [0, 0, 8, 8])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not a floor file"),
        ("- 1", "is not a floor file"),
        (WALLS, "rooms is empty"),
        (ROOMS, "has no walls"),
        (WALLS + "rooms: [{name: a}]", r"rooms\[0\]\.point is missing"),
        (WALLS + "rooms: [{name: a, point: [1, .nan]}]", "it must be finite"),
        (WALLS + "rooms: [{name: a, point: [1, 99]}]", "it must lie within the floor"),
        (WALLS + "rooms: [{name: a, point: [1, 1]}, {name: a, point: [2, 1]}]", "is 'a' again"),
        (WALLS + "rooms: [{name: a, point: [1, 1], door: [[1, 2]]}]", "the posts of the door"),
        (
            WALLS + "rooms: [{name: a, point: [1, 1], area: [[2, 2], [3, 2], [3, 3]]}]",
            "must lie in the room's area",
        ),
        (
            WALLS + "rooms: [{name: a, point: [1, 1], area: [[0, 0], [2, 2], [2, 0], [0, 2]]}]",
            "must not cross itself",
        ),
        ("walls: [{box: [1, 1, 0, 2]}]\n" + ROOMS, r"walls\[0\]\.box is \[1.0, 1.0, 0.0, 2.0\]"),
        ("walls: [{}]\n" + ROOMS, "one of line, polygon and box"),
        ("walls: [{line: [[1, 1]]}]\n" + ROOMS, "at least two"),
        ("walls: [{polygon: [[1, 1], [2, 2]]}]\n" + ROOMS, "at least 3"),
        ("wals: []\n" + ROOMS, "did you mean 'walls'"),
        ("walls: [{box: [0, 0, 60000, 1]}]\n" + ROOMS, "metres, not millimetres"),
        ("bounds: [-900, -900, 900, 900]\n" + ROOMS, "measures 1800 x 1800 m"),
        (WALLS + ROOMS + "bounds: [0, 0]", "x min, y min, x max, y max"),
        (WALLS + ROOMS + "map: ../m.yaml", "must lie in the folder"),
        (WALLS + ROOMS + "sdf: /etc/passwd", "must lie in the folder"),
        (WALLS + ROOMS + "slice: [0.5, 0.1]\nsdf: w.sdf", "it must grow"),
        (WALLS + ROOMS + "travel_times: [[0, 1]]", "one row and column per room"),
        (WALLS + ROOMS + "lanes: [{start: a, end: a, to_room: [[1, 1]]}]", "to itself"),
        (WALLS + ROOMS + "lanes: [{start: a, end: b, to_room: []}]", "needs waypoints"),
        ("walls: [{box: [0, 0, 1, 1], kind: *x}]", "not valid YAML"),
        ("!!python/object/apply:os.system ['true']", "not valid YAML"),
    ],
)
def test_broken_floors_are_answered_with_one_sentence(tmp_path, text, words):
    with pytest.raises(InputError, match=words) as caught:
        read_floor(write(tmp_path, text))
    assert "floor.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_lane_between_unknown_rooms_is_answered_with_the_nearest(tmp_path):
    text = WALLS + "rooms: [{name: lab, point: [1, 1]}]\nlanes: [{start: lob, end: lab, "
    with pytest.raises(UnknownNameError, match="did you mean 'lab'"):
        read_floor(write(tmp_path, text + "to_room: [[1, 1]]}]"))


def test_a_file_that_is_not_there_is_named(tmp_path):
    for name in ("no.yaml", "no.sdf"):
        with pytest.raises(FormatError, match=name.replace(".", r"\.")):
            read_floor(tmp_path / name)
