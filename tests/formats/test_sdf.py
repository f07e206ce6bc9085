import io

import numpy as np
import pytest
import trimesh
from shapely import union_all
from shapely.affinity import scale
from shapely.geometry import LineString, Point, Polygon, box

from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.sdf import read_sdf


def world(tmp_path, body, name="floor.sdf"):
    file = tmp_path / name
    file.write_text(f'<sdf version="1.7"><world name="w">{body}</world></sdf>', encoding="utf-8")
    return file


def model(shape, *, name="m", pose="", link_pose="", static="true"):
    return (
        f'<model name="{name}"><static>{static}</static><pose>{pose or "0 0 0 0 0 0"}</pose>'
        f'<link name="l"><pose>{link_pose or "0 0 0 0 0 0"}</pose>'
        f'<collision name="c"><geometry>{shape}</geometry></collision></link></model>'
    )


BOX = "<box><size>2 1 1</size></box>"


def area_of(solids):
    return union_all([Polygon(solid.polygon) for solid in solids])


def test_a_box_lies_where_its_nested_poses_put_it(tmp_path):
    turned = model(BOX, pose="3 4 0.5 0 0 1.5707963267948966", link_pose="1 0 0 0 0 0")
    (solid,) = read_sdf(world(tmp_path, turned))
    assert solid.name == "m/l/c"
    assert area_of([solid]).symmetric_difference(box(2.5, 4.0, 3.5, 6.0)).area < 1e-9


def test_models_inside_models_and_includes_add_their_poses(tmp_path):
    shelf = tmp_path / "models" / "shelf"
    shelf.mkdir(parents=True)
    (shelf / "model.sdf").write_text(
        f'<sdf version="1.6">{model(BOX, name="shelf", pose="9 9 9 0 0 0")}</sdf>'
    )
    include = (
        '<model name="outer"><pose>10 0 0 0 0 0</pose><include><uri>model://shelf</uri>'
        "<name>s1</name><pose>0 5 0.5 0 0 0</pose></include></model>"
    )
    (solid,) = read_sdf(world(tmp_path, include))
    assert solid.name == "outer/s1/l/c"
    assert area_of([solid]).symmetric_difference(box(9, 4.5, 11, 5.5)).area < 1e-9


@pytest.mark.parametrize(
    ("shape", "pose", "expected"),
    [
        ("<cylinder><radius>1</radius><length>1</length></cylinder>", "", Point(0, 0).buffer(1.0)),
        ("<sphere><radius>1</radius></sphere>", "", Point(0, 0).buffer(0.999)),
        (
            "<polyline><point>0 0</point><point>2 0</point><point>0 2</point><height>1</height>"
            "</polyline>",
            "",
            Polygon([(0, 0), (2, 0), (0, 2)]),
        ),
        (
            "<capsule><radius>1</radius><length>2</length></capsule>",
            "0 0 0.3 0 1.5707963 0",
            LineString([(-1, 0), (1, 0)]).buffer(1.0),
        ),
        ("<ellipsoid><radii>2 1 1</radii></ellipsoid>", "", scale(Point(0, 0).buffer(1.0), 2.0)),
        (
            "<cone><radius>1</radius><length>1</length></cone>",
            "0 0 0.55 0 0 0",
            Point(0, 0).buffer(1.0),
        ),
        # a bar along x, raised at one end: it leaves the slab 0.05..0.5 where it is too high
        (
            "<box><size>4 0.2 0.02</size></box>",
            "0 0 0.5 0 -0.2 0",
            box(-1.96, -0.1, 0.0, 0.1),
        ),
    ],
)
def test_every_shape_is_cut_at_the_robots_height(tmp_path, shape, pose, expected):
    found = area_of(read_sdf(world(tmp_path, model(shape, pose=pose))))
    assert found.symmetric_difference(expected).area < 0.04 * expected.area + 0.02


@pytest.mark.parametrize("height", ["1.2", "-0.7"])
def test_what_hangs_above_or_lies_below_is_no_obstacle(tmp_path, height):
    assert read_sdf(world(tmp_path, model(BOX, pose=f"0 0 {height} 0 0 0"))) == ()


