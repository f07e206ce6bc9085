"""Files to begin with: a scenario and a stack."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal

from mrta_falsify.commands.folders import Place
from mrta_falsify.core.durable import make_folder, write_atomically
from mrta_falsify.core.errors import FormatError

Language = Literal["python", "cpp"]

#: files by the language of the stack: where they come from, by name
STARTERS: dict[Language | None, dict[str, tuple[str, str]]] = {
    None: {
        "my_scenario.scenic": ("mrta_falsify.commands", "starter/my_scenario.scenic"),
        "stack.yaml": ("mrta_falsify.commands", "starter/stack.yaml"),
    },
    "python": {
        "my_scenario.scenic": ("mrta_falsify.commands", "starter/first_ward.scenic"),
        "stack.yaml": ("mrta_falsify.commands", "starter/python/stack.yaml"),
        "my_stack.py": ("mrta_falsify.commands", "starter/python/my_stack.py"),
        "mrta_stack.py": ("simulator_interface.clients", "mrta_stack.py"),
    },
    "cpp": {
        "my_scenario.scenic": ("mrta_falsify.commands", "starter/first_ward.scenic"),
        "stack.yaml": ("mrta_falsify.commands", "starter/cpp/stack.yaml"),
        "my_stack.cpp": ("mrta_falsify.commands", "starter/cpp/my_stack.cpp"),
        "mrta_stack.hpp": ("simulator_interface.clients", "mrta_stack.hpp"),
    },
}


def init(directory: Place = ".", stack: Language | None = None) -> tuple[Path, ...]:
    """Write a scenario and a stack to begin with.

    Args:
        directory: made if missing; files that are there are never overwritten.
        stack: language of a foreign stack; None: the shipped one, by layers.

    Returns:
        The files.

    Raises:
        FormatError: a file is there already.
        PlaceError: a file cannot be written.
    """
    folder = Path(directory)
    paths = tuple(folder / name for name in STARTERS[stack])
    for path in paths:
        if path.exists():
            raise FormatError(
                f"{path}: is there already; nothing was written (another place: "
                "mrta-falsify init DIRECTORY)"
            )
    make_folder(folder)
    for path in paths:
        package, file = STARTERS[stack][path.name]
        write_atomically(path, resources.files(package).joinpath(file).read_bytes())
    return paths
