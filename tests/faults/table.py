"""The table of faults: what is changed in which file, and which tests must notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

from mrta_falsify.core import codec

TABLE = Path(__file__).with_name("faults.yaml")
Version = Literal["before", "now"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """One fault in one version of the code."""

    file: str  #: relative to the top of the tree
    find: str  #: text that occurs once in the file
    replace: str
    tests: tuple[str, ...]  #: files or nodes, of which one must fail


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A slip that an engineer could make."""

    name: str
    now: Edit
    before: Edit  #: the same in commit 302ad1d; the table leaves out what is as it is now


def read_faults(path: Path = TABLE) -> tuple[Fault, ...]:
    """Read the table.

    Raises:
        InputError: an entry lacks a field or has one too many.
    """
    rows = cast("list[dict[str, Any]]", codec.read_yaml(path))
    return tuple(_read_fault(row, where=f"{path.name}: {row['name']}") for row in rows)


def _read_fault(row: dict[str, Any], *, where: str) -> Fault:
    whole = {**row, "before": {**row["now"], **row.get("before", {})}}
    return codec.decode(Fault, whole, where=where)


def count_of(edit: Edit, tree: Path) -> int:
    """Count how often the text to be replaced occurs; 0 if the file does not exist."""
    path = tree / edit.file
    return path.read_text(encoding="utf-8").count(edit.find) if path.is_file() else 0


def faulty_text(edit: Edit, tree: Path) -> str:
    """Give the text of the file with the fault in it."""
    return (tree / edit.file).read_text(encoding="utf-8").replace(edit.find, edit.replace)


def edit_of(fault: Fault, version: Version) -> Edit:
    """Choose the edit of one version."""
    return fault.now if version == "now" else fault.before
