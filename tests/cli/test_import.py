"""The command ``import``: what it prints, its files, its faults, and a trial on what it made."""

from __future__ import annotations

import json

import pytest

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
