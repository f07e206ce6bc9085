"""SMrTa's files in and out, and the command `allocate` on top of them."""

from __future__ import annotations

import json

import pytest

from mrta_falsify.commands.allocate import allocate, summarise_plan
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from simulator_interface.formats.smrta import read_case, read_travel_times

TIMES = [[0, 10, 20], [10, 0, 10], [20, 10, 0]]
TASKS = {
    "agents": [0, 2],
    "tasks_stream": [
        {"arrival": 0, "tasks": [{"start": 0, "end": 1, "deadline": 100}]},
        {"arrival": 50, "tasks": [{"start": 2, "end": 0, "deadline": 200}]},
    ],
}


@pytest.fixture
def files(tmp_path):
    def write(tasks=TASKS, times=TIMES):
        paths = tmp_path / "tasks.json", tmp_path / "times.json"
        matrix = times if isinstance(times, dict) else {"units": "s", "travel_time": times}
        for path, data in zip(paths, (tasks, matrix), strict=True):
            path.write_text(data if isinstance(data, str) else json.dumps(data))
        return paths

    return write


def as_data(answer):
    return codec.encode(summarise_plan(answer))


def changed(task=None, **fields):
    data = json.loads(json.dumps(TASKS))
    data["tasks_stream"][0]["tasks"][0].update(task or {})
    return {**data, **fields}


def test_a_plan_has_the_places_of_tasks_in_the_file(files):
    answer = allocate(*files())
    data = as_data(answer)
    assert data["status"] == "plan"
    assert data["robots"][0]["stops"] == [
        {"batch": 0, "task": 0, "action": "pickup", "room": 0, "time_s": 1.0},
        {"batch": 0, "task": 0, "action": "dropoff", "room": 1, "time_s": 12.0},
    ]
    assert [stop["batch"] for stop in data["robots"][1]["stops"]] == [1, 1]
    assert data["late"] == data["conflict"] == []


def test_the_same_plan_in_the_words_of_smrta(files):
    plan = allocate(*files()).smrta
    assert plan["agt"][0] == {"t": [0, 1, 12], "c": [0, 1, 0], "id": [0, 2, 3]}
    assert plan["ts"] == [[1], [51]]
    assert plan["td"] == [[12], [72]]
    assert plan["t2a"] == [[0], [1]]


def test_what_cannot_be_in_time_is_late_and_in_the_conflict(files):
    answer = allocate(*files(changed({"deadline": 5})))
    data = as_data(answer)
    assert data["late"] == [{"batch": 0, "task": 0}]
    assert data["status"] == "partial"  # proved for the first batch only, when it came
    one = {**changed({"deadline": 5}), "tasks_stream": changed({"deadline": 5})["tasks_stream"][:1]}
    data = as_data(allocate(*files(one)))
    assert data["status"] == "infeasible"
    assert data["conflict"] == [{"batch": 0, "task": 0}]
    assert "12 s" in data["reason"]


@pytest.mark.parametrize(
    ("tasks", "words"),
    [
        (changed({"start": 3}), "tasks[0].start is room 3; rooms are 0 to 2"),
        (changed({"start": -1}), "must be >= 0"),
        (changed({"deadline": 7.5}), "deadline is 7.5; it must be a whole number"),
        (changed({"deadline": -7}), "must be >= 0"),
        (changed({"dedline": 7}), "is not a known field; did you mean 'deadline'?"),
        (changed(agents=[]), "agents is empty"),
        (changed(agents=[5]), "agents[0] is room 5"),
        (changed(agents=["a"]), "must be a room number"),
        (changed(agents=None), "agents is missing"),
        (changed(more=1), "more is not a known field"),
        (changed(tasks_stream=[{"arrival": 2.5, "tasks": []}]), "must be a whole number"),
        (changed(tasks_stream=[{"arrival": 0}]), "tasks is missing"),
        (changed(tasks_stream=[3]), "must be an object"),
        ([], "a task file is an object"),
        ("{", "is not valid JSON"),
    ],
)
def test_a_bad_task_file_says_what_and_where(files, tasks, words):
    with pytest.raises(InputError) as caught:
        allocate(*files(tasks))
    assert words in str(caught.value)


