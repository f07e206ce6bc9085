from __future__ import annotations

import json

import numpy as np
import pytest

from mrta_falsify.core.errors import InputError
from scenic_worlds.layouts import load_world
from simulator_interface.formats import mrta_sim

STREAM = {
    "tasks_stream": [
        {"arrival": 0, "tasks": [{"start": 1, "end": 4, "deadline": 200}]},
        {
            "arrival": 40,
            "tasks": [
                {"start": 3, "end": 0, "deadline": 150},
                {"start": 2, "end": 1, "deadline": 300},
            ],
        },
    ],
    "agents": [0, 3],
}
PAPER_SETUP = "agents:\n  robot1:\n    start: [0, 2.2]\n  robot2:\n    start: [4.25, -27.2]\n"


def _write(tmp_path, data, name="tasks.json"):
    path = tmp_path / name
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


def test_tasks_keep_the_order_of_the_file_and_their_batch_gives_the_arrival(tmp_path):
    stream = mrta_sim.read_task_stream(_write(tmp_path, STREAM), rooms=6)
    assert [(t.arrival, t.start, t.end, t.deadline) for t in stream.tasks] == [
        (0.0, 1, 4, 200.0),
        (40.0, 3, 0, 150.0),
        (40.0, 2, 1, 300.0),
    ]
    assert stream.agents == (0, 3)


def test_the_papers_robot_file_is_read_as_yaml_and_as_json(tmp_path):
    from_yaml = mrta_sim.read_robot_setup(_write(tmp_path, PAPER_SETUP, "robots.yaml"))
    as_json = {"agents": {"robot1": {"start": [0, 2.2]}, "robot2": {"start": [4.25, -27.2]}}}
    from_json = mrta_sim.read_robot_setup(_write(tmp_path, as_json, "robots.json"))
    for starts in (from_yaml, from_json):
        assert [start.name for start in starts] == ["robot1", "robot2"]
        np.testing.assert_allclose(starts[1].pose, [4.25, -27.2, 0.0])


def test_a_third_number_is_the_yaw(tmp_path):
    text = "agents: {r: {start: [1, 2, 1.57]}}"
    (start,) = mrta_sim.read_robot_setup(_write(tmp_path, text, "robots.yaml"))
    np.testing.assert_allclose(start.pose, [1.0, 2.0, 1.57])


def test_routes_become_people_who_repeat_them(tmp_path):
    text = "actor1:\n  - [-4, 11.1]\n  - [4, 11.1]\n# actor2:\n#   - [4.5, -10]\nactor3: [[1, 2]]\n"
    people = mrta_sim.read_human_routes(_write(tmp_path, text, "humans.yaml"))
    assert [human.name for human in people] == ["actor1", "actor3"]
    np.testing.assert_allclose(people[0].route, [[-4.0, 11.1], [4.0, 11.1]])
    assert all(human.repeat and human.reacts_to_robots for human in people)


