"""Worlds whose rooms are shut, as the commands tell them, from check to campaign."""

from __future__ import annotations

import json

import pytest

from mrta_falsify.commands.campaign import campaign
from mrta_falsify.commands.campaign_summary import summarise_campaign
from mrta_falsify.core import codec

pytestmark = pytest.mark.slow  # compiles a Scenic program, and runs short campaigns

#: in about half of its worlds a trolley fills a door that two of three tasks need
PROGRAM = """\
from scenic_worlds.floors import hospital
param layout = hospital(shape='line', rooms=3, door_width=1.0, parking=2)
model scenic_worlds.model
new Robot with name 'robot1', with start_room 1
new Trolley with name 'trolley', at (9.39, -1.65), with length 0.5, with width 0.8, \\
    with regionContainedIn free_floor, with active Uniform(True, False)
param tasks = [(0, 1, 3, 200), (0, 1, 2, 200), (0, 2, 1, 200)]
param horizon = 40
"""
BUDGET = 3


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    path = tmp_path_factory.mktemp("program") / "shut.scenic"
    path.write_text(PROGRAM)
    return path


def test_check_counts_the_worlds_in_which_a_thing_shuts_a_room(cli, program):
    data = json.loads(cli("check", str(program), "--count", "8", "--format", "json").stdout)
    (count,) = data["shut"]
    assert (count["room"], count["by"]) == ("ward_1", ["trolley"])
    assert 0 < count["worlds"] == len(data["impossible"]) < 8
    text = cli("check", str(program), "--count", "8").stdout
    assert f"in {count['worlds']} of 8 worlds trolley shuts ward_1" in text


def test_sample_says_which_worlds_no_stack_can_do(cli, program, tmp_path):
    options = ["--count", "2", "--seed", "1"]
    assert cli("sample", str(program), "-o", str(tmp_path), *options).exit_code == 0
    rows = json.loads((tmp_path / "samples.json").read_text())["samples"]
    reasons = [row.get("impossible", "") for row in rows]
    assert any("ward_1 is shut by trolley" in reason for reason in reasons)
    assert not all(reasons)


@pytest.fixture(scope="module")
def campaigns(program, tmp_path_factory):
    """Run the same campaign without shut rooms, and with them."""
    root = tmp_path_factory.mktemp("campaigns")
    return {
        with_shut_rooms: campaign(
            program,
            root / str(with_shut_rooms),
            budget=BUDGET,
            sampler="random",
            executor="serial",
            settings=["engine=kinematic"],
            specs=["all_tasks_done"],
            with_shut_rooms=with_shut_rooms,
        )
        for with_shut_rooms in (False, True)
    }


def test_a_campaign_sets_shut_worlds_apart_and_says_what_shuts_them(cli, campaigns):
    directory = campaigns[False].campaign.directory
    apart = [r for r in campaigns[False].campaign.records if r.status == "impossible"]
    summary = summarise_campaign(campaigns[False])
    assert (summary.ran, summary.impossible) == (BUDGET, len(apart))
    assert [(c.room, c.by, c.worlds) for c in summary.shut] == [
        ("ward_1", ("trolley",), len(apart))
    ]
    for record in apart:
        assert "task1: ward_1 is shut by trolley" in record.error
        assert [way.task for way in record.origin.shut] == [1, 2]
        assert not record.verdicts
    text = cli("campaign", "--resume", str(directory)).stdout
    assert f"impossible: ward_1 shut by trolley ({len(apart)})" in text


def test_with_shut_rooms_such_worlds_are_run_and_still_said_to_be_shut(cli, campaigns):
    stored = campaigns[True].campaign
    assert [record.status for record in stored.records] == ["ok"] * BUDGET
    shut = [record for record in stored.records if record.origin.shut]
    assert len(shut) == summarise_campaign(campaigns[True]).shut[0].worlds
    for record in shut:
        assert record.failed
        shown = cli("show", str(stored.directory), record.id).stdout
        assert "task1: ward_1 is shut by trolley" in shown


def test_settings_without_the_option_are_written_as_before(campaigns):
    without, with_rooms = (
        codec.encode(campaigns[which].campaign.settings.trials) for which in (False, True)
    )
    assert "with_shut_rooms" not in without
    assert with_rooms["with_shut_rooms"] is True
