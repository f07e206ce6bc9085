"""The door to numba: compiled functions, cached by the state of all that they are made of.

numba looks at a function's own file to tell whether its cached code is fresh. It misses a change in
a function or constant that the file imports, and fails on a class of arguments that was renamed.
The caches of a module of ours therefore lie in a folder named by the texts of the module and of all
modules of ours that it imports.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core import event
from numba.core.caching import (
    Cache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

from mrta_falsify.core.interruption import is_interruption

__all__ = ["digest_of_module", "njit", "on_compiling"]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("mrta_falsify", "simulator_interface")  #: that have compiled modules
NUMBA_S_OWN = (
    "UserProvidedCacheLocator",
    "InTreeCacheLocator",
    "UserWideCacheLocator",
    "IPythonCacheLocator",
    "ZipCacheLocator",
)


@functools.lru_cache(maxsize=1024)
def digest_of_module(path: Path, root: Path = ROOT) -> str:
    """Hash the texts of a module and of all modules below ``root`` that it imports (12 digits)."""
    seen = hashlib.sha256()
    for module in sorted(_closure(path, root)):
        seen.update(str(module.relative_to(root)).encode() + b"\0" + module.read_bytes())
    return seen.hexdigest()[:12]


def _closure(path: Path, root: Path) -> set[Path]:
    found, waiting = set[Path](), [path]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += _imported(module, root)
    return found


@functools.lru_cache(maxsize=1024)
def _imported(module: Path, root: Path) -> tuple[Path, ...]:
    """List the modules of ours that a module names in its ``from ... import`` lines."""
    lines = re.findall(
        rf"^from ((?:{'|'.join(PACKAGES)})[\w.]*) import (\([^)]*\)|.*)",
        module.read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    paths = []
    for origin, names in lines:
        place = root.joinpath(*origin.split("."))
        inside = [place / f"{name}.py" for name in re.findall(r"\w+", names)]
        paths += [file for file in (place.with_suffix(".py"), *inside) if file.is_file()]
    return tuple(paths)


class _ByDigest:
    """Puts the caches of our own modules into folders named by digests."""

    _cache_path: str

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)  # type: ignore[call-arg]
        folder = f"compiled-{digest_of_module(Path(file).resolve())}"
        self._cache_path = os.path.join(self._cache_path, folder)

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """Take our own modules only; numba asks the next locator about others."""
        if Path(file).resolve().parts[: len(ROOT.parts) + 1] not in _OURS:
            return None
        return super().from_function(function, file)  # type: ignore[misc]


_OURS = tuple((*ROOT.parts, package) for package in PACKAGES)


class CacheInFolder(_ByDigest, UserProvidedCacheLocator):
    """Below ``NUMBA_CACHE_DIR``, if it is set."""


class CacheBesideSource(_ByDigest, InTreeCacheLocator):
    """In ``__pycache__`` beside the module."""


class CacheOfUser(_ByDigest, UserWideCacheLocator):
    """In the user's cache directory, where the module's own cannot be written."""


_config: Any = numba.config  # its names are made at run time
if not _config.CACHE_LOCATOR_CLASSES:  # else the user has chosen
    _ours = (CacheInFolder, CacheBesideSource, CacheOfUser)
    _names = [f"{__name__}.{locator.__name__}" for locator in _ours]
    _config.CACHE_LOCATOR_CLASSES = ",".join((*_names, *NUMBA_S_OWN))


# --- caches that cannot be used ----------------------------------------------------------------

_load, _save = Cache.load_overload, Cache.save_overload


def _load_if_sound(cache: Cache, signature: Any, context: Any) -> Any:
    """Load compiled code; a cache that a power cut has damaged is emptied."""
    try:
        return _load(cache, signature, context)  # type: ignore[no-untyped-call]
    except OSError:
        return None
    except Exception as error:
        if is_interruption(error):
            raise
        with contextlib.suppress(OSError):
            cache.flush()  # type: ignore[no-untyped-call]
        return None


def _save_if_possible(cache: Cache, signature: Any, compiled: Any) -> None:
    """Save compiled code; on a full disk it is used and not saved."""
    with contextlib.suppress(OSError):
        _save(cache, signature, compiled)  # type: ignore[no-untyped-call]


_caching: Any = Cache
_caching.load_overload, _caching.save_overload = _load_if_sound, _save_if_possible


# --- when it compiles ----------------------------------------------------------------------


class _Compilations(event.Listener):
    """Counts the compilations that run, since compiled functions compile others."""

    def __init__(self, begins: Callable[[], None], ends: Callable[[], None]) -> None:
        self._begins, self._ends, self._running = begins, ends, 0

    def on_start(self, event: object) -> None:
        """Take in that a compilation begins."""
        del event
        self._running += 1
        if self._running == 1:
            self._begins()

    def on_end(self, event: object) -> None:
        """Take in that a compilation ends."""
        del event
        self._running -= 1
        if self._running == 0:
            self._ends()


def on_compiling(begins: Callable[[], None], ends: Callable[[], None]) -> None:
    """Be told, from now on in this process, when numba compiles anything; caches do not count.

    Args:
        begins: called before.
        ends: called after.
    """
    listener = _Compilations(begins, ends)
    event.register("numba:compile", listener)  # type: ignore[no-untyped-call]