def test_a_deadline_before_its_arrival_and_ids_given_twice_are_refused(files):
    task = {"start": 0, "end": 1, "deadline": 40, "id": "a"}
    early = {"agents": [0], "tasks_stream": [{"arrival": 50, "tasks": [task]}]}
    with pytest.raises(InputError, match="before its arrival at 50 s"):
        allocate(*files(early))
    twice = {"agents": [0], "tasks_stream": [{"arrival": 0, "tasks": [task, task]}]}
    with pytest.raises(InputError, match=r"id 'a' was given to tasks_stream\[0\].tasks\[0\]"):
        allocate(*files(twice))


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([[0, 1], [1, 0], [2, 2]], "has 2 entries; not 3"),
        ([[0, None], [1, 0]], "the matrix must be complete"),
        ([[0, -1], [1, 0]], "from 0 to 1e9"),
        ([[0, "x"], [1, 0]], "must be a number"),
        ([], "travel_time is missing"),
        ({"units": "hours", "travel_time": TIMES}, "units is 'hours'"),
        ({"rooms": ["a"], "travel_time": TIMES}, "rooms names 1 rooms"),
    ],
)
def test_bad_travel_times_say_what_and_where(files, times, words):
    with pytest.raises(InputError) as caught:
        allocate(*files(TASKS, times))
    assert words in str(caught.value)


@pytest.mark.parametrize("capacity", [0, -1, 10**9])
def test_a_capacity_out_of_range_is_refused(files, capacity):
    with pytest.raises(InputError, match="capacity is"):
        allocate(*files(), capacity=capacity)


def test_too_many_tasks_are_a_stated_limit(files):
    many = [{"start": 0, "end": 1, "deadline": 9}] * 100_001
    tasks = {"agents": [0], "tasks_stream": [{"arrival": 0, "tasks": many}]}
    with pytest.raises(InputError, match="has 100001 tasks; at most 100000"):
        allocate(*files(tasks))


def test_travel_times_are_rounded_up_and_closed_and_may_be_asymmetric(files):
    _, path = files(TASKS, [[0, 4.2, 30], [7, 0, 5], [1, 1, 0]])
    table = read_travel_times(path)
    assert table.times.tolist() == [[0, 5, 10], [6, 0, 5], [1, 1, 0]]
    assert table.shortened == 2


def test_whole_numbers_may_be_written_with_a_point(files):
    path, _ = files(changed({"deadline": 100.0}))
    assert read_case(path, rooms=3).batches[0][0].deadline == 100.0


def test_an_unknown_allocator_names_the_known_ones(files):
    with pytest.raises(InputError, match=r"Known: .*insertion"):
        allocate(*files(), allocator=Choice("insertoin"))


# --- the command -----------------------------------------------------------------------------


def run(files, *args):
    from click.testing import CliRunner

    from mrta_falsify.cli import main

    tasks, times = files
    command = ["allocate", str(tasks), "--travel-times", str(times), *args]
    return CliRunner().invoke(main, command)


def test_the_command_prints_one_object_and_says_by_its_code_whether_all_is_in_time(files):
    done = run(files(), "--format", "json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["status"] == "plan"
    done = run(files(changed({"deadline": 5})), "--format", "json", "--allocator", "insertion")
    assert done.exit_code == 1
    assert json.loads(done.stdout)["late"] == [{"batch": 0, "task": 0}]


def test_the_command_prints_a_plan_to_read_and_one_for_smrta(files):
    done = run(files())
    assert "pickup 0.0 in 0 at 1; dropoff 0.0 in 1 at 12" in done.stdout
    done = run(files(), "--format", "smrta", "--keep", "--set", "objective=makespan")
    assert set(json.loads(done.stdout)) == {"agt", "ts", "td", "t2a"}


@pytest.mark.parametrize(
    "args",
    [
        ("--capacity", "0"),
        ("--allocator", "nobody"),
        ("--set", "objective=fun"),
        ("--set", "nonsense"),
        ("--capacity", "2.5"),
    ],
)
def test_bad_usage_ends_with_2_and_no_traceback(files, args):
    done = run(files(), *args)
    assert done.exit_code == 2
    assert "Traceback" not in done.output


def test_a_warning_tells_that_travel_times_were_closed(files):
    done = run(files(TASKS, [[0, 10, 50], [10, 0, 10], [20, 10, 0]]))
    assert done.exit_code == 0
    assert "1 travel times were longer" in done.stderr
