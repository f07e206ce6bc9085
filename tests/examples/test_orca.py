"""examples/orca: a short day is the same day again, from stored answers and by asking anew."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands.stored_trials import open_campaign

ROOT = Path(__file__).parent.parent.parent
SHORT_DAY = """
from scenic_worlds.floors import hospital
param layout = hospital(shape='line', rooms=2, spots=1, station=False, parking=2)
model scenic_worlds.model
for i in range(2):
    new Robot with start_room i
new Human with route [(0, 0), (5, 0)]
param horizon = 60
param tasks = [(0, 0, 1, 60)]
"""

pytestmark = [
    pytest.mark.slow,  # whole runs
    pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux"),
    pytest.mark.skipif(importlib.util.find_spec("pyrvo") is None, reason="pyrvo is missing"),
]


@pytest.fixture(scope="module")
def day(tmp_path_factory) -> Path:
    """A campaign of one trial, a short day."""
    folder = tmp_path_factory.mktemp("orca")
    shutil.copyfile(ROOT / "examples/orca/orca_stack.py", folder / "orca_stack.py")
    shutil.copyfile(ROOT / "simulator_interface/clients/mrta_stack.py", folder / "mrta_stack.py")
    text = (ROOT / "examples/orca/stack.yaml").read_text()
    (folder / "stack.yaml").write_text(text.replace("python3", sys.executable))
    (folder / "short_day.scenic").write_text(SHORT_DAY)
    words = ["campaign", str(folder / "short_day.scenic"), "--stack", str(folder / "stack.yaml")]
    words += ["-o", str(folder / "day"), "--budget", "1", "--sampler", "random", "--workers", "1"]
    result = CliRunner().invoke(main, words, catch_exceptions=False)
    assert result.exit_code in (0, 1), result.output
    return folder / "day"


def test_orca_delivers_on_a_short_day(day):
    (record,) = open_campaign(day).records
    assert {v.spec: v.outcome for v in record.verdicts}["all_tasks_done"] == "holds"
    assert record.ended == "all-tasks-done"


@pytest.mark.parametrize("options", [("--verify", "2"), ("--live",)], ids=["stored", "live"])
def test_orca_gives_the_same_day_again(day, options):
    result = CliRunner().invoke(main, ["replay", str(day), "0000", *options])
    assert result.exit_code == 0, result.output
    assert "identical" in result.output
