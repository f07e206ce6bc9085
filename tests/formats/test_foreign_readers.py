"""What we write, read by programs and by the measure of files that are not ours."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from mrta_falsify.commands import export as exporting
from mrta_falsify.commands.stacks import costmap_of
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import LETHAL
from mrta_falsify.core.world import Blockage
from simulator_interface.formats.mcap import RATE, write_mcap
from simulator_interface.formats.mrta_sim_files import NAMES, write_mrta_sim
from simulator_interface.formats.nav2 import occupancy_of, read_nav2_map, write_occupancy
from simulator_interface.formats.sdf_world import write_sdf

SUN = '<sdf version="1.6"><light type="directional" name="sun"/></sdf>'
GROUND = (
    '<sdf version="1.6"><model name="ground_plane"><static>true</static><link name="link"/>'
    "</model></sdf>"
)


# --- SDF, by Debian's libsdformat ----------------------------------------------------------


@pytest.fixture(scope="module")
def read_sdf(tmp_path_factory):
    """A strict reader built on libsdformat: from a file to its outlines by model."""
    if shutil.which("g++") is None or shutil.which("pkg-config") is None:
        pytest.skip("no C++ compiler on this machine")
    asked = ["pkg-config", "--cflags", "--libs", "sdformat12"]
    flags = subprocess.run(asked, capture_output=True, text=True, check=False)
    if flags.returncode:
        pytest.skip("libsdformat 12 (Debian's libsdformat-dev) is not on this machine")
    folder = tmp_path_factory.mktemp("libsdformat")
    program = folder / "read_sdf"
    source = Path(__file__).with_name("read_sdf.cpp")
    subprocess.run(
        ["g++", "-std=c++17", str(source), "-o", str(program), *flags.stdout.split()], check=True
    )
    for name, text in (("sun", SUN), ("ground_plane", GROUND)):
        (folder / name).mkdir()
        (folder / name / "model.sdf").write_text(text)
        (folder / name / "model.config").write_text(
            f'<?xml version="1.0"?><model><name>{name}</name>'
            '<sdf version="1.6">model.sdf</sdf></model>'
        )

    def read(path):
        done = subprocess.run(
            [str(program), str(path), str(folder)], capture_output=True, text=True, check=False
        )
        outlines = {}
        for line in done.stdout.splitlines():
            name, *numbers = line.split(" ")
            values = np.array(numbers, dtype=float)
            outlines[name] = values[3:].reshape(-1, 2) + values[:2]
        return done, outlines

    return read


@pytest.mark.long
def test_libsdformat_reads_every_outline_that_was_written(read_sdf, hall, tmp_path):
    table = hall.furniture[0]
    bed = Blockage(name="bed", polygon=frozen_array([[1, 1], [2, 1], [2, 2]]), start=0.0, end=9.0)
    odd = tuple(
        dataclasses.replace(table, name=name) for name in ("a b", "a/b", "<x>&", "__y__", "Möbel")
    )
    world = dataclasses.replace(hall, furniture=(table, *odd), events=(bed,))
    write_sdf(world, tmp_path / "w.sdf")
    done, outlines = read_sdf(tmp_path / "w.sdf")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(outlines) == len(world.walls) + len(world.furniture) + 1
    wanted = {f"wall_{wall.name}": wall.polygon for wall in world.walls}
    wanted |= {"furniture_table": table.polygon, "blockage_bed": bed.polygon}
    for name, polygon in wanted.items():
        np.testing.assert_allclose(outlines[name], polygon, atol=2e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", ["world", "__model__", "a b", ""])
def test_libsdformat_accepts_any_name_of_a_world(read_sdf, hall, tmp_path, name):
    write_sdf(dataclasses.replace(hall, name=name), tmp_path / "w.sdf")
    done, outlines = read_sdf(tmp_path / "w.sdf")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(outlines) == 5


@pytest.mark.long
def test_the_strict_reader_refuses_what_is_no_sdf(read_sdf, hall, tmp_path):
    write_sdf(hall, tmp_path / "w.sdf")
    text = (tmp_path / "w.sdf").read_text()
    (tmp_path / "w.sdf").write_text(text.replace("polyline", "polylane"))
    done, _ = read_sdf(tmp_path / "w.sdf")
    assert done.returncode == 1
    assert "polylane" in done.stderr


# --- Nav2 ----------------------------------------------------------------------------------


def test_an_exported_map_is_equal_byte_for_byte_after_a_round_trip(hall, tmp_path):
    subject = exporting.ExportSubject(world=hall, config=StackConfig())
    description, picture = exporting.write_export(subject, "nav2", tmp_path / "out" / "map.yaml")
    (tmp_path / "again").mkdir()
    write_occupancy(read_nav2_map(description), tmp_path / "again" / "map.yaml")
    for path in (description, picture):
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


def test_an_exported_map_shows_another_reader_the_lethal_cells(hall, tmp_path):
    subject = exporting.ExportSubject(world=hall, config=StackConfig())
    description, _ = exporting.write_export(subject, "nav2", tmp_path)
    said = yaml.safe_load(description.read_text())
    pixels = np.asarray(Image.open(tmp_path / said["image"]))
    costmap = costmap_of(hall)
    np.testing.assert_array_equal(pixels[::-1] == 0, costmap.cost == LETHAL)
    assert said["resolution"] == costmap.resolution
    assert said["origin"] == [*costmap.origin.tolist(), 0]


# --- MCAP, by rosbags ----------------------------------------------------------------------


def test_rosbags_reads_the_same_poses_paths_and_map(hall, hall_trace, tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    pytest.importorskip("mcap_ros2")
    path = tmp_path / "run.mcap"
    costmap = costmap_of(hall)
    write_mcap(hall, hall_trace, costmap, path)
    seen: dict[str, list] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            seen.setdefault(connection.topic, []).append((stamp, message))
    columns, dt = hall_trace.columns, hall_trace.dt
    count = round(hall_trace.duration * RATE) + 1
    for i, robot in enumerate(hall_trace.robots):
        rows = seen[f"/{robot}/odom"]
        ticks = [round(stamp * 1e-9 / dt) for stamp, _ in rows]
        found = [m.pose.pose for _, m in rows]
        places = [(p.position.x, p.position.y) for p in found]
        turns = [2.0 * np.arctan2(p.orientation.z, p.orientation.w) for p in found]
        assert len(rows) == count
        np.testing.assert_array_equal(places, columns["pose"][ticks, i, :2])
        # a turn by pi is one by -pi
        np.testing.assert_allclose(np.cos(turns - columns["pose"][ticks, i, 2]), 1.0, atol=1e-12)
        plans = [
            [(p.pose.position.x, p.pose.position.y) for p in m.poses]
            for _, m in seen[f"/{robot}/plan"]
        ]
        changes = [c.points.tolist() for c in hall_trace.paths if c.robot == i]
        assert [[list(point) for point in plan] for plan in plans] == changes
    names = {*(f"{robot}/base_link" for robot in hall_trace.robots), hall.humans[0].name}
    for stamp, message in seen["/tf"]:
        tick = round(stamp * 1e-9 / dt)
        moves = {t.child_frame_id: t.transform.translation for t in message.transforms}
        assert set(moves) == names
        person = moves[hall.humans[0].name]
        assert [person.x, person.y] == columns["human_position"][tick, 0].tolist()
    ((_, grid),) = seen["/map"]
    data = np.asarray(grid.data).reshape(grid.info.height, grid.info.width)
    np.testing.assert_array_equal(data, occupancy_of(costmap).data)
    place = grid.info.origin.position
    assert [place.x, place.y] == costmap.origin.tolist()


# --- MRTA-Sim's files, by the form of the published ones -----------------------------------


def _form(data: object) -> object:
    """Structure of JSON-shaped data: keys that are names and lengths of lists are dropped."""
    if isinstance(data, dict):
        named = all(isinstance(value, (dict, list)) for value in data.values()) and len(data) > 1
        if named and len({json.dumps(_form(value)) for value in data.values()}) == 1:
            return {"NAME": _form(next(iter(data.values())))}
        return {key: _form(data[key]) for key in sorted(data)}
    if isinstance(data, list):
        return sorted({json.dumps(_form(item)) for item in data})
    return "number" if isinstance(data, (int, float)) else type(data).__name__


@pytest.fixture
def written(hall, tmp_path):
    """The files of the hall, with two people so that names are told from fields."""
    another = dataclasses.replace(hall.humans[0], name="human2")
    world = dataclasses.replace(hall, humans=(*hall.humans, another))
    write_mrta_sim(world, costmap_of(world), tmp_path)
    return tmp_path


def test_our_robots_tasks_and_people_have_the_form_of_mrta_sims(written, reference_data):
    pairs = {
        "robots": reference_data / "aws_hospital" / "robot_setup_6.json",
        "tasks": reference_data / "smrta" / "simulation" / "testcase_6agents_3_3.json",
        "people": reference_data / "aws_hospital" / "humans_waypoint_config3.yaml",
    }
    for kind, theirs in pairs.items():
        ours = yaml.safe_load((written / NAMES[kind]).read_text())
        assert _form(ours) == _form(yaml.safe_load(theirs.read_text())), kind
    stream = json.loads((written / NAMES["tasks"]).read_text())
    numbers = [batch["arrival"] for batch in stream["tasks_stream"]]
    numbers += [
        v for batch in stream["tasks_stream"] for task in batch["tasks"] for v in task.values()
    ]
    assert all(isinstance(number, int) for number in [*numbers, *stream["agents"]])


def test_our_map_has_the_fields_of_mrta_sims(written, reference_data):
    theirs = yaml.safe_load((reference_data / "aws_hospital" / "my_map.yaml").read_text())
    ours = yaml.safe_load((written / NAMES["map"]).read_text())
    assert {k: type(v) for k, v in ours.items()} == {k: type(v) for k, v in theirs.items()}
    assert {k: ours[k] for k in ("image", "mode", "negate", "free_thresh", "occupied_thresh")} == {
        k: theirs[k] for k in ("image", "mode", "negate", "free_thresh", "occupied_thresh")
    }
    published = Image.open(reference_data / "aws_hospital" / "my_map.pgm")
    picture = Image.open(written / ours["image"])
    assert (picture.mode, picture.format) == (published.mode, published.format)
    assert set(np.unique(picture)) <= set(np.unique(published))


def test_our_gazebo_world_uses_the_elements_of_mrta_sims(written, reference_data):
    theirs = ET.parse(reference_data / "aws_hospital" / "hospital.world").getroot()
    ours = ET.parse(written / NAMES["world"]).getroot()
    assert ours.attrib == theirs.attrib  # the SDF version

    def included(root):
        return {element.findtext("uri") for element in root.find("world").findall("include")}

    assert included(ours) == {"model://sun", "model://ground_plane"} <= included(theirs)
    direct = {element.tag for element in ours.find("world")}
    assert direct <= {element.tag for element in theirs.find("world")}
