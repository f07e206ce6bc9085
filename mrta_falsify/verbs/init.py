"""Files to begin with: a scenario and a stack."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from mrta_falsify.core.errors import FormatError
from mrta_falsify.verbs.folders import Place

STARTER = ("my_scenario.scenic", "stack.yaml")  # files of the folder ``starter``


def init(directory: Place = ".") -> tuple[Path, ...]:
    """Write a scenario and a stack to begin with.

    Args:
        directory: made if missing; files that are there are never overwritten.

    Returns:
        The files.

    Raises:
        FormatError: a file is there already, or cannot be written.
    """
    folder = Path(directory)
    paths = tuple(folder / name for name in STARTER)
    for path in paths:
        if path.exists():
            raise FormatError(f"{path}: is there already; nothing was written")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in paths:
            path.write_bytes(_starter_file(path.name))
    except OSError as error:
        raise FormatError(f"{folder}: cannot be written: {error.strerror}") from None
    return paths


def _starter_file(name: str) -> bytes:
    return resources.files("mrta_falsify.verbs").joinpath("starter", name).read_bytes()
