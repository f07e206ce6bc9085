"""Columns in files are those in memory, whoever reads them."""

from __future__ import annotations

import multiprocessing
import os
import tempfile

import numpy as np
import pytest

from mrta_falsify.core import archives
from mrta_falsify.core import columns as columns_module
from mrta_falsify.core.columns import ColumnStore, FileColumns
from mrta_falsify.core.trace import read_trace, write_trace
from tests.conftest import scripted_trace

LAYOUT = np.dtype(
    [
        ("time", np.float64),
        ("pose", np.float64, (3, 2)),
        ("human_position", np.float64, (0, 2)),
        ("obstacle_points", np.float64, (3, 4, 2)),
        ("contact", np.bool_, (3,)),
    ]
)
ROWS = 50

KEPT_AS = {"obstacle_points": np.dtype(np.float32)}


def rows(seed: int = 0) -> list[bytes]:
    """Rows of random bytes that are numbers."""
    table = np.zeros(ROWS, LAYOUT)
    random = np.random.default_rng(seed)
    for name in LAYOUT.names:
        table[name] = (
            random.normal(size=table[name].shape) > 0.0
            if name == "contact"
            else (random.normal(size=table[name].shape))
        )
    return [row.tobytes() for row in table]


def filled(store: ColumnStore, given: list[bytes]) -> ColumnStore:
    for row in given:
        store.add(row)
    return store


def assert_same(one, other) -> None:
    assert list(one) == list(other)
    for name in one:
        assert one[name].dtype == other[name].dtype
        np.testing.assert_array_equal(one[name], other[name])


@pytest.fixture
def in_memory():
    return filled(ColumnStore(LAYOUT, kept_as=KEPT_AS), rows()).columns()


@pytest.mark.parametrize("block", [1, LAYOUT.itemsize * 7, LAYOUT.itemsize * ROWS])
def test_files_hold_what_memory_holds(block, in_memory):
    in_files = filled(ColumnStore(LAYOUT, block, kept_as=KEPT_AS), rows()).columns()
    assert isinstance(in_files, FileColumns)
    assert_same(in_files, in_memory)
    assert in_files["obstacle_points"].dtype == np.float32


def test_no_file_has_a_name(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    in_files = filled(ColumnStore(LAYOUT, 1, kept_as=KEPT_AS), rows()).columns()
    assert os.listdir(tmp_path) == []
    assert len(in_files["time"]) == ROWS


def _send(pipe) -> None:
    pipe.send(filled(ColumnStore(LAYOUT, 1, kept_as=KEPT_AS), rows()).columns())
    pipe.recv()


def test_another_process_reads_the_files(in_memory):
    here, there = multiprocessing.get_context("fork").Pipe()
    process = multiprocessing.get_context("fork").Process(target=_send, args=(there,))
    process.start()
    received = here.recv()
    here.send("thanks")
    process.join()
    assert_same(received, in_memory)


def test_a_copy_that_is_taken_back_leaves_nothing_behind(in_memory):
    given = rows()
    store = filled(ColumnStore(LAYOUT, LAYOUT.itemsize * 4, kept_as=KEPT_AS), given[:21])
    child = os.fork()
    if child == 0:
        filled(store, rows(seed=1))
        os._exit(0)
    os.waitpid(child, 0)
    assert_same(filled(store, given[21:]).columns(), in_memory)


def test_a_long_run_has_the_trace_of_a_short_one(hall, monkeypatch, tmp_path):
    short = scripted_trace(hall, seconds=5.0)
    monkeypatch.setattr(columns_module, "BLOCK", 4096)
    monkeypatch.setattr(archives, "LARGE", 1024)
    long = scripted_trace(hall, seconds=5.0)
    assert isinstance(long.columns, FileColumns)
    assert long.digest == short.digest
    assert_same(long.columns, short.columns)
    write_trace(long, tmp_path / "trace.zip")
    again = read_trace(tmp_path / "trace.zip")
    assert isinstance(again.columns["pose"], np.memmap)
    for name, values in short.columns.items():
        np.testing.assert_array_equal(again.columns[name], values)
