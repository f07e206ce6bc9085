"""Commands that write, on a disk with too little room: the file, exit code 2, no half file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from mrta_falsify.analysis.minimize import minimising
from mrta_falsify.campaigns.finding_files import FILE_NAMES
from mrta_falsify.cli import main
from mrta_falsify.commands import replay
from mrta_falsify.commands.report import build
from mrta_falsify.commands.report.writing import write_reports
from mrta_falsify.core.errors import PlaceError
from mrta_falsify.core.findings import Minimisation
from mrta_falsify.core.world import write_world
from mrta_falsify.testing.planted import STANDS
from tests.reports.planted import BROKEN, stalled_campaign
from tests.survival.disks import read_tree, small_disk

POINTS = 30  # sizes of the disk


@pytest.fixture(autouse=True)
def unsynced(monkeypatch):
    """Do not wait for the disk of this machine."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    monkeypatch.setenv("NO_COLOR", "1")


@pytest.fixture
def folder(tmp_path, stalled):
    """A folder with a campaign of one failure, and a world."""
    work = tmp_path / "work"
    work.mkdir()
    stalled_campaign(work / "c", stalled)
    write_world(stalled[0], work / "world.json")
    return work


def bytes_of(root):
    return sum(len(data or b"") for data in read_tree(root).values())


def called(folder, monkeypatch, args, *, room=None):
    """Call a command in ``folder``, with ``room`` bytes left on its disk."""
    monkeypatch.chdir(folder)
    with pytest.MonkeyPatch.context() as patch:
        if room is not None:
            small_disk(patch, folder, bytes_of(folder) + room)
        return CliRunner().invoke(main, args)


STACK = ("--set", "engine=kinematic", "--spec", STANDS)
QUICK = {
    "run": ("run", "world.json", *STACK, "-o", "out"),
    "sdf": ("export", "world.json", "--format", "sdf", "-o", "w.sdf"),
    "nav2": ("export", "c", "0", "--format", "nav2", "-o", "map.yaml"),
    "open-rmf": ("export", "world.json", "--format", "open-rmf", "-o", "rmf"),
    "report": ("report", "c", "--junit", "j.xml", "--markdown", "r.md"),
    "init": ("init", "new"),
    "replay": ("replay", "c", "0", "--verify", "1"),
}
SLOW = {
    "gif": ("export", "c", "0", "--format", "gif", "-o", "w.gif"),
    "issue": ("issue", "c", "0"),
    "explain": ("explain", "c", "0", "--max-runs", "4"),
    "minimize": ("minimize", "c", "0", "--max-runs", "2"),
    "corpus": ("corpus", "c", "--workers", "1", "--perturbed", "0"),
}


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.long) for name in SLOW)]
)
def test_a_command_on_a_full_disk_names_the_file_and_leaves_what_was_there(
    folder, monkeypatch, name
):
    args = (QUICK | SLOW)[name]
    before = {name: data for name, data in read_tree(folder).items() if data is not None}
    for room in (0, 100):
        result = called(folder, monkeypatch, args, room=room)
        assert result.exit_code == 2, result.stderr
        assert "No space left on device; make room" in result.stderr.splitlines()[-1]
        assert "Traceback" not in result.stderr
        there = read_tree(folder)
        assert not [name for name in there if name.endswith(".part")]
        assert {name: there[name] for name in before} == before
    again = called(folder, monkeypatch, args)
    assert again.exit_code in (0, 1), again.stderr


def test_a_report_is_there_whole_or_as_before_at_any_size_of_the_disk(folder, monkeypatch):
    page = "x" * 3000
    monkeypatch.setattr(build, "write_page", lambda report, path, drawn: write(path, page))

    def write(path, text):
        minimising.write_atomically(path, text.encode())

    (folder / "c" / "report.html").write_text("before")
    for point in range(POINTS):
        with pytest.MonkeyPatch.context() as patch:
            small_disk(patch, folder, bytes_of(folder) + len(page) * point // POINTS)
            with pytest.raises(PlaceError, match=r"report.html: cannot be written"):
                write_reports(folder / "c")
        assert (folder / "c" / "report.html").read_text() == "before"
    write_reports(folder / "c")
    assert (folder / "c" / "report.html").read_text() == page


def test_a_smallest_world_is_there_whole_or_as_before_at_any_size_of_the_disk(
    folder, monkeypatch, stalled
):
    world, judged = stalled
    finding = Minimisation(
        signature="s",
        removed=(),
        runs=1,
        one_minimal=True,
        counts={},
        world_digest=world.digest(),
        trace_digest=judged.outcome.trace.digest,
        verdicts=judged.verdicts,
    )
    found = SimpleNamespace(world=world, judged=judged, theirs=None, finding=finding)

    def program(found, job, stage):
        minimising.write_atomically(stage / minimising.PROGRAM, b"model" * 100)
        return "identical"

    monkeypatch.setattr(minimising, "write_as_program", program)
    trial = folder / "c" / "trials" / "0000"
    job = SimpleNamespace(config=BROKEN)

    def write():
        minimising._write(found, job, None, trial)

    write()
    mark = trial / FILE_NAMES[Minimisation]
    size = bytes_of(folder)
    written = sum((trial / name).stat().st_size for name in minimising.FILES
                  if (trial / name).exists()) + mark.stat().st_size  # fmt: skip
    before = read_tree(folder)
    for point in range(POINTS):
        with pytest.MonkeyPatch.context() as patch:
            small_disk(patch, folder, size + written * point // POINTS)
            with pytest.raises(PlaceError, match="make room"):
                write()
        assert read_tree(folder) == before
    mark.unlink()
    write()
    assert read_tree(folder) == before


def test_a_command_whose_campaign_is_removed_does_not_make_it_anew(folder, monkeypatch, stalled):
    def gone(*args, **more):
        shutil.rmtree(folder / "c")
        return judge(*args, **more)

    judge = replay.Lab.map
    monkeypatch.setattr(replay.Lab, "map", gone)
    result = called(folder, monkeypatch, QUICK["replay"])
    assert result.exit_code == 2, result.stderr
    assert not (folder / "c").exists()


def test_stdout_on_a_full_disk_is_a_place(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "mrta_falsify", "list", "c", "--format", "json"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ended.returncode == 2, ended.stderr
    assert "stdout: cannot be written: No space left on device" in ended.stderr
