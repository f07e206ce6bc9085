"""The door to numba: compiled functions, cached by the state of all sources.

numba looks at a function's own file to tell whether its cached code is fresh. It misses a change in
a function that is called from another file, and fails on a class of arguments that was renamed.
Caches of this toolkit therefore lie in a folder whose name is the digest of every compiled module.
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core.caching import (
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

__all__ = ["njit", "sources_digest"]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("mrta_falsify", "simulator_interface")  #: that have compiled modules
MARK = b"import njit"  # a module with this line is compiled
NUMBA_S_OWN = (
    "UserProvidedCacheLocator",
    "InTreeCacheLocator",
    "UserWideCacheLocator",
    "IPythonCacheLocator",
    "ZipCacheLocator",
)


@functools.cache
def sources_digest(root: Path = ROOT) -> str:
    """Hash the names and texts of all compiled modules below ``root`` (12 hex digits)."""
    seen = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_bytes()
            if MARK in text:
                seen.update(str(path.relative_to(root)).encode() + b"\0" + text)
    return seen.hexdigest()[:12]


class _ByDigest:
    """Puts the caches of our own modules into a folder named by the digest."""

    _cache_path: str

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)  # type: ignore[call-arg]
        self._cache_path = os.path.join(self._cache_path, f"compiled-{sources_digest()}")

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
