"""Rows that outlive the process."""

from __future__ import annotations

import errno
from dataclasses import dataclass

import pytest

from mrta_falsify.campaigns.journal import RunJournal, append_row, read_rows, resumable
from mrta_falsify.core.interruption import Interrupted


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


@dataclass(frozen=True, slots=True)
class _Other:
    ran: bool
    time: float | None


def test_answers_are_known_to_the_next_cache(tmp_path):
    path = tmp_path / "answers.jsonl"
    first = RunJournal(_Answer, path)
    first.keep("a", _Answer(True, 2.5))
    first.keep("b", _Answer(False, None))
    assert RunJournal(_Answer, path).answers == first.answers


def test_a_damaged_answer_costs_one_run(tmp_path):
    path = tmp_path / "answers.jsonl"
    RunJournal(_Answer, path).keep("a", _Answer(True, 2.5))
    (sound,) = read_rows(path)
    for answer in ({"ran": "yes", "time": 1.0}, {"ran": True}, None):
        append_row(path, sound | {"run": "b", "answer": answer})
    append_row(path, {name: value for name, value in sound.items() if name != "run"})
    with path.open("a") as file:
        file.write('{"run": "torn')
    assert RunJournal(_Answer, path).answers == {"a": _Answer(True, 2.5)}


def test_a_journal_without_a_file_keeps_answers_for_this_process():
    journal = RunJournal(_Answer, None)
    journal.keep("a", _Answer(True, None))
    assert journal.answers == {"a": _Answer(True, None)}


def test_answers_of_an_older_version_or_of_other_code_are_not_believed(tmp_path):
    path = tmp_path / "answers.jsonl"
    append_row(path, {"run": "a", "ran": True, "time": None})  # as version 1 wrote them
    assert RunJournal(_Answer, path, code="new").answers == {}
    RunJournal(_Answer, path, code="old").keep("a", _Answer(True, 1.0))
    assert RunJournal(_Answer, path, code="new").answers == {}
    RunJournal(_Answer, path, code="new").keep("a", _Answer(True, 2.0))
    assert RunJournal(_Answer, path, code="new").answers == {"a": _Answer(True, 2.0)}
    assert RunJournal(_Other, path, code="new").answers == {}


def test_where_nothing_can_be_written_answers_last_as_long_as_the_process(tmp_path, monkeypatch):
    def is_read_only(path, row):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("mrta_falsify.campaigns.journal.append_row", is_read_only)
    journal = RunJournal(_Answer, tmp_path / "answers.jsonl")
    journal.keep("a", _Answer(True, None))
    assert journal.answers == {"a": _Answer(True, None)}
    assert not journal.is_kept


def test_an_interruption_says_what_the_journal_holds(tmp_path):
    path = tmp_path / "answers.jsonl"
    journal = RunJournal(_Answer, path)
    journal.keep("a", _Answer(True, 2.5))
    with pytest.raises(Interrupted) as told, resumable("minimize 0003", [journal]):
        raise KeyboardInterrupt
    assert told.value.kept == "1 finished run"
    assert told.value.missing.startswith("minimize 0003 has no result")
    assert RunJournal(_Answer, path).answers == journal.answers
    journal.discard()
    assert not path.exists()
