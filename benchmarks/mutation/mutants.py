"""Mutants as values: what is changed in which file, in a list that people can write, too."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutation.layers import layer_of
from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError

HUNK = re.compile(r"^@@ -(\d+)(?:,(\d+))? \+\d+(?:,\d+)? @@")


class StaleMutantError(InputError):
    """A mutant was made for another text than the one there is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """Whole lines of one file that are replaced."""

    path: str  #: relative to the top of the tree, with slashes
    line: int  #: number of the first line, from 1
    before: str  #: these lines as they are, without the last line end
    after: str  #: what stands there instead
    digest: str = ""  #: of the file, see :func:`text_digest`; empty: not compared

    @property
    def lines(self) -> range:
        """Numbers of the lines that are replaced."""
        return range(self.line, self.line + len(self.before.split("\n")))


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One fault in the stack."""

    id: str
    edits: tuple[Edit, ...]
    operator: str = ""  #: that made it, empty: a person did
    layer: str = ""  #: that ``explain`` should name; empty: the code belongs to several
    what: str = ""  #: the change in a line

    @property
    def module(self) -> str:
        """The first file that it changes."""
        return self.edits[0].path


def text_digest(text: str) -> str:
    """Compute the first 12 digits of the sha256 of a file's text."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def mutated_texts(mutant: Mutant, tree: Path) -> dict[str, str]:
    """Compute the text of each file that a mutant changes.

    Args:
        mutant: to apply.
        tree: with the files as they are.

    Raises:
        StaleMutantError: a file is missing or differs from what the mutant was made for.
    """
    texts: dict[str, str] = {}
    for edit in sorted(mutant.edits, key=lambda edit: (edit.path, -edit.line)):
        if edit.path not in texts:
            texts[edit.path] = _text_of(mutant, edit, tree)
        texts[edit.path] = _replaced(mutant, edit, texts[edit.path])
    return texts


def _text_of(mutant: Mutant, edit: Edit, tree: Path) -> str:
    file = tree / edit.path
    if not file.is_file():
        raise StaleMutantError(f"mutant {mutant.id}: {edit.path}: there is no such file")
    text = file.read_text(encoding="utf-8")
    if edit.digest and text_digest(text) != edit.digest:
        raise StaleMutantError(
            f"mutant {mutant.id}: {edit.path}: was changed since the mutant was made (digest "
            f"{text_digest(text)} instead of {edit.digest}); make the mutant again"
        )
    return text


def _replaced(mutant: Mutant, edit: Edit, text: str) -> str:
    lines = text.split("\n")
    first = edit.line - 1
    there = "\n".join(lines[first : first + len(edit.lines)])
    if edit.line < 1 or there != edit.before:
        raise StaleMutantError(
            f"mutant {mutant.id}: {edit.path}:{edit.line}: reads {there!r}; the mutant was made "
            f"for {edit.before!r}; make the mutant again"
        )
    lines[first : first + len(edit.lines)] = edit.after.split("\n")
    return "\n".join(lines)


# --- lists and patches -----------------------------------------------------------------------


def write_mutants(mutants: Sequence[Mutant], path: Path) -> None:
    """Write a list of mutants as JSON."""
    path.write_text(json.dumps(codec.encode(list(mutants)), indent=1) + "\n", encoding="utf-8")


def read_mutants(path: Path) -> tuple[Mutant, ...]:
    """Read mutants from a JSON list, or from a folder of patches.

    Args:
        path: a file as :func:`write_mutants` writes it, or a folder with ``*.patch`` or
            ``*.diff`` files in the unified format, one mutant each.

    Raises:
        InputError: the file is not of that form, or two mutants have one name.
    """
    if path.is_dir():
        files = sorted([*path.glob("*.patch"), *path.glob("*.diff")])
        if not files:
            raise InputError(f"{path}: has no *.patch or *.diff file")
        found = [read_patch(file) for file in files]
    else:
        data = codec.read_json(path)
        if not isinstance(data, list):
            raise InputError(f"{path}: is {type(data).__name__}; it must be a list of mutants")
        found = [codec.decode(Mutant, row, where=f"{path}: {n}") for n, row in enumerate(data)]
    _check_names(path, found)
    return tuple(found)


def _check_names(path: Path, mutants: Iterable[Mutant]) -> None:
    seen: set[str] = set()
    for mutant in mutants:
        if not re.fullmatch(r"[\w.-]+", mutant.id) or mutant.id in seen:
            raise InputError(
                f"{path}: a mutant is called {mutant.id!r}; names must be unique and made of "
                "letters, digits, '_', '-' and '.'"
            )
        if not mutant.edits:
            raise InputError(f"{path}: mutant {mutant.id} changes nothing; give it edits")
        seen.add(mutant.id)


def read_patch(file: Path) -> Mutant:
    """Read a mutant from a patch in the unified format (``git diff``, ``diff -u``).

    Raises:
        InputError: it has no hunk, or one that is cut off.
    """
    edits: list[Edit] = []
    path = ""
    lines = file.read_text(encoding="utf-8").split("\n")
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if line.startswith("--- "):
            path = re.sub(r"^a/", "", line[4:].split("\t")[0].strip())
        found = HUNK.match(line)
        if found:
            count = int(found[2] or 1)
            edit, at = _hunk(file, path, int(found[1]), count, lines, at)
            edits.append(edit)
    if not edits:
        raise InputError(f"{file}: has no hunk; it must be a patch in the unified format")
    changes = [_change_of(edit) for edit in edits]
    return Mutant(
        id=file.stem, edits=tuple(edits), layer=layer_of(edits[0].path), what="; ".join(changes)
    )


def _hunk(
    file: Path, path: str, line: int, count: int, lines: Sequence[str], at: int
) -> tuple[Edit, int]:
    """Read the hunk whose lines begin at ``lines[at]``; where the next one may begin."""
    before: list[str] = []
    after: list[str] = []
    while at < len(lines):
        mark, text = lines[at][:1], lines[at][1:]
        if mark not in (" ", "-", "+", "\\") and not (mark == "" and len(before) < count):
            break
        if mark in (" ", "-", ""):
            before.append(text)
        if mark in (" ", "+", ""):
            after.append(text)
        at += 1
    if len(before) != count or not before:
        raise InputError(
            f"{file}: the hunk at line {line} of {path} has {len(before)} lines instead of {count}"
        )
    edit = Edit(path=path, line=line, before="\n".join(before), after="\n".join(after))
    return edit, at


def _change_of(edit: Edit) -> str:
    """Say in a line what a hunk changes."""
    before, after = edit.before.split("\n"), edit.after.split("\n")
    gone = [line.strip() for line in before if line not in after]
    new = [line.strip() for line in after if line not in before]
    return f"{' '.join(gone) or 'nothing'} -> {' '.join(new) or 'nothing'}"
