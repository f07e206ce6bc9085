"""The table of faults: what is changed in which file, and which tests must notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from mrta_falsify.core import codec

TABLE = Path(__file__).with_name("faults.yaml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A slip that an engineer could make."""

    name: str
    file: str  #: relative to the top of the tree
    find: str  #: text that occurs once in the file
    replace: str
    tests: tuple[str, ...]  #: files or nodes, of which one must fail

    def count(self, tree: Path) -> int:
        """Count how often the text to be replaced occurs; 0 if the file does not exist."""
        path = tree / self.file
        return path.read_text(encoding="utf-8").count(self.find) if path.is_file() else 0

    def text(self, tree: Path) -> str:
        """Give the text of the file with the fault in it."""
        return (tree / self.file).read_text(encoding="utf-8").replace(self.find, self.replace)


def read_faults(path: Path = TABLE) -> tuple[Fault, ...]:
    """Read the table.

    Raises:
        InputError: an entry lacks a field or has one too many.
    """
    rows = cast("list[dict[str, Any]]", codec.read_yaml(path))
    return tuple(codec.decode(Fault, row, where=f"{path.name}: {row['name']}") for row in rows)
