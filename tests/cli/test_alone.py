"""The command without a command, and as a module."""

from __future__ import annotations

import subprocess
import sys

import pytest

import mrta_falsify as mf
from mrta_falsify.testing.wards import ward_layout


@pytest.mark.parametrize("module", ["mrta_falsify", "mrta_falsify.cli"])
def test_the_command_alone_prints_its_help_in_lines(module):
    ran = subprocess.run(
        [sys.executable, "-m", module], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0
    assert ran.stderr == ""
    lines = ran.stdout.splitlines()
    assert lines[0].startswith("Usage: mrta-falsify")
    assert any(line.strip().startswith("campaign ") for line in lines)


def test_files_are_named_by_text_as_well_as_by_paths(tmp_path):
    world = ward_layout(rooms=2)
    place = str(tmp_path / "world.json")
    mf.write_world(world, place)
    assert mf.read_world(place).digest() == world.digest()
    stack = tmp_path / "stack.yaml"
    stack.write_text("controller: decentralised_cbf\n")
    assert mf.read_config(str(stack)).controller.name == "decentralised_cbf"


def test_one_specification_is_named_by_text_and_a_trial_by_its_number(tmp_path):
    stack = mf.load_stack(settings=["engine=kinematic"])
    found = mf.campaign(
        "bed_in_the_doorway",
        tmp_path / "runs",
        budget=1,
        sampler="random",
        specs="no_robot_robot_contact",
        stack=stack,
        executor="serial",
    )
    assert found.campaign.settings.trials.specifications == ("no_robot_robot_contact",)
    assert found.campaign.record(0).id == "0000"
