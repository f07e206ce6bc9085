"""Certificates of deadlocks: a full ring is proved, edited certificates are refused."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from mrta_falsify.analysis.certify import checker
from mrta_falsify.analysis.certify.certifying import FREE_WAYS, certify
from mrta_falsify.analysis.certify.sentences import claim_sentences, read_certificate
from mrta_falsify.cli import main
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.geometry import rectangle
from mrta_falsify.core.trace import write_trace
from mrta_falsify.core.world import write_world
from mrta_falsify.trial import Job, judge, on_kinematic_engine
from scenic_worlds.zoo import load_scene
from tests.commands.edited_certificates import EDITS, edited, is_refused
from tests.reports.planted import stored


@pytest.fixture(scope="module")
def ring_campaign(tmp_path_factory):
    """A campaign of one trial, the full ring, whose deadlock is certified."""
    directory = tmp_path_factory.mktemp("ring") / "runs"
    world = load_scene("ring_of_six_areas_full").world
    job = Job(
        world=world,
        config=on_kinematic_engine(StackConfig()),
        specifications=("no_deadlock{copies: 1, look_ahead: 60}",),
        early_stop=True,
    )
    campaign = stored(directory, job, judge(job))
    done = CliRunner().invoke(main, ["certify", str(directory), "--format", "json"])
    assert (done.exit_code, json.loads(done.stdout)["certified"]) == (0, 1)
    return campaign


@pytest.fixture(scope="module")
def ring(ring_campaign):
    """The trial's files, with its certificate."""
    return ring_campaign.directory / "trials" / "0000"


def test_the_checker_needs_numpy_only_and_is_short():
    lines = Path(checker.__file__).read_text(encoding="utf-8")
    assert len(lines.splitlines()) <= 150
    imported = set()
    for node in ast.walk(ast.parse(lines)):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    assert imported - set(sys.stdlib_module_names) == {"numpy"}


def test_a_full_ring_is_certified_with_all_its_robots(ring):
    found = read_certificate(ring)
    assert [member.name for member in found.members] == [f"robot{i}" for i in range(1, 7)]
    assert all(len(member.robots) == 1 and member.area for member in found.members)
    first, second, *_ = claim_sentences(found)
    assert "closed circle" in first
    assert second == "robot1 wants to enter north_west, which robot2 fills."


def test_commands_tell_what_is_proved(ring_campaign):
    directory = str(ring_campaign.directory)
    shown = CliRunner().invoke(main, ["show", directory, "0000"])
    certified = CliRunner().invoke(main, ["certify", directory, "0"])
    assert certified.exit_code == shown.exit_code == 0
    for text in (shown.stdout, certified.stdout):
        assert "Certified: from 6.2 s on robot1, robot2, robot3, robot4" in text
        assert "robot6 wants to enter west, which robot1 fills." in text
    assert certified.stdout.endswith("1 of 1 trials with robots that stand certified\n")


@pytest.mark.slow
def test_the_report_tells_what_is_proved(ring_campaign):
    page = ring_campaign.directory / "report.html"
    done = CliRunner().invoke(main, ["report", str(ring_campaign.directory), "-o", str(page)])
    assert done.exit_code == 0
    text = page.read_text()
    assert '<span class="badge good">certified</span>' in text
    assert "robot6 wants to enter west, which robot1 fills." in text


def test_an_unknown_trial_is_refused(ring_campaign):
    done = CliRunner().invoke(main, ["certify", str(ring_campaign.directory), "7"])
    assert done.exit_code == 2
    assert "7" in done.stderr


def test_the_checker_runs_as_a_program_of_its_own(ring):
    command = [sys.executable, "-I", checker.__file__, str(ring)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "accepted\n"


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: edit.__name__)
def test_an_edit_of_meaning_is_refused(ring, edit):
    random = np.random.default_rng(1)
    for _ in range(2):
        data = json.loads((ring / "certificate.json").read_text())
        assert edit(data, random)
        assert is_refused(ring, data)


@pytest.mark.parametrize(
    "count", [pytest.param(20, marks=pytest.mark.slow), pytest.param(1000, marks=pytest.mark.long)]
)
def test_random_edits_are_refused(ring, count):
    random = np.random.default_rng(2)
    assert all(edited(ring, random)[1] for _ in range(count))


def test_an_edit_without_a_new_digest_is_refused(ring):
    data = json.loads((ring / "certificate.json").read_text())
    data["since"] = data["since"]
    checker.accept(ring, data)
    with pytest.raises(ValueError, match="its digest is another one"):
        checker.accept(ring, data | {"digest": "0" * 64})


def test_a_certificate_of_another_world_is_not_shown(ring, tmp_path):
    for name in ("world.json", "trace.zip", "certificate.json"):
        shutil.copy(ring / name, tmp_path)
    text = (tmp_path / "world.json").read_text().replace('"north_west"', '"nowhere"')
    (tmp_path / "world.json").write_text(text)
    assert read_certificate(tmp_path) is None


def test_robots_that_can_go_get_no_certificate(tmp_path):
    world = load_scene("doorway").world
    write_world(world, tmp_path / "world.json")
    job = Job(
        world=world, config=on_kinematic_engine(StackConfig()), specifications=("all_tasks_done",)
    )
    write_trace(judge(job).outcome.trace, tmp_path / "trace.zip")
    sought = certify(tmp_path)
    assert sought.certificate is None
    assert sought.missing == FREE_WAYS


def test_a_folder_without_files_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"no readable world\.json and trace\.zip"):
        certify(tmp_path)


def test_distance_to_a_polygon_is_exact():
    outline = rectangle(2.0, 1.0, (0.0, 0.0))
    x, y = np.array([0.0, 2.0, 0.0, 2.0]), np.array([0.2, 0.0, 1.5, 1.5])
    assert checker.distance(outline, x, y) == pytest.approx([0.0, 1.0, 1.0, np.sqrt(2.0)])


def test_cells_that_touch_at_corners_hang_together():
    free = np.array([[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 0]], dtype=bool)
    expected = free.copy()
    expected[0, 3] = False
    assert (checker.reached(free, (0, 0)) == expected).all()
