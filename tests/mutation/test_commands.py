"""The commands of the mutation benchmark refuse what they cannot use, in words."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from benchmarks.mutation import __main__ as commands
from benchmarks.mutation import trees
from benchmarks.mutation.mutants import Edit, Mutant, read_mutants, write_mutants

ROOT = Path(__file__).resolve().parents[2]
ROUTE = "mrta_falsify/stack/route.py"


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Run a command in a directory whose sources are a few files of the stack."""
    for package in trees.PACKAGES:
        (tmp_path / "source" / package).mkdir(parents=True)
    (tmp_path / "source" / ROUTE).parent.mkdir()
    shutil.copy(ROOT / ROUTE, tmp_path / "source" / ROUTE)
    shutil.copy(ROOT / "pyproject.toml", tmp_path / "source" / "pyproject.toml")
    trees.sound_tree(tmp_path / "out" / "trees", tmp_path / "source")

    def run(what: str, *more: str) -> int:
        arguments = ["mutation", what, str(tmp_path / "out"), *more]
        monkeypatch.setattr(sys, "argv", arguments)
        return commands.main()

    return run


def listed(path: Path, before: str) -> str:
    edit = Edit(path=ROUTE, line=1, before=before, after='"""Changed."""')
    write_mutants([Mutant(id="mine", edits=(edit,))], path)
    return str(path)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (("draw", "--reached"), "there are no worlds yet; run the command worlds first"),
        (("killable",), "there are no worlds yet"),
        (("search",), "there are no worlds yet"),
    ],
)
def test_a_command_says_what_must_be_run_before(command, capsys, what, words):
    assert command(*what) == 2
    assert words in capsys.readouterr().err


def test_mutants_are_drawn_once(command, tmp_path, capsys):
    assert command("draw", "--count", "3") == 0
    assert len(read_mutants(tmp_path / "out" / "mutants.json")) == 3
    assert command("draw", "--count", "3") == 0
    assert command("draw", "--count", "3", "--seed", "5") == 2
    assert "holds other mutants" in capsys.readouterr().err


def test_mutants_of_somebody_else_are_taken_if_they_fit(command, tmp_path, capsys):
    first = (ROOT / ROUTE).read_text(encoding="utf-8").split("\n")[0]
    assert command("take", listed(tmp_path / "old.json", "not there")) == 2
    assert "mutant mine: mrta_falsify/stack/route.py:1: reads" in capsys.readouterr().err
    assert not (tmp_path / "out" / "mutants.json").exists()
    assert command("take", listed(tmp_path / "new.json", first)) == 0
    assert [mutant.id for mutant in read_mutants(tmp_path / "out" / "mutants.json")] == ["mine"]
