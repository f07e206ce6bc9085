"""Worlds as building maps of Open-RMF, and as goals for Nav2."""

from __future__ import annotations

import dataclasses
import math
import shlex

import numpy as np
import yaml

from mrta_falsify.commands.export import export
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.world import Lane, Resource
from simulator_interface.formats.nav2_goals import goals_of
from simulator_interface.formats.open_rmf import building_map, dispatch_script


def level(world):
    return building_map(world)["levels"]["L1"]


def test_rooms_and_starts_are_named_vertices_at_their_places(hall):
    found = {vertex[3]: vertex for vertex in level(hall)["vertices"] if vertex[3]}
    assert found["store"][:2] == [1.5, 2.0]
    assert found["ward"][:2] == [10.5, 6.0]
    # robot1 starts in the room: one vertex for both
    assert found["store"][4]["spawn_robot_name"] == [1, "robot1"]
    assert found["ward"][4]["is_charger"] == [4, True]


def test_a_robot_off_the_lanes_is_joined_to_the_nearest_vertex(hall):
    moved = dataclasses.replace(hall.robots[0], pose=np.array([2.5, 2.0, 0.0]))
    found = level(dataclasses.replace(hall, robots=(moved, hall.robots[1])))
    names = [vertex[3] for vertex in found["vertices"]]
    ends = [(lane[0], lane[1]) for lane in found["lanes"]]
    assert (names.index("start_robot1"), names.index("store")) in ends


def test_without_lanes_the_rooms_of_each_task_are_joined(hall):
    found = level(hall)
    (lane, back) = found["lanes"]
    assert {lane[0], lane[1]} == {back[0], back[1]} == {0, 1}
    assert lane[2]["bidirectional"] == [4, True]


def test_lanes_go_one_way_and_a_corridor_for_one_becomes_a_mutex(hall):
    lane = Lane(
        start=0, end=1, to_queue=np.zeros((0, 2)), to_room=np.array([[5.0, 2.0], [7.0, 2.0]])
    )
    corridor = Resource(
        name="neck",
        kind="corridor",
        request_area=rectangle(2.5, 1.0, (6.0, 2.0)),
        release_area=rectangle(2.5, 1.0, (6.0, 2.0)),
    )
    found = level(dataclasses.replace(hall, lanes=(lane,), resources=(corridor,)))
    lanes = found["lanes"]
    assert [one[2]["bidirectional"][1] for one in lanes] == [False] * 3
    assert ["mutex" in one[2] for one in lanes] == [False, True, False]
    assert lanes[1][2]["mutex"] == [1, "neck"]
    wide = dataclasses.replace(corridor, capacity=2)
    found = level(dataclasses.replace(hall, lanes=(lane,), resources=(wide,)))
    assert not any("mutex" in one[2] for one in found["lanes"])


def test_walls_are_the_outlines_of_walls_and_furniture(hall):
    found = level(hall)
    corners = np.array([vertex[:2] for vertex in found["vertices"]])
    length = sum(math.dist(corners[one], corners[other]) for one, other, _ in found["walls"])
    table, side, end = 2 * (2.0 + 1.0), 2 * (12.4 + 0.2), 2 * (8.4 + 0.2)
    assert math.isclose(length, table + 2 * side + 2 * end, abs_tol=1e-6)
    assert len(found["floors"][0]["vertices"]) == 4


def test_tasks_become_patrols_that_begin_when_they_arrive(hall):
    lines = [shlex.split(line) for line in dispatch_script(hall).splitlines() if "ros2" in line]
    assert [line[line.index("-p") + 1 :][:2] for line in lines] == [
        ["store", "ward"],
        ["ward", "store"],
    ]
    assert [line[line.index("-st") + 1] for line in lines] == ["0", "5"]


def test_export_writes_both_files_and_they_read_as_yaml(hall, tmp_path):
    named = dataclasses.replace(hall, name="hall; rm -rf / #1")
    files = export(named, format="open-rmf", output=tmp_path / "rmf")
    assert [path.name for path in files] == ["hall_rm_-rf_1.building.yaml", "dispatch.sh"]
    data = yaml.safe_load(files[0].read_text())
    assert data["coordinate_system"] == "cartesian_meters"
    assert data["name"] == named.name
    numbers = range(len(data["levels"]["L1"]["vertices"]))
    used = [n for kind in ("lanes", "walls") for one in data["levels"]["L1"][kind] for n in one[:2]]
    assert set(used) <= set(numbers)
    assert files[1].stat().st_mode & 0o100


def test_goals_for_nav2_are_the_poses_of_starts_and_rooms(hall):
    found = goals_of(hall)
    assert found["initial_poses"]["robot2"] == {"x": 10.5, "y": 6.0, "yaw": np.pi}
    assert found["tasks"][1]["pickup"] == {"room": "ward", "x": 10.5, "y": 6.0}
