"""examples/room_keys: it does an ordinary day, and the search finds what is planted in it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.cli import main
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.world import read_world

ROOT = Path(__file__).parent.parent.parent
FOLDER = ROOT / "examples" / "room_keys"
FLAGS = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
CLIENTS = ROOT / "simulator_interface" / "clients"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> Path:
    """A copy of the example, built as its page says."""
    compiler = shutil.which("c++") or pytest.skip("there is no C++ compiler")
    folder = tmp_path_factory.mktemp("room_keys")
    for name in ("room_keys.cpp", "stack.yaml", "ward_deliveries.scenic"):
        shutil.copyfile(FOLDER / name, folder / name)
    command = [compiler, *FLAGS, f"-I{CLIENTS}", "-o", "room_keys", "room_keys.cpp"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder


def search(example: Path, output: Path, *options: str) -> Campaign:
    words = ["campaign", str(example / "ward_deliveries.scenic"), "-o", str(output)]
    words += ["--stack", str(example / "stack.yaml"), "--workers", "2", *options]
    result = CliRunner().invoke(main, words, catch_exceptions=False)
    assert result.exit_code in (0, 1), result.output
    return open_campaign(output)


@pytest.mark.long
def test_room_keys_does_an_ordinary_day(example, tmp_path):
    campaign = search(example, tmp_path / "day", "--budget", "1", "--sampler", "random")
    (record,) = campaign.records
    assert not record.failed
    assert record.ended == "all-tasks-done"


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_search_finds_the_ring_of_three_keys(example, tmp_path):
    campaign = search(
        example, tmp_path / "ring", "--sampler", "auto", "--seed", "0", "--budget", "20",
        "--spec", "no_deadlock", "--stop-after", "1",
    )  # fmt: skip
    record = next(record for record in campaign.records if record.failed)
    (verdict,) = [v for v in record.verdicts if v.spec == "no_deadlock"]
    assert verdict.evidence["confirmed"]
    members = verdict.evidence["members"]
    assert len(members) >= 3
    # Each member stands in the room that another one wants, and no two of them want each other's.
    folder = campaign.folder(record)
    world, trace = read_world(folder / "world.json"), read_trace(folder / "trace.zip")
    numbers = [trace.robots.index(name) for name in members]
    pose, goal = trace.columns["pose"][-1], trace.columns["goal"][-1]
    stands = {i: _room_at(world, pose[i, :2]) for i in numbers}
    wants = {i: _room_at(world, goal[i]) for i in numbers}
    assert None not in stands.values()
    assert sorted(stands.values()) == sorted(wants.values())
    holder = {room: i for i, room in stands.items()}
    assert all(wants[holder[wants[i]]] != stands[i] for i in numbers)


def _room_at(world, point):
    near = [k for k, room in enumerate(world.rooms) if abs(room.point - point).max() < 0.5]
    return near[0] if near else None
