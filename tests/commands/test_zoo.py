"""The zoo: its scenes, their answers, and what the default stack does in them."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands import zoo
from mrta_falsify.commands.worlds import find_world
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError, UnknownNameError
from mrta_falsify.core.verdict import unjudged
from mrta_falsify.lab import RunResult, laboratory
from mrta_falsify.possibility import look_at
from mrta_falsify.trial import campaign_specifications
from scenic_worlds.zoo import load_scene, read_scene, scene_names
from simulator_interface.starts import check_starts

#: what the default stack does on the kinematic engine
BREAKS = {
    "ring_of_six_areas_full": "no_deadlock",
}
SLOW = {
    "back_through_the_crossing": pytest.mark.slow,
    "ring_of_six_areas_full": pytest.mark.long,
    "two_zones_at_once": pytest.mark.slow,
}


@pytest.mark.parametrize("name", scene_names())
def test_a_scene_can_be_run_and_is_not_known_to_be_impossible(name):
    scene = load_scene(name)
    check_starts(scene.world)
    assert look_at(scene.world, campaign_specifications(StackConfig())).reason == ""
    assert scene.source.startswith(("https://", "docs/"))
    assert all(task.robot for task in scene.world.tasks)


def test_only_the_full_ring_cannot_be_done():
    hopeless = [name for name in scene_names() if load_scene(name).answer == "fails"]
    assert hopeless == ["ring_of_six_areas_full"]


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=SLOW.get(name, ())) for name in scene_names()],
)
def test_the_default_stack_does_what_is_recorded(name):
    (row,) = zoo.run_zoo(f"zoo/{name}", jittered=0)
    if name in BREAKS:
        assert row.fate == "fails"
        assert BREAKS[name] in row.violated
        assert row.sentence
    else:
        assert (row.fate, row.violated) == ("passes", ())
    assert row.is_as_known == (name not in BREAKS or load_scene(name).answer == "fails")


@pytest.mark.usefixtures("in_process")
def test_the_command_prints_one_row_for_a_scene():
    done = CliRunner().invoke(
        main, ["corpus", "zoo/doorway", "--perturbed", "0", "--format", "json"]
    )
    assert done.exit_code == 0
    data = json.loads(done.stdout)
    assert data["passes"] == 1
    assert data["scenes"][0]["name"] == "doorway"
    assert data["scenes"][0]["is_as_known"] is True


@pytest.mark.usefixtures("in_process")
def test_a_stack_may_refuse_one_scene_but_not_all(monkeypatch):
    def run(group):
        if any(load_scene(name).world.digest() == group[0].world.digest() for name in refused):
            return [RunResult(status="impossible", detail="no lattice")]
        return [RunResult(status="judged")]

    monkeypatch.setattr(laboratory, "run_group", run)
    monkeypatch.setattr(zoo, "scene_names", lambda: ("doorway", "roundabout"))
    refused = {"doorway"}
    first, second = zoo.run_zoo(jittered=0)
    assert (first.fate, first.sentence, first.is_as_known) == ("refused", "no lattice", False)
    assert second.fate == "passes"
    refused.add("roundabout")
    with pytest.raises(InputError, match="no lattice"):
        zoo.run_zoo(jittered=0)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("missing", "fate"), [("repeatable", "passes"), ("no_deadlock", "not judged")]
)
def test_a_scene_that_ends_before_the_stack_is_asked_again_passes(monkeypatch, missing, fate):
    ran = RunResult(status="not_judged", verdicts=(unjudged(missing, "it ended before"),))
    monkeypatch.setattr(laboratory, "run_group", lambda group: [ran])
    (row,) = zoo.run_zoo("zoo/doorway", jittered=0)
    assert row.fate == fate


def test_an_unknown_scene_is_named_with_the_nearest():
    done = CliRunner().invoke(main, ["corpus", "zoo/dorway"])
    assert done.exit_code == 2
    assert "did you mean 'doorway'?" in done.stderr


def test_a_scene_is_a_world_by_name():
    assert find_world("zoo/doorway").digest() == load_scene("doorway").world.digest()
    with pytest.raises(UnknownNameError, match="unknown scene of the zoo 'nowhere'"):
        find_world("zoo/nowhere")


def test_a_scene_with_an_unknown_room_is_refused(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(
        "title: t\nsource: s\npublished: p\nanswer: passes\nwhy: w\nfree: [[0, 0, 4, 4]]\n"
        "floor: {rooms: [{name: a, point: [1, 1]}, {name: b, point: [3, 3]}]}\n"
        "robots: [{name: robot1, room: c}]\ntasks: []\nhorizon: 10\n"
    )
    with pytest.raises(InputError, match=r"robots\[0\]: unknown room 'c'"):
        read_scene(path)
