"""Rows that outlive the process."""

from __future__ import annotations

import pytest

from mrta_falsify.campaigns.journal import append_row, read_rows


def test_rows_come_back_in_order(tmp_path):
    path = tmp_path / "rows.jsonl"
    for i in range(3):
        append_row(path, {"i": i, "text": "a\nb"})
    assert list(read_rows(path)) == [{"i": i, "text": "a\nb"} for i in range(3)]


def test_a_row_that_was_cut_short_is_lost_and_no_other(tmp_path):
    path = tmp_path / "rows.jsonl"
    append_row(path, {"i": 0})
    with path.open("a") as file:
        file.write('{"i": 1, "te')
    assert list(read_rows(path)) == [{"i": 0}]
    append_row(path, {"i": 2})
    assert list(read_rows(path)) == [{"i": 0}, {"i": 2}]


@pytest.mark.parametrize("line", [b"[1, 2]", b"7", b"", b"\xff\xfe"])
def test_what_is_no_row_is_left_out(tmp_path, line):
    path = tmp_path / "rows.jsonl"
    path.write_bytes(line + b"\n")
    append_row(path, {"i": 0})
    assert list(read_rows(path)) == [{"i": 0}]


def test_a_file_that_is_not_there_has_no_rows(tmp_path):
    assert list(read_rows(tmp_path / "rows.jsonl")) == []