def test_only_static_models_count(tmp_path):
    body = model(BOX, name="a", static="false") + model(BOX, name="b")
    assert [solid.name for solid in read_sdf(world(tmp_path, body))] == ["b/l/c"]


@pytest.mark.parametrize("kind", ["stl", "obj"])
def test_a_hollow_mesh_becomes_its_walls(tmp_path, kind):
    outer = trimesh.creation.box((4.0, 3.0, 2.0))
    inner = trimesh.creation.box((3.6, 2.6, 3.0))
    room = trimesh.boolean.difference([outer, inner])
    content = room.export(file_type=kind)
    mode = {"encoding": "utf-8"} if isinstance(content, str) else {}
    target = tmp_path / f"room.{kind}"
    if isinstance(content, str):
        target.write_text(content, **mode)
    else:
        target.write_bytes(content)
    shape = f"<mesh><uri>room.{kind}</uri><scale>1 1 1</scale></mesh>"
    found = area_of(read_sdf(world(tmp_path, model(shape))))
    assert not found.intersects(Point(0.0, 0.0).buffer(1.0))
    assert found.symmetric_difference(box(-2, -1.5, 2, 1.5) - box(-1.8, -1.3, 1.8, 1.3)).area < 0.3
    solids = read_sdf(world(tmp_path, model(shape)))
    assert all(Polygon(s.polygon).is_valid for s in solids)


def test_an_open_surface_is_an_obstacle_too(tmp_path):
    sheet = trimesh.Trimesh(
        vertices=[[0, 0, 0], [3, 0, 0], [3, 0, 1], [0, 0, 1]], faces=[[0, 1, 2], [0, 2, 3]]
    )
    stream = io.BytesIO(sheet.export(file_type="stl"))
    (tmp_path / "sheet.stl").write_bytes(stream.getvalue())
    found = area_of(read_sdf(world(tmp_path, model("<mesh><uri>sheet.stl</uri></mesh>"))))
    assert found.covers(Point(1.5, 0.0))
    assert 0.03 < found.area < 0.1


BOMB = """<?xml version="1.0"?><!DOCTYPE sdf [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>
<sdf version="1.6"><world name="&b;"/></sdf>"""
LEAK = """<?xml version="1.0"?><!DOCTYPE sdf [<!ENTITY x SYSTEM "file:///etc/passwd">]>
<sdf version="1.6"><world name="w"><model name="m">&x;</model></world></sdf>"""


@pytest.mark.parametrize("text", [BOMB, LEAK])
def test_entities_are_refused(tmp_path, text):
    file = tmp_path / "evil.sdf"
    file.write_text(text)
    with pytest.raises(FormatError, match="DOCTYPE"):
        read_sdf(file)


def test_meshes_outside_the_folder_are_not_read(tmp_path):
    inside = tmp_path / "in"
    inside.mkdir()
    (tmp_path / "secret.stl").write_bytes(trimesh.creation.box((1, 1, 1)).export(file_type="stl"))
    file = world(inside, model("<mesh><uri>../secret.stl</uri></mesh>"))
    with pytest.raises(FormatError, match="must lie in"):
        read_sdf(file)


