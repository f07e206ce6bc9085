from __future__ import annotations

import dataclasses

import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.errors import FormatError, InputError
from mrta_falsify.core.world import World, read_world, without_actors

BOX = [[0, 0], [1, 0], [1, 1]]
BLOCKAGE = {"kind": "blockage", "name": "b", "polygon": BOX, "start": 5, "end": 4}
OUTAGE = {"kind": "comms_outage", "name": "o", "robots": ["robot9"], "start": 0, "end": 1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 99}, "schema is 99; this version reads 1"),
        ({"bounds": [0, 0, 0, 1]}, "bounds is [0.0, 0.0, 0.0, 1.0]; it must be [x min"),
        (
            {"tasks": [{"arrival": 0, "start": 0, "end": 7, "deadline": 9}]},
            "tasks[0].end is room 7; rooms are 0 to 1",
        ),
        (
            {"tasks": [{"arrival": 0, "start": 2, "end": 1, "deadline": 9}]},
            "tasks[0].start is room 2; rooms are 0 to 1",
        ),
        (
            {"tasks": [{"arrival": 5, "start": 0, "end": 1, "deadline": 4}]},
            "tasks[0].deadline is 4.0 s, before its arrival at 5.0 s",
        ),
        ({"travel_times": []}, "travel_times has shape (0, 0); it must be (2, 2)"),
        (
            {"lanes": [{"start": 0, "end": 3, "to_queue": [], "to_room": []}]},
            "lanes[0] joins rooms 0 and 3; rooms are 0 to 1",
        ),
        (
            {"lanes": [{"start": 2, "end": 0, "to_queue": [], "to_room": []}]},
            "lanes[0] joins rooms 2 and 0; rooms are 0 to 1",
        ),
        (
            {"furniture": [{"name": "a", "kind": "b", "polygon": [[0, 0], [1, 1]]}]},
            "furniture[0].polygon has 2 corners; it needs at least 3",
        ),
        (
            {"events": [BLOCKAGE]},
            "events[0].end is 4.0 s, before its start at 5.0 s",
        ),
        (
            {"events": [OUTAGE]},
            "events[0].robots: unknown robot 'robot9'",
        ),
    ],
)  # fmt: skip
def test_a_contradiction_is_refused_with_both_sides(hall, change, message):
    with pytest.raises(InputError) as caught:
        codec.decode(World, {**codec.encode(hall), **change}, where="hall.json")
    assert str(caught.value).startswith(f"hall.json: {message}")


def test_two_robots_cannot_share_a_name(hall):
    twin = dataclasses.replace(hall.robots[1], name="robot1")
    with pytest.raises(InputError, match=r"robots\[1\].name is 'robot1', the name of robots\[0\]"):
        dataclasses.replace(hall, robots=(hall.robots[0], twin))


def test_a_file_without_bounds_is_not_a_world(tmp_path):
    path = tmp_path / "tasks.json"
    path.write_text('{"tasks_stream": []}')
    with pytest.raises(FormatError, match="is not a world file"):
        read_world(path)


def test_a_layout_is_a_world_without_actors(hall):
    layout = without_actors(hall)
    assert (layout.robots, layout.humans, layout.tasks, layout.events) == ((), (), (), ())
    assert layout.walls == hall.walls


def test_any_change_changes_the_digest(hall):
    moved = dataclasses.replace(hall.rooms[0], point=frozen_array([1.5, 2.000001]))
    assert dataclasses.replace(hall, rooms=(moved, hall.rooms[1])).digest() != hall.digest()
