"""Tables in a pipe keep a row on one line."""

from __future__ import annotations

import pytest

from mrta_falsify.cli import output


def _printed(capsys) -> list[str]:
    table = output.new_table("id", "what happened")
    table.add_row("0001", "word " * 60)
    output.print_table(table)
    return capsys.readouterr().out.splitlines()


def test_a_row_is_one_line_in_a_pipe(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    lines = _printed(capsys)
    assert len(lines) == 2
    assert lines[1].count("word") == 60


@pytest.mark.parametrize("columns", ["80", "40"])
def test_columns_says_how_wide_it_is(capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    lines = _printed(capsys)
    assert len(lines) > 3
    assert max(map(len, lines)) <= int(columns)