def test_models_that_include_each_other_end_in_a_sentence(tmp_path):
    ring = tmp_path / "ring"
    ring.mkdir()
    (ring / "model.sdf").write_text(
        '<sdf version="1.6"><model name="ring"><static>true</static>'
        "<include><uri>model://ring</uri></include></model></sdf>"
    )
    with pytest.raises(FormatError, match="include each other"):
        read_sdf(world(tmp_path, "<include><uri>model://ring</uri></include>"))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (model("<box><size>1 2</size></box>"), "<size> is '1 2'; it must be 3 numbers"),
        (model("<box><size>1 -2 1</size></box>"), "must be positive"),
        (model(BOX, pose="0 0 nan 0 0 0"), "<pose> is '0 0 nan 0 0 0'"),
        (model("<heightmap/>"), "<heightmap> is not a supported shape"),
        (model("<mesh><uri>no.stl</uri></mesh>"), "is not there"),
        ("<include><uri>model://nowhere</uri></include>", "model://nowhere is not in"),
        ("<include><uri>https://x.org/a/3</uri></include>", r"leave it out by `skip: \[a\]`"),
        ("<include/>", "<uri> of an <include> is empty"),
        (
            '<model name="m"><static>true</static><link name="l"><pose relative_to="k">'
            "0 0 0 0 0 0</pose></link></model>",
            "relative to 'k'",
        ),
    ],
)
def test_broken_worlds_are_answered_with_one_sentence(tmp_path, body, words):
    file = world(tmp_path, body)
    with pytest.raises(FormatError, match=words.replace("(", r"\(")) as caught:
        read_sdf(file)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"<sdf",
        b"\xff\xfe\x00",
        b"<world/>",
        b"<a>" * 500,
        b"<sdf><world><model></world></sdf>",
    ],
)
def test_what_is_no_sdf_is_refused(tmp_path, content):
    file = tmp_path / "broken.sdf"
    file.write_bytes(content)
    with pytest.raises(FormatError, match=r"broken\.sdf"):
        read_sdf(file)


@pytest.mark.parametrize("content", [b"", b"solid x", b"\x00" * 100, b"v nan nan nan\nf 1 1 1\n"])
@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb", "off", "dae"])
def test_broken_meshes_are_refused(tmp_path, content, kind):
    (tmp_path / f"broken.{kind}").write_bytes(content)
    file = world(tmp_path, model(f"<mesh><uri>broken.{kind}</uri></mesh>"))
    with pytest.raises(FormatError):
        read_sdf(file)


def test_a_skipped_model_need_not_be_there(tmp_path):
    body = "<include><uri>model://nowhere</uri></include>" + model(BOX)
    assert len(read_sdf(world(tmp_path, body), skip=("nowhere",))) == 1


@pytest.mark.parametrize(
    "body",
    [
        "<include><uri>model://sun</uri></include>",
        "<include><uri>https://fuel.gazebosim.org/1.0/OpenRobotics/models/Sun</uri></include>",
        "<include><uri>https://fuel.gazebosim.org/1.0/OR/models/Ground Plane/3</uri></include>",
        "<include><uri>https://fuel.gazebosim.org/1.0/OR/models/Ground%20Plane/tip</uri></include>",
        "<include><uri>model://ground_plane/model.sdf</uri><name>floor</name></include>",
        model(BOX, name="ground_plane_0"),
    ],
)
def test_sun_and_ground_plane_are_no_obstacles_wherever_they_come_from(tmp_path, body):
    assert read_sdf(world(tmp_path, body)) == ()


HEIGHTMAP = model("<heightmap><uri>model://site/media/hills.png</uri></heightmap>")


@pytest.mark.parametrize(
    ("body", "names"),
    [
        (
            "<include><uri>https://x.org/models/Desk%20A/2</uri><name>d</name></include>",
            ("d", "Desk A", "https://x.org/models/Desk%20A/2"),
        ),
        (
            model("<mesh><uri>package://ward/meshes/bed.step</uri></mesh>"),
            ("bed.step", "package://ward/meshes/bed.step", "m", "l", "m/l", "c", "m/l/c"),
        ),
        (HEIGHTMAP, ("hills.png", "c", "m/l/c")),
    ],
)
def test_what_cannot_be_read_is_left_out_by_a_name_or_its_last_part(tmp_path, body, names):
    kept = model(BOX, name="n").replace('"c"', '"k"').replace('"l"', '"j"')
    file = world(tmp_path, body + kept)
    with pytest.raises(FormatError, match=r"skip: \["):
        read_sdf(file)
    for name in names:
        assert [solid.name for solid in read_sdf(file, skip=(name,))] == ["n/j/k"]


