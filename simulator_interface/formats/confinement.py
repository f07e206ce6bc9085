"""Files that a user's file names: only those in its own folder are opened."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.core.errors import FormatError


def file_beside(path: Path, field: str, name: str) -> Path:
    """Find a file that another one names, inside the folder of the first.

    Args:
        path: the file that names it.
        field: in which the name stands.
        name: relative to the folder of ``path``.

    Raises:
        FormatError: it lies elsewhere, or the name is none.
    """
    folder = path.parent.resolve()
    found = (folder / name).resolve() if name and "\0" not in name else folder
    if found == folder or not found.is_relative_to(folder):
        raise FormatError(
            f"{path}: {field} is {name!r}; it must lie in the folder of this file "
            "(copy it there, and give its name)"
        )
    return found
