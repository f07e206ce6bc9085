"""Rows that outlive the process."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from mrta_falsify.campaigns.journal import AnswerCache, append_row, read_rows


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


@dataclass(frozen=True, slots=True)
class _Answer:
    ran: bool
    time: float | None


def test_answers_are_known_to_the_next_cache(tmp_path):
    path = tmp_path / "answers.jsonl"
    first = AnswerCache(_Answer, path)
    first.keep("a", _Answer(True, 2.5))
    first.keep("b", _Answer(False, None))
    assert AnswerCache(_Answer, path).answers == first.answers


def test_a_damaged_answer_costs_one_run(tmp_path):
    path = tmp_path / "answers.jsonl"
    AnswerCache(_Answer, path).keep("a", _Answer(True, 2.5))
    for row in ({"run": "b", "ran": "yes", "time": 1.0}, {"ran": True, "time": 1.0}):
        append_row(path, row)
    with path.open("a") as file:
        file.write('{"run": "torn')
    assert AnswerCache(_Answer, path).answers == {"a": _Answer(True, 2.5)}


def test_a_cache_without_a_file_keeps_answers_for_this_process():
    cache = AnswerCache(_Answer, None)
    cache.keep("a", _Answer(True, None))
    assert cache.answers == {"a": _Answer(True, None)}