def test_a_fetched_model_is_found_by_the_last_part_of_its_uri(tmp_path):
    for folder, name in (("Desk A", "a"), ("models/shelf", "b")):
        (tmp_path / folder).mkdir(parents=True)
        text = model(BOX, name=name)
        (tmp_path / folder / "model.sdf").write_text(f'<sdf version="1.6">{text}</sdf>')
    body = "".join(
        f"<include><uri>{uri}</uri></include>"
        for uri in ("https://x.org/1.0/o/models/Desk%20A/2", "file:///home/them/models/shelf")
    )
    names = [solid.name for solid in read_sdf(world(tmp_path, body))]
    assert names == ["Desk A/l/c", "shelf/l/c"]


@pytest.mark.parametrize(
    "uri", ["package://ward/meshes/t.stl", "file:///home/them/ward/meshes/t.stl"]
)
def test_a_mesh_of_another_machine_is_found_by_the_end_of_its_path(tmp_path, uri):
    (tmp_path / "meshes").mkdir()
    mesh = trimesh.creation.box((1, 1, 1)).export(file_type="stl")
    (tmp_path / "meshes" / "t.stl").write_bytes(mesh)
    solids = read_sdf(world(tmp_path, model(f"<mesh><uri>{uri}</uri></mesh>")))
    assert area_of(solids).area == pytest.approx(1.0, abs=0.1)


def test_a_moving_model_needs_no_pose_that_is_read(tmp_path):
    robot = (
        '<model name="robot"><pose relative_to="dock">0 0 0 0 0 0</pose><link name="l"/></model>'
    )
    assert len(read_sdf(world(tmp_path, robot + model(BOX)))) == 1


def test_quaternions_and_degrees_turn_alike(tmp_path):
    half = np.sqrt(0.5)
    quarter = [
        f'<pose rotation_format="quat_xyzw">0 0 0 0 0 {half} {half}</pose>',
        '<pose degrees="true">0 0 0 0 0 90</pose>',
        "<pose>0 0 0 0 0 1.5707963267948966</pose>",
    ]
    shapes = []
    for pose in quarter:
        body = model(BOX).replace("<pose>0 0 0 0 0 0</pose>", pose, 1)
        shapes.append(area_of(read_sdf(world(tmp_path, body))))
    assert all(s.symmetric_difference(box(-0.5, -1, 0.5, 1)).area < 1e-9 for s in shapes)


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01" name="centimeter"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">0 0 0 200 0 0 200 100 0 0 100 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#n" offset="1"/><vcount>4</vcount>
<p>0 0 1 0 2 0 3 0</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>0 300 0</translate>
<rotate>1 0 0 90</rotate><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
</COLLADA>"""


def test_collada_meshes_keep_their_unit_and_node_poses(tmp_path):
    # a sheet in the plane z = 0, 2 m x 1 m in centimetres, set upright and moved along y;
    # Gazebo does not look at up_axis, nor do we
    (tmp_path / "sheet.dae").write_text(DAE)
    found = area_of(read_sdf(world(tmp_path, model("<mesh><uri>sheet.dae</uri></mesh>"))))
    assert found.bounds == pytest.approx((-0.01, 2.99, 2.01, 3.01), abs=0.02)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<p>0 0 1 0 2 0 3 0</p>", "<p>0 0 1 0 2 0 9 0</p>"),
        ("#s", "#t"),
        ("200 0 0", "200 0"),
        ("<vcount>4", "<vcount>5"),
        ("#g", "#h"),
        ("0.01", "x"),
    ],
)
def test_broken_collada_is_refused(tmp_path, old, new):
    (tmp_path / "sheet.dae").write_text(DAE.replace(old, new))
    with pytest.raises(FormatError, match="sheet"):
        read_sdf(world(tmp_path, model("<mesh><uri>sheet.dae</uri></mesh>")))


def test_the_published_walls_become_furniture(reference_data, tmp_path):
    name = "aws_robomaker_hospital_floor_01_walls_collision.dae"
    (tmp_path / name).write_bytes((reference_data / "aws_hospital" / name).read_bytes())
    solids = read_sdf(world(tmp_path, model(f"<mesh><uri>{name}</uri></mesh>")))
    found = area_of(solids)
    x1, y1, x2, y2 = found.bounds
    assert (x2 - x1, y2 - y1) == pytest.approx((25.1, 56.1), abs=0.5)
    assert 20.0 < found.area < 200.0
