"""One lint, and the text of the program that it points into."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenic_worlds.origins import origin_of
from scenic_worlds.shipped import LIBRARY
from scenic_worlds.sources import source_files


@dataclass(frozen=True, slots=True, order=True)
class Lint:
    """One finding."""

    where: str  #: ``file:line``, or the file where no line is known
    code: str
    name: str  #: of the value, parameter, property, object or requirement
    message: str


class ProgramText:
    """Lines of the program's file, and of the user's files that it imports.

    Args:
        path: of the program.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        top = path.resolve()
        imported = [
            file for file in source_files(path) if file != top and LIBRARY not in file.parents
        ]
        self._lines = {str(file): _lines_of(file) for file in (path, *imported)}

    @property
    def lines(self) -> list[str]:
        """Lines of the program's own file."""
        return self._lines[str(self._path)]

    def find(self, pattern: str) -> str:
        """Find the ``file:line`` of the first line that matches, empty if none does."""
        for file, lines in self._lines.items():
            for number, line in enumerate(lines, start=1):
                if re.search(pattern, _code_of(line)):
                    return f"{file}:{number}"
        return ""

    def place(self, pattern: str) -> str:
        """Find the first line that matches, or else the program's file."""
        return self.find(pattern) or str(self._path)

    def at(self, line: int) -> str:
        """Give the ``file:line`` of a line of the program's own file."""
        return f"{self._path}:{line}"

    def param(self, name: str) -> str:
        """Find where a global parameter is given."""
        return self.place(rf"^\s*param\b.*\b{re.escape(name)}\s*=")

    def assignment(self, name: str) -> str:
        """Find where a variable gets its value."""
        return self.place(rf"^\s*(?:\w+\s*,\s*)*{re.escape(name)}\s*(?:,\s*\w+\s*)*=[^=]")

    def object(self, thing: Any, name: str) -> str:
        """Find where an object is made, or else where its name is given."""
        origin = origin_of(thing)
        if origin is not None:
            return f"{origin[0]}:{origin[1]}"
        return self.place(rf"\bname\s+['\"]{re.escape(name)}['\"]")

    def specifier(self, thing: Any, name: str) -> str:
        """Find where an object gets a property by `with`."""
        pattern = rf"\bwith\s+{re.escape(name)}\b"
        origin = origin_of(thing)
        if origin is None:
            return self.place(pattern)
        file, first = origin
        for number, line in enumerate(self._lines.get(file, [])[first - 1 :], start=first):
            if re.search(pattern, _code_of(line)):
                return f"{file}:{number}"
        return f"{file}:{first}"

    def reads_property(self, name: str) -> bool:
        """Whether the program reads a property of that name of any object."""
        return bool(self.find(rf"\.\s*{re.escape(name)}\b|['\"]{re.escape(name)}['\"]"))

    def reads_param(self, name: str) -> bool:
        """Whether the program reads a global parameter of that name."""
        name = re.escape(name)
        return bool(
            self.find(rf"\bglobalParameters\s*\.\s*{name}\b")
            or self.find(rf"\b(?:globalParameters|params)\b.*['\"]{name}['\"]")
        )


def _lines_of(file: Path) -> list[str]:
    return file.read_text(encoding="utf-8", errors="replace").splitlines()


def _code_of(line: str) -> str:
    return line.partition("#")[0]
