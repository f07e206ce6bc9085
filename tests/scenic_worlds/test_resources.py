"""Corridors, doors, lifts, chargers and rooms of Scenic programs and floor files."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import Resource, read_world, write_world
from scenic_worlds.layouts import load_layout
from scenic_worlds.program import compile_program
from scenic_worlds.writing import write_program
from simulator_interface.formats.floor_yaml import read_floor
from simulator_interface.scenic_bridge.scene_values import SceneRejected

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # compiles Scenic programs

HEAD = "model scenic_worlds.model\nnew Robot with name 'robot1', with start_room 0\n"
TASKS = "param tasks = [(0, 1, 2, 150)]\n"
ROOMS = """
walls: [{line: [[0, 0], [12, 0], [12, 6], [0, 6], [0, 0]], thickness: 0.2}]
rooms: [{name: a, point: [1, 3]}, {name: b, point: [11, 3]}]
"""


@pytest.fixture
def world_of(tmp_path):
    def sample(text, seed=0):
        path = tmp_path / "program.scenic"
        path.write_text(HEAD + text + TASKS)
        return compile_program(path).sample(seed)

    return sample


def test_each_class_is_a_resource_of_its_kind_with_the_defaults_of_the_library(world_of):
    world = world_of(
        "new Corridor at (5, -8), facing 90 deg, with length 6, with width 2\n"
        "new Door at (5, 1)\nnew Lift at (4, 10)\nnew Charger at (-4, 10)\n"
    )
    added = world.resources[len(load_layout("aws_hospital").resources) :]
    assert [(r.name, r.kind, r.capacity, r.service_time) for r in added] == [
        ("corridor_1", "corridor", 1, 0.0),
        ("door_1", "door", 1, 3.0),
        ("elevator_1", "elevator", 1, 12.0),
        ("charger_1", "charger", 1, 10.0),
    ]
    corridor = added[0].release_area
    assert np.ptp(corridor, axis=0) == pytest.approx([6.0, 2.0])
    assert corridor.mean(axis=0) == pytest.approx([5.0, -8.0])
    assert np.ptp(added[0].request_area, axis=0) == pytest.approx([8.0, 4.0])  # 1 m all round


def test_what_a_resource_is_may_be_random_and_is_searched(tmp_path):
    path = tmp_path / "program.scenic"
    path.write_text(
        HEAD + "new Door with name 'fire_door', at (Range(4, 6), 1), with service_time Range(1, 9),"
        " with capacity DiscreteRange(1, 3), with hold Uniform('until_left', 'until_served'),"
        " with spots [(Range(4, 5), 4)], with active Uniform(True, False)\n" + TASKS
    )
    program = compile_program(path)
    assert len(program.space) == 6
    worlds = [program.sample(seed) for seed in range(8)]
    doors = [r for world in worlds for r in world.resources if r.name == "fire_door"]
    assert 0 < len(doors) < 8
    assert len({door.service_time for door in doors}) == len(doors)
    assert all(4 <= door.spots[0, 0] <= 5 for door in doors)


def test_how_a_room_is_used_can_be_changed_and_the_rest_stays(world_of):
    before = load_layout("aws_hospital").resources
    world = world_of("new RoomUse with room 'day_surgery', with capacity 2, with service_time 4\n")
    number = [room.name for room in world.rooms].index("day_surgery")
    for ours, theirs in zip(world.resources, before, strict=True):
        wanted = (
            dataclasses.replace(theirs, capacity=2, service_time=4.0)
            if theirs.room == number
            else theirs
        )
        assert codec.digest(ours) == codec.digest(wanted)


def test_furniture_of_a_kind_that_is_called_door_stays_furniture(world_of):
    world = world_of(
        "new Furniture with name 'leaf', with kind 'door', with width 0.8, with length 0.1,"
        " at (5, 4), with regionContainedIn everywhere\n"
    )
    assert world.furniture[-1].kind == "door"
    assert {resource.kind for resource in world.resources} == {"room"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("new Door at (5, 1), with capacity 0\n", "door_1: capacity is 0; it must be >= 1"),
        ("new Door at (5, 1), with service_time -2\n", "service_time is -2.0 s; it must be >= 0"),
        ("new Door at (5, 1), with hold 'always'\n", "hold is 'always'; it must be one of"),
        ("new Door at (5, 1), with kind 'gate'\n", "kind is 'gate'; it must be one of"),
        ("new Door at (5, 1), with kind 'room'\n", "it must be corridor, door, elevator or"),
        ("new Door at (5, 1), with spots [(5, 1.2)]\n", "inside the area; robots must wait"),
        ("new Door at (5, 1), with area [(0, 0), (2, 2), (2, 0), (0, 2)]\n", "cross itself"),
        ("new Door at (5, 1), with spots 7\n", "spots is 7; it must be a list of points"),
        ("new RoomUse with room 'ward_nord'\n", "unknown room 'ward_nord'"),
        ("new RoomUse with room 2, with capacity 1.5\n", "capacity is 1.5; it must be a whole"),
    ],
)
def test_what_is_not_allowed_is_named(text, message, world_of):
    with pytest.raises(InputError, match="(?s).*" + message.replace("(", r"\(")):
        world_of(text)


def test_a_waiting_spot_in_a_wall_rejects_the_scene(world_of):
    wall = load_layout("aws_hospital").walls[0].polygon.mean(axis=0)
    with pytest.raises((SceneRejected, WorldError), match=r"door_1: spots\[0\]"):
        world_of(f"new Door at (5, 1), with spots [({wall[0]:.3f}, {wall[1]:.3f})]\n")


def test_resources_and_named_robots_come_back_from_json_and_from_a_written_program(
    world_of, tmp_path
):
    world = world_of(
        "new Lift at (4, 10), with spots [(4, 12)], with capacity 2\n"
        "new Corridor with area [(4, -8), (6, -8), (6, -3)], with service_time 2\n"
        "new RoomUse with room 2, with hold 'until_served', with spots [(8, -9)]\n"
    )
    world = dataclasses.replace(world, tasks=(dataclasses.replace(world.tasks[0], robot="robot1"),))
    write_world(world, tmp_path / "world.json")
    assert read_world(tmp_path / "world.json").digest() == world.digest()
    files = write_program(world, tmp_path / "back.scenic")
    assert [file.name for file in files] == ["back.scenic"]  # the floor goes by its name
    again = compile_program(tmp_path / "back.scenic").sample(0)
    assert codec.encode(again.tasks) == codec.encode(world.tasks)
    assert codec.canonical_json(again.resources) == codec.canonical_json(world.resources)


def test_a_floor_without_one_of_its_resources_is_written_beside_the_program(world_of, tmp_path):
    world = world_of("")
    world = dataclasses.replace(world, resources=world.resources[1:])
    assert len(write_program(world, tmp_path / "back.scenic")) == 2
    again = compile_program(tmp_path / "back.scenic").sample(0)
    assert codec.canonical_json(again.resources) == codec.canonical_json(world.resources)


# --- floor files -----------------------------------------------------------------------------


@pytest.fixture
def floor_file(tmp_path):
    def write(text):
        path = tmp_path / "floor.yaml"
        path.write_text(ROOMS + text)
        return path

    return write


def test_a_floor_file_names_every_kind_of_resource(floor_file):
    layout = load_layout(
        floor_file(
            "resources:\n"
            "  - {name: middle, kind: corridor, box: [4, 0.1, 8, 5.9], spots: [[3, 1], [9, 5]]}\n"
            "  - {name: gate, kind: door, area: [[3, 2], [3.5, 2], [3.5, 4]], service_time: 5}\n"
            "  - {name: lift, kind: elevator, box: [8.5, 0.2, 9.5, 1.2], service_time: 9}\n"
            "  - {name: dock, kind: charger, box: [8.5, 4.5, 9.2, 5.2], capacity: 2,\n"
            "     hold: until_served, request_area: [[7, 3], [11, 3], [11, 6], [7, 6]]}\n"
        )
    )
    kinds = {resource.name: resource for resource in layout.resources}
    assert [kinds[name].kind for name in ("a", "b", "middle", "gate", "lift", "dock")] == [
        "room", "room", "corridor", "door", "elevator", "charger",
    ]  # fmt: skip
    assert kinds["middle"].spots.tolist() == [[3, 1], [9, 5]]
    assert (kinds["dock"].capacity, kinds["dock"].hold) == (2, "until_served")
    assert kinds["dock"].request_area.tolist() == [[7, 3], [11, 3], [11, 6], [7, 6]]
    middle = kinds["middle"].release_area
    low, high = middle.min(axis=0), middle.max(axis=0)
    inside = ((layout.parking > low) & (layout.parking < high)).all(axis=1)
    assert len(layout.parking)
    assert not inside.any()


def test_a_room_of_a_floor_file_says_how_it_is_held(tmp_path):
    path = tmp_path / "floor.yaml"
    path.write_text(
        ROOMS.replace(
            "{name: b, point: [11, 3]}",
            "{name: b, point: [11, 3], hold: until_served, entry: [[10, 3], [11, 3]],"
            " release_area: [[9, 1], [11.8, 1], [11.8, 5], [9, 5]],"
            " request_area: [[6, 1], [11.8, 1], [11.8, 5], [6, 5]]}",
        )
    )
    room: Resource = load_layout(path).resources[1]
    assert room.hold == "until_served"
    assert room.entry.tolist() == [[10, 3], [11, 3]]
    assert room.release_area.tolist() == [[9, 1], [11.8, 1], [11.8, 5], [9, 5]]
    assert room.request_area.tolist() == [[6, 1], [11.8, 1], [11.8, 5], [6, 5]]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{name: x, kind: gate, box: [4, 1, 5, 2]}", r"resources\[0\].kind is 'gate'; it must be"),
        ("{name: x, kind: room, box: [4, 1, 5, 2]}", "are fields of the room itself"),
        ("{name: x, kind: door}", "has neither; it must have one of area and box"),
        ("{name: x, kind: door, box: [4, 1, 5, 2], area: [[0, 0], [1, 0], [1, 1]]}", "area and"),
        ("{name: x, kind: door, box: [5, 1, 4, 2]}", r"box is \[5.0, 1.0, 4.0, 2.0\] m"),
        ("{name: a, kind: door, box: [4, 1, 5, 2]}", "name is 'a' again"),
        ("{name: x, kind: door, box: [4, 1, 5, 2], spots: [[4.5, 1.5]]}", "inside the area"),
        ("{name: x, kind: door, box: [4, 1, 5, 2], service_time: -1}", "it must be >= 0"),
        ("{name: x, kind: door, box: [4, 1, 5, 2], hold: ever}", "hold is 'ever'"),
        ("{name: x, kind: door, box: [4, 1, 5, 2], sopts: []}", "did you mean 'spots'"),
    ],
)
def test_what_a_floor_file_may_not_say_is_named(entry, message, floor_file):
    with pytest.raises(InputError, match=message):
        read_floor(floor_file(f"resources: [{entry}]\n"))


def test_a_spot_that_no_robot_can_reach_is_named(floor_file):
    with pytest.raises(WorldError, match=r"resource 'x': spots\[0\] is \[0.1, 3.0\] m"):
        load_layout(
            floor_file("resources: [{name: x, kind: door, box: [4, 1, 5, 2], spots: [[0.1, 3]]}]\n")
        )


def test_a_reader_keeps_its_arrays_frozen(floor_file):
    layout = load_layout(
        floor_file("resources: [{name: x, kind: door, box: [4, 1, 5, 2], spots: [[3, 1]]}]\n")
    )
    door = layout.resources[-1]
    assert not door.release_area.flags.writeable
    assert not door.request_area.flags.writeable
    assert frozen_array(door.spots).tolist() == [[3.0, 1.0]]
