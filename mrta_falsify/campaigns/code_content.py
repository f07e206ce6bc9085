"""A digest of foreign code by its content: the folders that it may import from."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import site
import sys
from collections.abc import Sequence
from pathlib import Path

MAX_FILES = 2000  # of the folder of what would run, that a digest covers
MAX_BYTES = 1 << 26  # of them together
#: files that a campaign writes into its folder, which are no code
WRITTEN = (".gif", ".html", ".json", ".jsonl", ".mcap", ".md", ".mp4", ".part", ".png", ".zip")
CAMPAIGN_FILES = ("campaign.json", "lock")


def content_digest(paths: Sequence[Path]) -> str | None:
    """Compute the digest of files, and of the folders that they lie in.

    What a campaign writes is left out. None if there is too much to read.
    """
    seen = hashlib.sha256(json.dumps([path.name for path in paths]).encode())
    left = [MAX_FILES, MAX_BYTES]
    for root in dict.fromkeys(map(_root_of, paths)):
        if not _add_tree(seen, root, left):
            return None
    return seen.hexdigest()


def _root_of(path: Path) -> Path:
    """Give the folder that code may import from; a file alone where others install theirs."""
    if path.is_dir():
        return path
    installed = {Path(place).resolve() for place in (*site.getsitepackages(), sys.prefix + "/bin")}
    on_path = shutil.which(path.name)
    alone = path.parent in installed or (on_path and Path(on_path).resolve() == path)
    return path if alone else path.parent


def _add_tree(seen: hashlib._Hash, root: Path, left: list[int]) -> bool:
    """Add the content of a file or a folder; False if that is too much."""
    files = [root] if root.is_file() else _files_in(root, left[0])
    if files is None:
        return False
    for path in files:
        try:
            size = path.stat().st_size
            left[0], left[1] = left[0] - 1, left[1] - size
            if min(left) < 0:
                return False
            content = path.read_bytes()
        except OSError:
            content = b""
        name = path.name if path == root else str(path.relative_to(root))
        seen.update(json.dumps([name, hashlib.sha256(content).hexdigest()]).encode())
    return True


def _files_in(root: Path, most: int) -> list[Path] | None:
    """List the files of a folder that may be code, sorted; None if there are too many."""
    found: list[Path] = []
    visited: set[str] = set()
    for top, folders, names in os.walk(root, followlinks=True):
        here = os.path.realpath(top)
        if here in visited or len(visited) > most:
            folders.clear()
            if len(visited) > most:
                return None
            continue
        visited.add(here)
        folders[:] = sorted(name for name in folders if name != ".git")
        is_campaign = _is_in_campaign(Path(here))
        for name in names:
            path = Path(top, name)
            written = name in CAMPAIGN_FILES or path.suffix in WRITTEN
            if not (is_campaign and written) and path.is_file():
                found.append(path)
        if len(found) > most:
            return None
    return sorted(found)


def _is_in_campaign(folder: Path) -> bool:
    return any((one / CAMPAIGN_FILES[0]).is_file() for one in (folder, *folder.parents[:4]))
