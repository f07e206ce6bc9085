"""The command ``import``: what it prints, its files, its faults, and a trial on what it made."""

from __future__ import annotations

import json
import random
import shutil

import pytest

from mrta_falsify.core.world import read_world
from tests import drawn_buildings, drawn_logs
from tests.drawn_maps import ROOMS_TEXT, draw, ward_grid


def test_import_tells_what_was_derived_and_what_to_do_next(cli, tmp_path):
    draw(tmp_path, ward_grid())
    done = cli("import", "wards.yaml", "-o", "my floor")
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "floor     18.3 x 13.3 m, 5 walls"
    assert lines[1].startswith("map       366 x 266 cells of 0.05 m; ")
    assert lines[2].startswith("roadways  12 lanes, the longest trip takes ")
    assert [line.split()[0] for line in lines[-4:]] == ["lab", "ward", "store", "desk"]
    assert done.stderr.splitlines()[-2:] == [
        "try: mrta-falsify check 'my floor/wards.scenic'",
        "then: mrta-falsify campaign 'my floor/wards.scenic' -o runs/wards",
    ]
    names = {path.name for path in (tmp_path / "my floor").iterdir()}
    assert names == {
        "wards.floor.json", "wards.floor.png", "wards.derived.yaml", "wards.scenic",
    }  # fmt: skip

    again = cli("import", "wards.yaml", "-o", "my floor", "--radius", "0.3", "--format", "json")
    data = json.loads(again.stdout)
    assert data["scenario_kept"] is True
    assert data["robot_radius"] == 0.3
    assert [room["name"] for room in data["rooms"]] == ["lab", "ward", "store", "desk"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.yaml",), "none.yaml: cannot be read"),
        (("wards.pgm",), "wards.pgm: "),
        (("wards.yaml", "--rooms", "none.yaml"), "none.yaml: cannot be read"),
        (("wards.yaml", "--radius", "0.9"), "cannot be reached|from an obstacle"),
        (("wards.yaml", "--radius", "nan"), "finite"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(cli, tmp_path, arguments, words):
    draw(tmp_path, ward_grid(), rooms=ROOMS_TEXT)
    done = cli("import", *arguments, "-o", "out")
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert any(word in line for word in words.split("|"))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_trial_runs_on_an_imported_map(cli, tmp_path):
    draw(tmp_path, ward_grid())
    assert cli("import", "wards.yaml", "-o", "out").exit_code == 0
    checked = cli("check", "out/wards.scenic", "--count", "3", "--format", "json")
    data = json.loads(checked.stdout)
    assert (data["scenes"], data["failed"], data["lint"], data["impossible"]) == (3, 0, [], [])
    ran = cli("run", "out/wards.scenic", "--seed", "0", "--set", "engine=kinematic",
              "--format", "json")  # fmt: skip
    assert ran.exit_code in (0, 1), ran.stderr
    tasks = json.loads(ran.stdout)["tasks"]
    assert tasks["completed"] == tasks["total"] == 6


def test_import_tells_who_waited_for_whom_in_a_log(cli, tmp_path):
    drawn_logs.write(tmp_path / "incident", "odometry", "mcap")
    done = cli("import", "incident", "-o", "out")
    assert done.exit_code == 0, done.stderr
    assert "suspected a deadlock of ada, bob, since " in done.stdout
    assert "ada cannot drive on because bob stands in its path." in done.stdout
    assert "then: mrta-falsify campaign out/incident.scenic -o runs/incident" in done.stderr
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"incident.scenic", "incident.layout.json", "incident.world.json"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("incident", "--level", "L1"), "--level is for a map; incident is taken for a log"),
        (("wards.yaml", "--stack", "default"), "--stack is for a log; wards.yaml is taken for"),
        (("none.mcap",), "none.mcap: cannot be read: there is no such file"),
        (("incident", "--floor", "none.json"), "none.json: cannot be read"),
    ],
)
def test_options_of_logs_and_maps_are_not_mixed(cli, tmp_path, arguments, words):
    drawn_logs.write(tmp_path / "incident", "fleet", "mcap", until=5.0)
    done = cli("import", *arguments, "-o", "out")
    assert done.exit_code == 2
    assert words in done.stderr


def test_the_level_of_a_building_is_named(cli, tmp_path):
    (tmp_path / "b.building.yaml").write_text(drawn_buildings.text(("ground", "upper")))
    done = cli("import", "b.building.yaml", "-o", "out")
    assert (done.exit_code, "name one by --level" in done.stderr) == (2, True)
    done = cli("import", "b.building.yaml", "-o", "out", "--level", "upper")
    assert done.exit_code == 0, done.stderr
    assert "no counterpart: the levels ground: a floor is one level" in done.stderr
    assert (tmp_path / "out" / "b_upper.floor.json").is_file()


def _damaged(raw, rng):
    if rng.random() < 0.3:
        return raw[: rng.randrange(len(raw))]
    if rng.random() < 0.4:
        lines = raw.splitlines(keepends=True)
        del lines[rng.randrange(len(lines))]
        return b"".join(lines)
    changed = bytearray(raw)
    for _ in range(rng.choice([1, 20])):
        changed[rng.randrange(len(raw))] = rng.randrange(256)
    return bytes(changed)


@pytest.mark.parametrize("count", [30, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_logs_and_buildings_never_give_a_traceback(cli, tmp_path, count):
    rng = random.Random(21)
    kinds = {"odometry": "mcap", "tf": "sqlite3", "poses": "sqlite3", "fleet": "mcap"}
    whole = {
        kind: drawn_logs.write(tmp_path / "whole" / kind, kind, storage)
        for kind, storage in kinds.items()
    }
    building = drawn_buildings.text().encode()
    codes = []
    for number in range(count):
        if number % 2:
            path = tmp_path / "b.building.yaml"
            path.write_bytes(_damaged(building, rng))
        else:
            path = tmp_path / "log"
            shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(rng.choice(list(whole.values())), path)
            file = rng.choice(sorted(path.iterdir()))
            file.write_bytes(_damaged(file.read_bytes(), rng))
        done = cli("import", path.name, "-o", "out")
        assert "Traceback" not in done.output + done.stderr
        assert done.exit_code in (0, 2), (number, done.stderr, done.exception)
        codes.append(done.exit_code)
    assert codes.count(2) >= 0.3 * count


@pytest.mark.slow
def test_the_program_without_spread_is_the_incident(cli, tmp_path):
    drawn_logs.write(tmp_path / "incident", "odometry", "mcap")
    assert cli("import", "incident", "-o", "out").exit_code == 0
    checked = cli("check", "out/incident.scenic", "--count", "3", "--format", "json")
    data = json.loads(checked.stdout)
    assert (data["scenes"], data["failed"], data["lint"]) == (3, 0, [])
    sampled = cli("sample", "out/incident.scenic", "-p", "spread=0", "-o", "scene", "--count", "1")
    assert sampled.exit_code == 0, sampled.stderr
    world = read_world(tmp_path / "scene" / "world_000.json")
    incident = read_world(tmp_path / "out" / "incident.world.json")
    for ours, theirs in zip(world.robots, incident.robots, strict=True):
        assert ours.pose == pytest.approx(theirs.pose, abs=1e-6)
    assert [(t.arrival, t.start, t.end, t.robot) for t in world.tasks] == [
        (t.arrival, t.start, t.end, t.robot) for t in incident.tasks
    ]