def _changed(**entry):
    return {"tasks_stream": [{"arrival": 10, "tasks": [entry]}], "agents": []}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (_changed(start=1, end=9, deadline=20), "tasks_stream[0].tasks[0].end is room 9; rooms"),
        (
            _changed(start=1, end=2, deadline=5),
            "tasks_stream[0].tasks[0].deadline is 5 s, before its arrival at 10 s",
        ),
        (_changed(start=1, end=2), "tasks_stream[0].tasks[0].deadline is missing"),
        (_changed(start=-1, end=2, deadline=20), "tasks_stream[0].tasks[0].start is -1; it must"),
        (
            _changed(start=1, end=2, dedline=20, deadline=20),
            "tasks_stream[0].tasks[0].dedline is not a known field; did you mean 'deadline'?",
        ),
        (
            _changed(start=1, end=2, deadline=float("nan")),
            "tasks_stream[0].tasks[0].deadline is nan s; it must be finite",
        ),
        ({"task_stream": []}, "tasks_stream is missing"),
        ({**STREAM, "agents": [0, 6]}, "agents[1] is room 6; rooms are 0 to 5"),
        ([], "top level is []; it must be an object"),
        ('{"tasks_stream": [', "is not valid JSON"),
    ],
)
def test_a_wrong_task_file_names_file_field_value_and_what_is_allowed(tmp_path, data, message):
    path = _write(tmp_path, data)
    with pytest.raises(InputError) as caught:
        mrta_sim.read_task_stream(path, rooms=6)
    assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("agents: {r: {start: [1]}}", "agents.r.start is [1.0]; it must be [x, y] or [x, y, yaw]"),
        ("agents: {r: {start: [a, b]}}", "agents.r.start is ['a', 'b']; it must be numbers"),
        ("agents: {r: {strat: [1, 2]}}", "agents.r.strat is not a known field; did you mean"),
        ("agents: {r: {start: [.nan, 2]}}", "agents.r.start is [nan, 2.0] m; it must be finite"),
        ("agents: {}", "agents is empty; it must name at least one robot"),
        ("robots: {}", "agents is missing"),
        ("agents: [1", "is not valid YAML"),
    ],
)
def test_a_wrong_robot_file_is_reported(tmp_path, text, message):
    path = _write(tmp_path, text, "robots.yaml")
    with pytest.raises(InputError) as caught:
        mrta_sim.read_robot_setup(path)
    assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("actor1: [1, 2]", "actor1: route has shape (2,)"),
        ("actor1: []", "actor1 is empty; a route needs at least one [x, y]"),
        ("actor1: [[1, .inf]]", "actor1: route is [[1.0, inf]] m; it must be finite"),
        ("- 1", "is not a waypoint file"),
        ("", "is not a waypoint file"),
    ],
)
def test_a_wrong_waypoint_file_is_reported(tmp_path, text, message):
    path = _write(tmp_path, text, "humans.yaml")
    with pytest.raises(InputError) as caught:
        mrta_sim.read_human_routes(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def test_robots_go_to_the_rooms_of_the_task_file(hall):
    placed = mrta_sim.robots_at_rooms(hall.robots, (0, 0, 1), hall.rooms)
    assert [robot.name for robot in placed] == ["robot1", "robot2", "robot3"]
    assert placed[0] is hall.robots[0]  # stands there already
    np.testing.assert_allclose(placed[1].pose, [1.5, 2.0, np.pi])
    np.testing.assert_allclose(placed[2].pose, [10.5, 6.0, 0.0])
    assert len(mrta_sim.robots_at_rooms(hall.robots, (1,), hall.rooms)) == 1


def test_a_robot_the_world_knows_keeps_its_properties(hall, tmp_path):
    text = "agents: {robot2: {start: [3, 1]}, extra: {start: [1, 1]}}"
    starts = mrta_sim.read_robot_setup(_write(tmp_path, text, "robots.yaml"))
    known, new = mrta_sim.robots_from_setup(hall.robots, starts)
    assert (known.name, new.name) == ("robot2", "extra")
    assert known.max_speed == hall.robots[1].max_speed


def test_the_published_files_are_read(reference_data):
    day = load_world("aws_hospital_day")
    folder = reference_data / "smrta" / "simulation"
    for path in sorted(folder.glob("*.json")):
        stream = mrta_sim.read_task_stream(path, rooms=6)
        assert stream.tasks
        assert len(set(stream.agents)) == len(stream.agents)
    stream = mrta_sim.read_task_stream(folder / "testcase_6agents_3_3.json", rooms=6)
    shipped = [(t.arrival, t.start, t.end, t.deadline) for t in day.tasks]
    assert [(t.arrival, t.start, t.end, t.deadline) for t in stream.tasks] == shipped
    assert mrta_sim.robots_at_rooms(day.robots, stream.agents, day.rooms) == day.robots
    starts = mrta_sim.read_robot_setup(reference_data / "aws_hospital" / "robot_setup_6.json")
    assert [start.name for start in starts] == [f"robot{i}" for i in range(1, 7)]
    humans = mrta_sim.read_human_routes(
        reference_data / "aws_hospital" / "humans_waypoint_config3.yaml"
    )
    assert len(humans) == 8
    for human, shipped_human in zip(humans, day.humans, strict=True):
        np.testing.assert_allclose(human.route, shipped_human.route)


def test_the_benchmark_streams_with_65_rooms_are_read(reference_data):
    for path in sorted((reference_data / "smrta").glob("*/b_1*.json")):
        assert len(mrta_sim.read_task_stream(path, rooms=65).tasks) >= 200
