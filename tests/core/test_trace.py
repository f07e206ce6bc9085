from __future__ import annotations

import dataclasses
import json
import zipfile

import numpy as np
import pytest

from mrta_falsify.core import codec
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.trace import INTENT_COLUMNS, SENSED_COLUMNS, read_trace, write_trace
from tests.conftest import scripted_trace


def test_a_trace_survives_the_way_to_disc_and_back(hall_trace, tmp_path):
    write_trace(hall_trace, tmp_path / "trace.zip")
    again = read_trace(tmp_path / "trace.zip")
    assert set(again.columns) == {*SENSED_COLUMNS, *INTENT_COLUMNS, "command"}
    for name, column in hall_trace.columns.items():
        np.testing.assert_array_equal(again.columns[name], column)
    assert again.events == hall_trace.events
    assert codec.encode(again.edges) == codec.encode(hall_trace.edges)
    assert again.digest == hall_trace.digest
    assert len(again) == 201
    assert again.duration == pytest.approx(10.0)


def test_an_edge_that_holds_on_is_one_span(hall_trace):
    assert [(span.first, span.last, span.edge.cause) for span in hall_trace.edges] == [
        (20, 59, "queue")
    ]


def test_an_edge_holds_at_both_ends_of_its_span(hall_trace):
    held = [tick for tick in range(len(hall_trace)) if hall_trace.edges_at(tick)]
    assert held == list(range(20, 60))


def test_an_unchanged_path_is_stored_once(hall_trace):
    assert [(change.tick, change.robot) for change in hall_trace.paths] == [(0, 0), (0, 1)]


def test_equal_runs_have_equal_digests_and_others_do_not(hall):
    first, second = scripted_trace(hall, seconds=2.0), scripted_trace(hall, seconds=2.0)
    assert first.digest == second.digest
    moved = dataclasses.replace(hall.robots[0], pose=hall.robots[0].pose + 1e-12)
    other = dataclasses.replace(hall, robots=(moved, hall.robots[1]))
    assert scripted_trace(other, seconds=2.0).digest != first.digest


def test_columns_have_a_row_per_tick_of_the_type_that_frames_have(hall_trace):
    columns = hall_trace.columns
    assert columns["time"].shape == (201,)
    np.testing.assert_allclose(columns["time"], 0.05 * np.arange(201))
    assert columns["pose"].shape == (201, 2, 3)
    assert columns["contact"].dtype == np.bool_
    assert columns["phase"].dtype == np.int64
    assert columns["obstacle_points"].dtype == np.float32
    assert columns["furniture_pose"].shape == (201, 0, 3)
    assert all(column.flags.c_contiguous for column in columns.values())


def test_a_trace_that_is_not_kept_has_the_same_digest_and_no_columns(hall, hall_trace):
    bare = scripted_trace(hall, seconds=10.0, keep=False)
    assert bare.digest == hall_trace.digest
    assert not bare.columns
    assert not bare.edges


def test_writing_leaves_no_half_file(hall_trace, tmp_path):
    write_trace(hall_trace, tmp_path / "trace.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["trace.zip"]


def test_a_truncated_trace_is_refused(hall_trace, tmp_path):
    path = tmp_path / "trace.zip"
    write_trace(hall_trace, path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError, match="is not a readable trace"):
        read_trace(path)


def test_a_trace_of_another_version_is_refused(tmp_path):
    path = tmp_path / "trace.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("table.json", json.dumps({"version": 99}))
    with pytest.raises(FormatError, match="trace version 99; this version reads 1"):
        read_trace(path)


def test_pickled_columns_are_never_read(hall_trace, tmp_path):
    path = tmp_path / "trace.zip"
    write_trace(hall_trace, path)
    evil = tmp_path / "evil.zip"
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(evil, "w") as target:
        for name in source.namelist():
            if name != "pose.npy":
                target.writestr(name, source.read(name))
        with target.open("pose.npy", "w") as file:
            np.lib.format.write_array(file, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError, match="must be numbers"):
        read_trace(evil)


@pytest.mark.parametrize("share", np.linspace(0.0, 0.95, 20))
def test_a_trace_with_a_damaged_stretch_is_refused(hall_trace, tmp_path, share):
    path = tmp_path / "trace.zip"
    write_trace(hall_trace, path)
    data = bytearray(path.read_bytes())
    start = int(share * len(data))
    data[start : start + 40] = bytes(255 - byte for byte in data[start : start + 40])
    path.write_bytes(bytes(data))
    with pytest.raises(FormatError, match="is not a readable trace"):
        read_trace(path)
