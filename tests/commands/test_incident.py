"""Logs of fleets: a known deadlock is named right in every format, and its scenario is written."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from mrta_falsify.commands.incident.importing import import_log
from mrta_falsify.commands.incident.judging import DT, frames_of_log
from mrta_falsify.commands.incident.legs import legs_of
from mrta_falsify.commands.incident.logs import read_log
from mrta_falsify.commands.incident.scene import floor_of_log, with_robots
from mrta_falsify.commands.stacks import costmap_of, load_stack
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.trace import TraceRecorder, write_trace
from mrta_falsify.core.world import read_world, write_world
from simulator_interface.formats.mcap import write_mcap
from tests import drawn_logs

KINDS = {
    "odometry": ("mcap", "told"),
    "tf": ("sqlite3", "path"),
    "poses": ("sqlite3", "guessed"),
    "fleet": ("mcap", "path"),
}


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    return {
        kind: drawn_logs.write(folder / kind, kind, storage) for kind, (storage, _) in KINDS.items()
    }


@pytest.fixture(scope="module")
def run(logs, tmp_path_factory) -> Path:
    """A run's folder as this toolkit writes it, of the same motion."""
    log, _ = read_log(logs["tf"])
    floor = floor_of_log(log, None, "corridor")
    world = with_robots(floor, log, radius=0.22, at=0.0)
    recorder = TraceRecorder(
        world_digest=world.digest(),
        dt=DT,
        robots=tuple(robot.name for robot in world.robots),
        humans=(),
    )
    for frame in frames_of_log(log, legs_of(log, floor), world):
        recorder.add(frame)
    folder = tmp_path_factory.mktemp("run")
    write_world(world, folder / "world.json")
    trace = recorder.finish("horizon")
    write_trace(trace, folder / "trace.zip")
    write_mcap(world, trace, costmap_of(world, load_stack()), folder / "run.mcap")
    return folder


def _check_deadlock(done):
    assert set(done.suspected) == {"ada", "bob"}
    assert len(done.waits) == 2
    assert done.onset_s == pytest.approx(drawn_logs.MET, abs=2.0)
    assert done.begin_s <= 1.5


@pytest.mark.parametrize("kind", KINDS)
def test_a_deadlock_in_a_log_of_another_writer_is_named(kind, logs, tmp_path):
    done = import_log(logs[kind], tmp_path)
    _check_deadlock(done)
    assert done.goals == (f"ada: {KINDS[kind][1]}", f"bob: {KINDS[kind][1]}", "cyd: none")
    assert done.has_map == (kind != "fleet")
    world = read_world(done.world)
    starts = {robot.name: robot.pose for robot in world.robots}
    expected = drawn_logs.pose_at("ada", done.begin_s)
    assert starts["ada"] == pytest.approx(np.array(expected), abs=0.1)
    trips = {task.robot: (task.start, task.end) for task in world.tasks}
    ends = {name: world.rooms[end].point[0] for name, (_, end) in trips.items()}
    assert ends["ada"] > 9.0  # beyond the other one
    assert ends["bob"] < 7.0


@pytest.mark.parametrize("kind", ["odometry", "poses"])
def test_a_single_file_of_a_bag_is_a_log(kind, logs, tmp_path):
    (file,) = (path for path in logs[kind].iterdir() if path.suffix in (".mcap", ".db3"))
    _check_deadlock(import_log(file, tmp_path))


def test_a_deadlock_in_a_run_of_this_toolkit_is_named(run, tmp_path):
    done = import_log(run, tmp_path / "a")
    _check_deadlock(done)
    assert import_log(run / "trace.zip", tmp_path / "b").suspected == done.suspected


def test_a_deadlock_in_our_own_mcap_is_named(run, tmp_path):
    _check_deadlock(import_log(run / "run.mcap", tmp_path))


def test_robots_that_have_not_stood_for_long_are_not_suspected(tmp_path):
    log = drawn_logs.write(tmp_path / "short", "odometry", "mcap", until=30.0)
    done = import_log(log, tmp_path / "out")
    assert done.suspected == ()
    assert done.onset_s is None
    assert done.tasks == 2


