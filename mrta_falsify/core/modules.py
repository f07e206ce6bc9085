"""Modules of users: where they lie, and that only those asked for come from the current directory.

A component may be a file in the directory where a command is run. That directory is looked in last,
and only for modules that were named (as ``module:Class``) and for what they import themselves.
A file that happens to have the name of a library's module is never taken for it.
"""

from __future__ import annotations

import contextlib
import importlib.machinery
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import FrameType, ModuleType

#: top-level packages of the toolkit itself
OURS = ("mrta_falsify", "reports", "samplers", "scenic_worlds", "simulator_interface")
SAFE_PATH = "PYTHONSAFEPATH"
MARK = "mrta-falsify"  # its value where the user has given none
_IMPORTING = ("importlib", "<frozen importlib")  # where frames of the import system come from


def is_ours(module: str) -> bool:
    """Whether a module, by its dotted name, belongs to the toolkit."""
    return module.partition(".")[0] in OURS


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Let processes that Python itself starts meanwhile begin without the current directory."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = MARK if before is None else before
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(SAFE_PATH, None)


def forget_safe_path() -> None:
    """Keep :func:`safe_path` from what such a process starts: a user's program is as it was."""
    if os.environ.get(SAFE_PATH) == MARK:
        del os.environ[SAFE_PATH]


def look_here_for(module: str) -> None:
    """Let a module that a user named be found in the current directory, after all other places."""
    here = os.getcwd()
    if here in sys.path or "" in sys.path:
        return
    for finder in sys.meta_path:
        if isinstance(finder, _AskedFor) and finder.here == here:
            break
    else:
        finder = _AskedFor(here)
        sys.meta_path.append(finder)
    finder.names.add(module.partition(".")[0])


def place_of(module: str) -> Path | None:
    """Find the file, or the folder of the package, that a top-level name stands for.

    Nothing is imported. The current directory is looked in last.

    Args:
        module: dotted name, of which the first part counts.
    """
    name = module.partition(".")[0]
    loaded = sys.modules.get(name)
    spec = getattr(loaded, "__spec__", None)
    if spec is None:
        try:
            spec = importlib.util.find_spec(name) if loaded is None else None
        except (ImportError, ValueError):
            spec = None
        spec = spec or importlib.machinery.PathFinder.find_spec(name, [os.getcwd()])
    if spec is None:
        return None
    folders = list(spec.submodule_search_locations or ())
    if folders:
        return Path(folders[0]).resolve()
    return Path(spec.origin).resolve() if spec.origin and spec.has_location else None


class _AskedFor(MetaPathFinder):
    """Finds top-level modules in one directory: those asked for, and those that they import."""

    def __init__(self, here: str) -> None:
        self.here = here
        self.names: set[str] = set()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a module; None unless it was asked for."""
        del target
        if path is not None or "." in fullname:
            return None
        if fullname not in self.names and not self._is_imported_from_here():
            return None
        found = importlib.machinery.PathFinder.find_spec(fullname, [self.here])
        if found is not None:
            self.names.add(fullname)
        return found

    def _is_imported_from_here(self) -> bool:
        """Whether the code that imports is itself a module of this directory."""
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and (
            frame.f_code.co_filename == __file__
            or frame.f_code.co_filename.startswith(_IMPORTING)
            or frame.f_globals.get("__name__", "").partition(".")[0] == "importlib"
        ):
            frame = frame.f_back
        name = frame.f_globals.get("__name__", "") if frame is not None else ""
        return name.partition(".")[0] in self.names and name != ""
