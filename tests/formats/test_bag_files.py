"""Logs as they are: cut, packed, in pieces, and told only in motion."""

from __future__ import annotations

import shutil
import sqlite3

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import CompressionMode

from mrta_falsify.core.errors import InputError
from simulator_interface.formats.fleet_log import with_stands
from simulator_interface.formats.rosbag_log import is_bag, read_bag
from tests import drawn_logs

STORAGES = {"mcap": ".mcap", "sqlite3": ".db3"}
UNTIL = 30.0  # s


def _stored(bag):
    (file,) = (file for file in bag.iterdir() if file.name != "metadata.yaml")
    return file


def _check_whole(log, until=UNTIL):
    assert [robot.name for robot in log.robots] == ["ada", "bob", "cyd"]
    assert log.duration == pytest.approx(until, abs=0.3)
    for robot in log.robots:
        at = robot.at(np.array([6.0]))[0]
        assert at == pytest.approx(np.array(drawn_logs.pose_at(robot.name, 6.0)), abs=0.06)
    assert log.grid is not None


@pytest.mark.parametrize("storage", STORAGES)
def test_a_killed_recorder_leaves_no_metadata(storage, tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", storage, UNTIL)
    (bag / "metadata.yaml").unlink()
    assert is_bag(bag)
    log = read_bag(bag)
    _check_whole(log)
    assert not log.is_cut


@pytest.mark.parametrize("packed", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_an_mcap_file_without_its_end_is_read_as_far_as_it_goes(packed, tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "mcap", UNTIL, packed=packed)
    file = _stored(bag)
    whole = file.read_bytes()
    for share in (0.95, 0.5):
        file.write_bytes(whole[: int(share * len(whole))])
        log = read_bag(bag)
        assert log.is_cut
        assert len(log.robots) == 3
        assert 2.0 < log.duration < UNTIL + 0.3
        assert any(file.name in note for note in log.notes)


def test_a_database_that_was_cut_is_read_as_far_as_it_goes(tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "sqlite3", UNTIL)
    file = _stored(bag)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(0.7 * len(whole))])
    log = read_bag(bag)
    assert log.is_cut
    assert len(log.robots) == 3
    assert 5.0 < log.duration < UNTIL


def test_the_journal_of_a_database_is_read_too(tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "sqlite3", UNTIL)
    file, live = _stored(bag), tmp_path / "live.db3"
    shutil.copy(file, live)
    database = sqlite3.connect(live)
    database.execute("PRAGMA journal_mode=WAL").fetchall()
    database.execute("PRAGMA wal_autocheckpoint=0").fetchall()
    half = database.execute("SELECT max(id) / 2 FROM messages").fetchone()[0]
    late = database.execute("SELECT * FROM messages WHERE id > ?", (half,)).fetchall()
    database.execute("DELETE FROM messages WHERE id > ?", (half,))
    database.commit()
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", late)
    database.commit()
    for ending in ("", "-wal"):  # as they lie on the disk when the recorder is killed
        shutil.copy(f"{live}{ending}", f"{file}{ending}")
    database.close()
    _check_whole(read_bag(bag))