def test_transforms_go_over_the_odometry_frame(logs):
    log, _ = read_log(logs["tf"])
    (ada,) = (robot for robot in log.robots if robot.name == "ada")
    assert ada.source == "TF"
    assert ada.at(np.array([6.0]))[0] == pytest.approx(
        np.array(drawn_logs.pose_at("ada", 6.0)), abs=0.05
    )


def test_a_map_of_the_log_can_be_replaced(logs, tmp_path):
    first = import_log(logs["odometry"], tmp_path / "first")
    done = import_log(logs["fleet"], tmp_path / "out", floor=first.world)
    assert done.has_map
    assert len(read_world(done.world).walls) == len(read_world(first.world).walls)


def test_what_a_log_lacks_is_told(logs, tmp_path):
    with pytest.raises(InputError, match="no such file"):
        import_log(tmp_path / "none.mcap", tmp_path)
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="is damaged, or no log of ROS 2"):
        import_log(tmp_path / "empty.mcap", tmp_path)
    with pytest.raises(InputError, match="--set changes a stack"):
        import_log(logs["tf"], tmp_path, settings=("engine=kinematic",))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_deadlock_of_robots_that_tell_poses_only_in_motion_is_named(storage, tmp_path):
    done = import_log(drawn_logs.write(tmp_path / "log", "motion", storage), tmp_path / "out")
    _check_deadlock(done)
    assert done.duration_s == pytest.approx(drawn_logs.DURATION, abs=0.3)
    assert done.goals == ("ada: guessed", "bob: guessed", "cyd: none")
    assert any("ada (12.0 s) and bob (12.0 s)" in note for note in done.notes)
    assert done.doubts == ()


def test_what_the_end_of_a_log_does_not_tell_is_a_doubt(tmp_path):
    def alone(time: float, topic: str) -> bool:
        return "ada" in topic or "map" in topic

    log = drawn_logs.write(tmp_path / "log", "motion", "mcap", only=alone)
    done = import_log(log, tmp_path / "out")
    assert done.suspected == ()
    assert done.goals == ("ada: went there",)
    assert len(done.doubts) == 2  # whether it moved, and where it was to go
    always = drawn_logs.write(tmp_path / "always", "odometry", "mcap", only=alone)
    assert import_log(always, tmp_path / "out").doubts == ()
    short = drawn_logs.write(tmp_path / "short", "odometry", "mcap", until=20.0)
    assert len(import_log(short, tmp_path / "out").doubts) == 1


def test_a_robot_that_the_log_leaves_on_its_way_was_going_somewhere(tmp_path):
    log = drawn_logs.write(tmp_path / "log", "poses", "mcap", until=8.0)
    done = import_log(log, tmp_path / "out")
    assert done.goals == ("ada: last seen", "bob: last seen", "cyd: none")
    assert done.tasks == 2


def _damage(folder: Path, rng: random.Random) -> None:
    """Flip, cut, or drop a key in one of a log's files."""
    file = rng.choice(sorted(path for path in folder.iterdir() if path.name != "picture.png"))
    raw = bytearray(file.read_bytes())
    if file.suffix == ".yaml" and rng.random() < 0.5:
        lines = raw.splitlines(keepends=True)
        del lines[rng.randrange(len(lines))]
        raw = bytearray(b"".join(lines))
    elif rng.random() < 0.3:
        del raw[rng.randrange(len(raw)) :]
    else:
        for _ in range(rng.choice([1, 20, 400])):
            raw[rng.randrange(len(raw))] = rng.randrange(256)
    file.write_bytes(raw)


@pytest.mark.parametrize("count", [4, pytest.param(20, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", [*KINDS, "run"])
def test_damaged_logs_are_told_in_a_sentence(kind, count, logs, run, tmp_path):
    rng = random.Random(21)
    refused = 0
    for _ in range(count):
        copy = tmp_path / "log"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(run if kind == "run" else logs[kind], copy)
        if kind == "run":
            (copy / "run.mcap").unlink()
        _damage(copy, rng)
        try:
            done = import_log(copy, tmp_path / "out")
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017 - a run is refused, a bag read as it goes
            refused += 1
        else:
            assert done.robots
    assert refused >= (count // 4 if kind == "run" else 0)
