"""The commands check and sample, and what they say of programs that are wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.commands.check import check
from mrta_falsify.commands.programs import draw_candidates, open_scenario
from mrta_falsify.commands.sample import sample
from mrta_falsify.commands.stacks import costmap_of
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.candidate import Candidate
from mrta_falsify.core.costmap import LETHAL
from mrta_falsify.core.world import read_world
from simulator_interface.formats import nav2

pytestmark = pytest.mark.slow  # compiles Scenic programs

BAD = Path(__file__).parent / "bad_scenarios"
PNG = b"\x89PNG\r\n\x1a\n"

PROGRAM = """\
param horizon = 300
param gap = 0.2
model scenic_worlds.model
new Robot with name 'robot1', with start_room 0
new Robot with name 'robot2', with start_room 1
bed = new Bed with name 'bed', in corridors
new Chair with name 'chair', at bed offset by Range(0, 3) @ 0
new Human with route [0, 2], with speed Range(0.6, 1.4)
param tasks = [(Range(0, 5), 0, 1, 200), (5, DiscreteRange(1, 4), 0, 250)]
limit = Range(0, 1)
require bed.position.x > -5 - limit
"""


@pytest.fixture
def program(tmp_path) -> Path:
    path = tmp_path / "small.scenic"
    path.write_text(PROGRAM)
    return path


# --- check ---------------------------------------------------------------------------------


def test_check_has_a_table_of_dimensions_only_where_there_are_some(cli, tmp_path):
    path = tmp_path / "fixed.scenic"
    lines = [
        "model scenic_worlds.model",
        "new Robot with start_room 0",
        "param tasks = [(0, 1, 2, 200)]",
    ]
    path.write_text("\n".join(lines))
    fixed = cli("check", str(path), "--count", "1").stdout
    assert "0 dimensions" in fixed
    assert "kind" not in fixed
    lines += ["bed = new Bed in corridors", "new IVStand in beside(bed)"]
    path.write_text("\n".join(lines))
    rows = [line.split() for line in cli("check", str(path), "--count", "1").stdout.splitlines()]
    assert ["dimension", "kind", "values"] in rows
    assert ["iv_stand_1.position.0", "point", "depends", "on", "others"] in rows


def test_check_tells_dimensions_speed_rejecters_and_lint(cli, program):
    result = cli("check", str(program), "--count", "6", "--format", "json", "-o", "out")
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    kinds = {entry["name"]: entry["kind"] for entry in data["dimensions"]}
    assert kinds["bed.position.0"] == "point"
    assert kinds["tasks[0][0]"] == "range"
    assert data["k"] == len(data["dimensions"]) == len(kinds)
    assert data["opaque"] == []
    assert data["compile_s"] > 0.0
    assert 0.0 < data["scene_ms"]["median"] <= data["scene_ms"]["p90"]
    assert data["scenes"] == 6
    assert 0.0 <= data["acceptance"] < 1.0
    assert sum(entry["count"] for entry in data["rejections"]) > 0
    assert {entry["who"] for entry in data["rejections"]} & {
        "bed is not inside its region",
        "chair is not inside its region",
        "bed collides with chair",
    }
    where = {finding["code"]: finding["where"] for finding in data["lint"]}
    assert where == {
        "random-only-in-require": f"{program}:10",
        "unknown-param": f"{program}:2",  # nothing reads `gap`
    }
    assert json.loads(Path("out/check.json").read_text())["k"] == data["k"]
    assert Path("out/contact_sheet.png").read_bytes().startswith(PNG)


def test_check_as_text_names_what_matters(cli, program):
    result = cli("check", str(program), "--count", "3", "--seed", "5")
    assert result.exit_code == 0, result.stderr
    for part in ("bed.position.0", "per scene   median", "accepted", "random-only-in-require"):
        assert part in result.stdout


@pytest.mark.slow
def test_check_draws_the_candidates_of_a_campaign(program):
    done = check(str(program), count=2, seed=7)
    assert done.worlds[0].digest() == find_world(str(program), seed=7).digest()
    assert done.worlds[0].digest() != done.worlds[1].digest()


@pytest.mark.slow
def test_mode_exact_takes_whole_scenes(program):
    done = check(str(program), count=3, seed=1, mode="exact")
    attempts = sum(item.attempts for item in done.drawn)
    assert done.acceptance == pytest.approx(3 / attempts)
    assert sum(count for _, count in done.rejections) == attempts - 3


@pytest.mark.slow
def test_several_programs_make_a_table_and_a_broken_one_does_not_hide_the_others(cli, program):
    result = cli("check", str(program), str(BAD / "syntax_error.scenic"), "--count", "2")
    assert result.exit_code == 2
    assert "small" in result.stdout
    assert "error, see below" in result.stdout
    assert "syntax_error.scenic:3" in result.stderr


# --- sample --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sampled(tmp_path_factory) -> Path:
    """Directory with two sampled worlds of the small program, which lies beside it."""
    folder = tmp_path_factory.mktemp("sampled")
    program = folder / "small.scenic"
    program.write_text(PROGRAM)
    sample(str(program), folder / "out", count=2, seed=7)
    return folder / "out"


@pytest.mark.slow
def test_sample_writes_world_picture_and_map_of_each_candidate(sampled):
    index = json.loads((sampled / "samples.json").read_text())
    assert len(index["samples"]) == 2
    for number, row in enumerate(index["samples"]):
        world = read_world(sampled / f"world_{number:03d}.json")
        assert world.digest() == row["world_digest"]
        assert (sampled / f"world_{number:03d}.png").read_bytes().startswith(PNG)
        grid = nav2.read_nav2_map(sampled / f"world_{number:03d}.yaml")
        costmap = costmap_of(world)
        assert grid.data.shape == costmap.cost.shape
        assert ((grid.data == 100) == (costmap.cost == LETHAL)).all()
    assert (sampled / "contact_sheet.png").read_bytes().startswith(PNG)


@pytest.mark.slow
def test_a_sampled_candidate_gives_its_world_by_itself(sampled):
    program = open_scenario(str(sampled.parent / "small.scenic"))
    for row in json.loads((sampled / "samples.json").read_text())["samples"]:
        candidate = Candidate(number=row["number"], u=frozen_array(row["u"]), seed=row["seed"])
        again = program.realise(candidate, "exact")
        assert again.attempts == 1
        assert again.world.digest() == row["world_digest"]


@pytest.mark.slow
def test_the_same_seed_writes_the_same_files(cli, sampled):
    program = sampled.parent / "small.scenic"
    result = cli("sample", str(program), "--count", "2", "--seed", "7", "-o", "again")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.splitlines() == ["again/world_000.json", "again/world_001.json"]
    names = sorted(path.name for path in sampled.iterdir())
    assert len(names) == 2 * 4 + 2
    for name in names:
        assert (sampled / name).read_bytes() == (Path("again") / name).read_bytes(), name


@pytest.mark.slow
def test_sample_overrides_parameters_and_takes_the_costmap_from_the_stack(cli, program):
    result = cli(
        *("sample", str(program), "--count", "1", "-o", "out"),
        *("-p", "horizon=120", "--set", "costmap.resolution=0.2"),
    )
    assert result.exit_code == 0, result.stderr
    assert read_world(Path("out/world_000.json")).horizon == 120.0
    assert nav2.read_nav2_map(Path("out/world_000.yaml")).resolution == 0.2


# --- bad input -----------------------------------------------------------------------------


def assert_refused(result, *parts: str) -> None:
    assert result.exit_code == 2, result.output + result.stderr
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert "Traceback" not in line
    for part in parts:
        assert part in line


CASES = {
    "syntax_error": [":3: ", "invalid syntax"],
    "unknown_name": [":3: ", "'Sofabed' is not defined"],
    "unknown_specifier": [":4: ", "'positon'; did you mean 'position'?"],
    "wrong_value": [":3: ", '"width" of Bed'],
    "random_control_flow": [":4: ", "random"],
    "random_condition": [":4: ", "cannot depend on a random value"],
    "unsatisfiable": ["unsatisfiable.scenic:5: requirement 'chair beside bed' does not hold ("],
    "never_true": ["never_true.scenic:3: requirement does not hold", "no sample can be valid"],
    "requirement_that_fails": [":4: ", "requirement cannot be evaluated: ZeroDivisionError"],
    "outside": ["outside.scenic:3: ", "stray bed at (100, 100) is not inside its region"],
    "colliding": ["colliding.scenic:4: ", "second chair at (0.2, 9)", "first chair at (0, 9)"],
    "crowded_out": ["bed_0 collides with bed_1 (", "bed_0 is made at ", "crowded_out.scenic:4"],
    "robots_too_near": ["robots_too_near.scenic:3: ", "robot2 at (0, 2.2) stands where robot1"],
    "no_model": ["no_model.scenic", "has no `model scenic_worlds.model` at its top"],
    "misspelt_model": [":1: ", "scenic_worlds.modle; did you mean 'scenic_worlds.model'?"],
    "misspelt_class": [":2: ", "'Robott' is not defined; did you mean 'Robot'?"],
    "misspelt_place": [":3: ", "'along_wal' is not defined; did you mean 'along_wall'?"],
    "misspelt_option": [":3: ", "keyword argument 'fit'; did you mean 'fits'?"],
    "misspelt_length": [":2: ", "hospital has no parameter 'corridor_widht'", "'corridor_width'?"],
    "misspelt_tasks": ["has no tasks (param task is not read; did you mean 'tasks'?)"],
    "robot_without_model": [
        ":2: ",
        "'Robot' is not defined",
        "need the line `model scenic_worlds.",
    ],
    "unknown_without_model": [":1: ", "'Zeppelin' is not defined", "need the line `model scenic_"],
    "parts_without_model": ["has no `model scenic_worlds.model` at its top"],
    "in_the_wall": [":3: bookshelf_1 fits nowhere", "`on along_wall(1)`, which puts its back edge"],
    "no_robots": ["no_robots.scenic: has no robot"],
    "no_tasks": ["no_tasks.scenic: has no tasks"],
    "task_to_nowhere": ["task_to_nowhere.scenic: param tasks[1]: unknown room '17'"],
    "negative_height": ["furniture[", "(flat chair).height is -1.0 m; it must be > 0"],
    "negative_speed": ["humans[0] (moonwalker).speed is -1."],
    "tasks_are_no_list": ["param tasks is 5; it must be a list"],
    "deadline_before_arrival": [
        "param tasks[1]: deadline 20 s is before its arrival at ... s (40 times)"
    ],
    "ends_python": ["the program ends Python by sys.exit"],
    "unknown_room": [":3: ", "unknown room 'ward_nroth'; did you mean 'ward_northwest'?"],
    "unknown_layout": [":1: ", "unknown layout 'aws_hospitl'; did you mean 'aws_hospital'?"],
    "unreachable_room": [":1: ", "'store' cannot be reached from 'lab'"],
}


#: checked with each change; the others, which take a second each, by the whole suite
QUICK = (
    "colliding",
    "in_the_wall",
    "misspelt_class",
    "misspelt_model",
    "no_model",
    "syntax_error",
    "task_to_nowhere",
    "unknown_name",
    "unreachable_room",
    "unsatisfiable",
)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in CASES],
)
def test_a_wrong_program_is_refused_with_its_place_and_culprit(cli, name):
    path = BAD / f"{name}.scenic"
    result = cli("check", str(path), "--count", "2", "--max-attempts", "40")
    assert_refused(result, name, *CASES[name])


def test_every_bad_scenario_has_a_case():
    assert {path.stem for path in BAD.glob("*.scenic")} == set(CASES)


@pytest.mark.parametrize(
    ("args", "part"),
    [
        (["check"], "give a SCENARIO or several, or --all"),
        (["check", "--all", "hospital_day"], "give a SCENARIO or several, or --all"),
        (["check", "absent.scenic"], "absent.scenic: cannot be read: no such file"),
        (["check", "hospital_dya"], "unknown scenario 'hospital_dya'; did you mean 'hospital_day'"),
        (["check", "hospital_day", "--count", "0"], "0 is not allowed; it must be from 1 to"),
        (["check", "hospital_day", "--mode", "quick"], "'quick' is not one of"),
        (["check", "hospital_day", "-p", "speed"], "-p speed: it must read NAME=VALUE"),
        (["sample", "hospital_day"], "Missing option '-o'"),
        (["sample", "hospital_day", "-o", "o", "--set", "costmap.resolution=-1"], "must be > 0"),
    ],
)
def test_wrong_usage_is_refused(cli, args, part):
    assert_refused(cli(*args), part)


def test_a_parameter_that_no_file_of_the_program_mentions_is_refused(cli, program):
    result = cli("check", str(program), "-p", "horizn=20")
    assert_refused(result, "unknown parameter 'horizn'; did you mean 'horizon'?", str(program))


def test_a_program_that_is_a_directory_is_refused(cli, tmp_path):
    (tmp_path / "folder.scenic").mkdir()
    assert_refused(
        cli("check", "folder.scenic"), "folder.scenic: cannot be read: it is a directory"
    )


# --- values that no world can have ---------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        ("campaign", "PROGRAM", "--budget", "1", "--workers", "1", "-o", "out"),
        ("run", "PROGRAM", "-o", "out"),
        ("sample", "PROGRAM", "--count", "1", "-o", "out"),
    ],
    ids=lambda command: command[0],
)
def test_every_command_refuses_a_program_that_samples_a_forbidden_value(cli, command):
    program = str(BAD / "negative_speed.scenic")
    result = cli(*(program if part == "PROGRAM" else part for part in command))
    assert result.exit_code == 2, result.output
    assert f"{program}: humans[0] (moonwalker).speed is -1." in result.stderr
    assert "it must be >= 0" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", ["campaign", "run", "sample"])
def test_every_command_refuses_a_misspelt_class(cli, command):
    result = cli(command, str(BAD / "misspelt_class.scenic"), "-o", "out")
    assert result.exit_code == 2, result.output
    assert "misspelt_class.scenic:2: unknown name" in result.stderr
    assert "did you mean 'Robot'?" in result.stderr


def test_a_campaign_refuses_a_misspelt_parameter(cli, program):
    result = cli("campaign", str(program), "-p", "gop=0.3", "--budget", "1", "-o", "out")
    assert result.exit_code == 2, result.output
    assert "did you mean 'gap'" in result.stderr


def test_a_later_scene_with_a_forbidden_value_is_a_rejected_candidate(tmp_path):
    from mrta_falsify.campaigns.settings import TrialSettings
    from mrta_falsify.lab import open_program
    from mrta_falsify.worker import TrialRunner

    path = tmp_path / "sometimes.scenic"
    path.write_text(
        "model scenic_worlds.model\nnew Robot with start_room 0\n"
        "new Human with route [0, 1], with speed Range(-1, 1)\nparam tasks = [(0, 0, 1, 200)]\n"
    )
    program = open_scenario(str(path))
    seeds = range(20)
    starts = [program.candidate(seed, 0).u[0] for seed in seeds]
    seed = next(s for s, u in zip(seeds, starts, strict=True) if u > 0.5)
    drawn = list(draw_candidates(program, count=8, seed=seed))
    assert drawn[0].world is not None
    refused = [item for item in drawn if item.world is None]
    assert refused
    assert all("speed is -0." in item.error for item in refused)
    settings = TrialSettings(scenario=str(path), seed=seed)
    record = TrialRunner(settings, open_program(settings)).run(0, np.array([0.25]))
    assert record.status == "rejected"
    assert "humans[0] (human_1).speed is -0.5 m/s; it must be >= 0" in record.error