@pytest.mark.parametrize(
    ("storage", "packed"),
    [
        ("mcap", CompressionMode.STORAGE),
        ("mcap", CompressionMode.FILE),
        ("mcap", CompressionMode.MESSAGE),
        ("sqlite3", CompressionMode.FILE),
        ("sqlite3", CompressionMode.MESSAGE),
    ],
)
@pytest.mark.parametrize("has_metadata", [True, False])
def test_what_is_compressed_is_read(storage, packed, has_metadata, tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", storage, UNTIL, packed=packed)
    if not has_metadata:
        (bag / "metadata.yaml").unlink()
    _check_whole(read_bag(bag))
    _check_whole(read_bag(_stored(bag)))


def test_a_packed_file_that_was_cut_is_read_as_far_as_it_goes(tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "mcap", UNTIL)
    file = _stored(bag)
    packed = zstandard.ZstdCompressor(level=1).compress(file.read_bytes())
    (bag / f"{file.name}.zstd").write_bytes(packed[: int(0.9 * len(packed))])
    file.unlink()
    log = read_bag(bag)
    assert log.is_cut
    assert log.duration > 2.0


@pytest.mark.parametrize("storage", STORAGES)
def test_several_bags_of_one_run_are_one_log(storage, tmp_path):
    run = tmp_path / "run"
    for name in ("ada", "bob", "cyd"):
        drawn_logs.write(
            run / name, "poses", storage, UNTIL,
            only=lambda time, topic, name=name: name in topic or "map" in topic,
        )  # fmt: skip
    assert is_bag(run)
    _check_whole(read_bag(run))


@pytest.mark.parametrize("storage", STORAGES)
def test_the_pieces_of_a_bag_are_one_log(storage, tmp_path):
    bag = tmp_path / "bag"
    for number, (first, last) in enumerate([(0.0, 10.0), (10.0, 20.0), (20.0, UNTIL)]):
        piece = drawn_logs.write(
            tmp_path / f"piece_{number}", "poses", storage, UNTIL,
            only=lambda time, topic, first=first, last=last: first <= time < last,
        )  # fmt: skip
        bag.mkdir(exist_ok=True)
        shutil.copy(_stored(piece), bag / f"bag_{number}{STORAGES[storage]}")
    _check_whole(read_bag(bag))
    (bag / f"bag_2{STORAGES[storage]}").write_bytes(b"")  # the last one had just been begun
    log = read_bag(bag)
    _check_whole(log, until=20.0)
    assert log.is_cut


def test_a_piece_that_is_not_there_is_told(tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "mcap", UNTIL)
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("- bag.mcap", "- bag.mcap\n  - bag_1.mcap"))
    log = read_bag(bag)
    assert any("bag_1.mcap" in note for note in log.notes)
    assert log.is_cut


def test_poses_told_only_in_motion_last_to_the_end_of_the_recording(tmp_path):
    log = read_bag(drawn_logs.write(tmp_path / "bag", "motion", "mcap", 60.0))
    assert log.duration == pytest.approx(60.0, abs=0.3)
    assert [robot.name for robot in log.silent()] == ["ada", "bob"]
    ada = log.robots[0]
    assert ada.at(np.array([55.0]))[0] == pytest.approx([7.7, 2.0, 0.0], abs=0.01)
    assert log.begins_at == pytest.approx(1.7e9)


def test_frames_may_have_their_robots_name_before_an_underscore(tmp_path):
    slashed, flat = (
        read_bag(drawn_logs.write(tmp_path / kind, kind, "mcap", UNTIL)) for kind in ("tf", "flat")
    )
    assert [robot.name for robot in flat.robots] == ["ada", "bob", "cyd"]  # and no ada_arm
    for one, other in zip(slashed.robots, flat.robots, strict=True):
        assert one.pose == pytest.approx(other.pose)
    assert {robot.source for robot in flat.robots} == {"TF"}


def test_a_robot_stands_in_the_gaps_between_its_poses():
    driven = np.arange(0.0, 5.0, 0.5)
    time = np.concatenate([driven, driven + 60.0])
    x = np.concatenate([driven, driven + 4.75])
    pose = np.stack([x, 0.0 * x, 0.0 * x], axis=-1)
    when, where = with_stands(time, pose)
    assert len(when) == len(time) + 1
    found = np.interp([4.5, 30.0, 59.0, 60.0], when, where[:, 0])
    assert found == pytest.approx([4.5, 4.5, 4.5, 4.75])


def test_a_robot_that_drives_slowly_does_not_stand():
    time = np.arange(0.0, 60.0, 5.0)
    pose = np.stack([0.05 * time, 0.0 * time, 0.0 * time], axis=-1)
    assert len(with_stands(time, pose)[0]) == len(time)


def test_a_bag_of_ros_1_is_told_how_to_be_converted(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(InputError, match=r"rosbags-convert --src old\.bag"):
        read_bag(tmp_path / "old.bag")


def test_a_stamp_that_is_none_is_told(tmp_path):
    bag = drawn_logs.write(tmp_path / "bag", "poses", "sqlite3", UNTIL)
    database = sqlite3.connect(_stored(bag))
    database.execute("UPDATE messages SET timestamp = 5 WHERE id = 3")
    database.commit()
    database.close()
    with pytest.raises(InputError, match="days by its stamps"):
        read_bag(bag)
