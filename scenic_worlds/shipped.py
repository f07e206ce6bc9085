"""What the package ships, by name, without loading Scenic: programs, and names of the library."""

from __future__ import annotations

import functools
import re
from pathlib import Path

from mrta_falsify.core.errors import FormatError, UnknownNameError

LIBRARY = Path(__file__).parent
SCENARIO_DIR = LIBRARY / "scenarios"
MODEL = "scenic_worlds.model"

#: what a file of the library defines for programs: classes, behaviours, functions, values
_DEFINITION = re.compile(
    r"^(?:(?:class|behavior|def) ([A-Za-z]\w*)|([A-Za-z]\w*) = )", re.MULTILINE
)


def scenario_names() -> tuple[str, ...]:
    """List the names of the shipped programs."""
    return tuple(sorted(path.stem for path in SCENARIO_DIR.glob("*.scenic")))


def scenario_path(name_or_path: str) -> Path:
    """Find the file of a shipped program's name, or of a path that the user gave.

    Raises:
        FormatError: a path without a file.
        UnknownNameError: neither a shipped program nor a path.
    """
    path = Path(name_or_path)
    if path.suffix == ".scenic" and path.is_file():
        return path
    if name_or_path in scenario_names():
        return SCENARIO_DIR / f"{name_or_path}.scenic"
    if path.suffix == ".scenic":
        reason = "it is a directory" if path.is_dir() else "no such file"
        raise FormatError(f"{path}: cannot be read: {reason}")
    here = (path.name for path in Path().glob("*.scenic"))
    raise UnknownNameError("scenario", name_or_path, (*scenario_names(), *here))


@functools.cache
def library_names() -> frozenset[str]:
    """List the names that ``model scenic_worlds.model`` gives a program."""
    return frozenset(
        found[1] or found[2]
        for file in LIBRARY.glob("*.scenic")
        for found in _DEFINITION.finditer(file.read_text(encoding="utf-8"))
    )


def is_library_file(filename: str) -> bool:
    """Whether a Scenic file belongs to the library; shipped programs do not."""
    return Path(filename).resolve().parent == LIBRARY
