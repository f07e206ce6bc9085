from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from mrta_falsify.commands import export as exporting
from mrta_falsify.commands.stacks import costmap_of
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import ConfigError, WorldError
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.trace import EdgeSpan
from mrta_falsify.core.world import Blockage
from simulator_interface.formats import mrta_sim
from simulator_interface.formats.mcap import write_mcap
from simulator_interface.formats.mrta_sim_files import NAMES, write_mrta_sim
from simulator_interface.formats.sdf_world import sdf_text


def test_every_solid_of_the_world_is_an_extruded_outline_in_the_sdf(hall):
    blockage = Blockage(
        name="bed", polygon=frozen_array([[1, 1], [2, 1], [2, 2]]), start=0.0, end=9.0
    )
    later = dataclasses.replace(blockage, name="later", start=5.0)
    world = dataclasses.replace(hall, events=(blockage, later))
    tree = ET.fromstring(sdf_text(world))
    models = {model.get("name"): model for model in tree.iter("model")}
    assert sorted(models) == [
        "blockage_bed", "furniture_table", "wall_east", "wall_north", "wall_south", "wall_west",
    ]  # fmt: skip
    table = models["furniture_table"]
    place = np.array([float(v) for v in table.findtext("pose").split()[:2]])
    points = [p.text.split() for p in table.find("link/collision/geometry/polyline").iter("point")]
    outline = np.array(points, dtype=float) + place
    np.testing.assert_allclose(outline, hall.furniture[0].polygon, atol=1e-5)
    assert table.findtext("static") == "true"


def test_names_that_collide_or_are_odd_stay_apart(hall):
    items = tuple(
        dataclasses.replace(hall.furniture[0], name=name) for name in ("a b", "a/b", "<x>&")
    )
    tree = ET.fromstring(sdf_text(dataclasses.replace(hall, furniture=items)))
    names = [m.get("name") for m in tree.iter("model") if m.get("name").startswith("furniture")]
    assert len(set(names)) == 3


def test_mrta_sims_files_are_read_back_by_the_readers_of_its_own_files(hall, tmp_path):
    tasks = (
        *hall.tasks,
        dataclasses.replace(hall.tasks[0], arrival=4.2, deadline=99.9),
    )
    world = dataclasses.replace(hall, tasks=tasks)
    files = write_mrta_sim(world, costmap_of(world), tmp_path)
    assert all(path.is_file() for path in files)
    stream = mrta_sim.read_task_stream(tmp_path / NAMES["tasks"], rooms=2)
    rows = [(task.arrival, task.start, task.end, task.deadline) for task in stream.tasks]
    assert rows == [(0, 0, 1, 100), (5, 0, 1, 99), (5, 1, 0, 120)]
    assert stream.agents == (0, 1)
    starts = mrta_sim.read_robot_setup(tmp_path / NAMES["robots"])
    for start, robot in zip(starts, world.robots, strict=True):
        assert start.name == robot.name
        np.testing.assert_array_equal(start.pose, robot.pose)
    people = mrta_sim.read_human_routes(tmp_path / NAMES["people"])
    np.testing.assert_array_equal(people[0].route, world.humans[0].route)


def test_an_independent_reader_finds_the_same_poses_in_the_mcap_file(hall, hall_trace, tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    path = tmp_path / "run.mcap"
    write_mcap(hall, hall_trace, costmap_of(hall), path)
    seen = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            seen.setdefault(connection.topic, []).append(
                (stamp, reader.deserialize(raw, connection.msgtype))
            )
    assert {"/tf", "/map", "/markers", "/events", "/robot1/odom", "/robot1/plan"} <= set(seen)
    for stamp, message in seen["/robot2/odom"]:
        tick = round(stamp * 1e-9 / hall_trace.dt)
        x, y, yaw = hall_trace.columns["pose"][tick, 1]
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        assert (place.x, place.y) == (x, y)
        assert 2.0 * np.arctan2(turn.z, turn.w) == pytest.approx(yaw, abs=1e-12)
    (_, grid), *others = seen["/map"]
    assert others == []
    assert grid.data.max() == 100
    kinds = [json.loads(message.data)["kind"] for _, message in seen["/events"]]
    assert kinds == [event.kind for event in hall_trace.events]


def test_arrows_in_the_mcap_file_show_who_waits_for_whom(hall, hall_trace, tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    edge = BlockedBy(robot=0, cause="queue", other=1, resource="ward")
    trace = dataclasses.replace(
        hall_trace, edges=(EdgeSpan(first=0, last=len(hall_trace) // 2, edge=edge),)
    )
    path = tmp_path / "run.mcap"
    write_mcap(hall, trace, costmap_of(hall), path)
    first, last = {}, {}
    with highlevel.AnyReader([path]) as reader:
        for _, _, raw in reader.messages([c for c in reader.connections if c.topic == "/markers"]):
            message = reader.deserialize(raw, "visualization_msgs/msg/MarkerArray")
            last = {(m.ns, m.id): m for m in message.markers}
            first = first or last
    arrow = first["waits_for", 0]
    ends = [(point.x, point.y) for point in arrow.points]
    assert ends == [tuple(hall_trace.columns["pose"][0, i, :2]) for i in (0, 1)]
    assert first["waits_why", 0].text == "queue ward"
    deleted = 2
    assert last["waits_for", 0].action == last["waits_why", 0].action == deleted
    assert first["waits_for", 1].action == deleted


@pytest.mark.parametrize("kind", ["mrta-sim", "mcap", "gif", "mp4"])
def test_a_world_that_needs_its_program_is_not_exported_as_if_it_did_not(hall, tmp_path, kind):
    world = dataclasses.replace(hall, scripted="behaviors of its own (nurse)")
    subject = exporting.ExportSubject(world=world, config=StackConfig())
    with pytest.raises(WorldError, match=r"because of behaviors of its own \(nurse\)"):
        exporting.write_export(subject, kind, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_the_map_and_a_kept_run_of_such_a_world_are_exported(hall, hall_trace, tmp_path):
    world = dataclasses.replace(hall, scripted="behaviors of its own (nurse)")
    subject = exporting.ExportSubject(world=world, config=StackConfig(), trace=hall_trace)
    for kind, name in (("sdf", "a.sdf"), ("nav2", "a.yaml"), ("gif", "a.gif")):
        assert all(
            path.is_file() for path in exporting.write_export(subject, kind, tmp_path / name)
        )


class Names:
    """A stranger's format: the names of the robots, and how many ticks they ran."""

    @dataclasses.dataclass(frozen=True)
    class Options:
        """Nothing to choose."""

    of_run, of_folder = True, False

    def __init__(self, options):
        del options

    def write(self, exported, path):
        names = " ".join(robot.name for robot in exported.world.robots)
        path.write_text(f"{names} {len(exported.run())} {exported.costmap().resolution}")
        return (path,)


def test_a_format_of_somebody_else_is_written_as_ours_are(hall, hall_trace, tmp_path):
    subject = exporting.ExportSubject(world=hall, config=StackConfig(), trace=hall_trace)
    kind = f"{__name__}:Names"
    (path,) = exporting.write_export(subject, kind, tmp_path / "new" / "names.txt")
    assert path.read_text() == f"robot1 robot2 {len(hall_trace)} 0.05"


def test_a_format_that_nobody_writes_is_refused_with_those_that_are_known(hall, tmp_path):
    subject = exporting.ExportSubject(world=hall, config=StackConfig())
    with pytest.raises(ConfigError, match="--format is 'usd'; it must be one of gif, mcap, mp4"):
        exporting.write_export(subject, "usd", tmp_path / "out")
    assert not list(tmp_path.iterdir())
