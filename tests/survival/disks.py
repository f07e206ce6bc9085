"""Disks that fail: one with little room, and one that loses its power at any moment."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from mrta_falsify.core import durable

Tree = dict[str, bytes | None]  #: contents by path; None: a folder


def read_tree(root: Path) -> Tree:
    """Read all files and folders below ``root``."""
    found = sorted(root.rglob("*"))
    return {
        path.relative_to(root).as_posix(): None if path.is_dir() else path.read_bytes()
        for path in found
    }


def write_tree(tree: Tree, root: Path) -> None:
    """Put files and folders in the place of what is at ``root``."""
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    for name, data in tree.items():
        if data is None:
            (root / name).mkdir(parents=True, exist_ok=True)
        else:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes(data)


def _path_of(handle: int) -> Path:
    return Path(os.readlink(f"/proc/self/fd/{handle}"))


def small_disk(patch: pytest.MonkeyPatch, root: Path, room: int) -> None:
    """Let files below ``root`` take up ``room`` bytes in all, in this process."""
    write = os.write

    def left() -> int:
        sizes = [path.stat().st_size for path in root.rglob("*") if path.is_file()]
        return room - sum(sizes)

    def some(data: Any) -> Any:
        most = left()
        if most <= 0 and len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return data[:most]

    class SmallFile(io.FileIO):
        def write(self, data: Any) -> int:
            is_here = Path(str(self.name)).absolute().is_relative_to(root)
            return super().write(some(bytes(data)) if is_here else data)

    def write_some(handle: int, data: Any) -> int:
        is_here = _path_of(handle).is_relative_to(root)
        return write(handle, some(bytes(data)) if is_here else data)

    patch.setattr(durable, "FileIO", SmallFile)
    patch.setattr(os, "write", write_some)


# --- power cuts ----------------------------------------------------------------------------


@dataclass(eq=False)
class _Node:
    """A file or folder, and what of it is durable."""

    data: bytes = b""  #: of a file
    entries: dict[str, _Node] = field(default_factory=dict)  #: of a folder
    is_folder: bool = False


@dataclass(frozen=True)
class Moment:
    """What a power cut before one step leaves behind."""

    step: str
    trees: dict[str, Tree]  #: by what the disk has done with what was not durable
    acknowledged: frozenset[int]  #: trials whose records had to be durable


class PowerCuts:
    """Notes what every step on the files below ``root`` would leave behind after a power cut.

    What was not synced is lost, or half of it is, or it is zeros, or it is there, in turn; names
    of files may be durable before their contents.
    """

    def __init__(self, patch: pytest.MonkeyPatch, root: Path) -> None:
        self.moments: list[Moment] = []
        self.acknowledged: set[int] = set()
        self._root = root
        root.mkdir(exist_ok=True)
        self._nodes: dict[int, _Node] = {root.stat().st_ino: _Node(is_folder=True)}
        self._top = self._nodes[root.stat().st_ino]
        for name in ("replace", "unlink", "rmdir", "mkdir", "open"):
            patch.setattr(os, name, self._stepped(name, getattr(os, name), Path))
        for name in ("ftruncate", "write", "pwrite"):
            patch.setattr(os, name, self._stepped(name, getattr(os, name), _path_of))
        patch.setattr(os, "fsync", self._synced(os.fsync))
        cuts = self

        class WatchedFile(io.FileIO):
            def __init__(self, path: Any, mode: str) -> None:
                cuts._note("create", Path(path))
                with cuts._meeting(Path(path)):
                    super().__init__(path, mode)

            def write(self, data: Any) -> int:
                cuts._note("write", Path(str(self.name)))
                return super().write(data)

        patch.setattr(durable, "FileIO", WatchedFile)

    def _stepped(
        self, name: str, call: Callable[..., Any], path_of: Callable[[Any], Path]
    ) -> Callable[..., Any]:
        def step(what: Any, *more: Any, **options: Any) -> Any:
            path = path_of(what)
            self._note(name, path)
            with self._meeting(path):
                return call(what, *more, **options)

        return step

    @contextlib.contextmanager
    def _meeting(self, path: Path) -> Iterator[None]:
        """Take note of a file or folder that is made inside: nothing of it is durable."""
        was_there = not path.is_relative_to(self._root) or path.exists()
        yield
        if not was_there and path.exists():
            self._nodes[path.stat().st_ino] = _Node(is_folder=path.is_dir())

    def _synced(self, call: Callable[[int], None]) -> Callable[[int], None]:
        def fsync(handle: int) -> None:
            path = _path_of(handle)
            self._note("fsync", path)
            call(handle)
            node = self._nodes.get(os.fstat(handle).st_ino)
            if node is None or not path.is_relative_to(self._root):
                return
            if node.is_folder:
                node.entries = {
                    each.name: self._nodes[each.stat().st_ino] for each in path.iterdir()
                }
            else:
                node.data = path.read_bytes()

        return fsync

    def _note(self, step: str, path: Path) -> None:
        if not path.is_relative_to(self._root):
            return
        live, lost, half, zeros = (dict[str, bytes | None]() for _ in range(4))
        for each in sorted(self._root.rglob("*")):
            name = each.relative_to(self._root).as_posix()
            if each.is_dir():
                live[name] = lost[name] = half[name] = zeros[name] = None
                continue
            data, durable_ = each.read_bytes(), self._nodes[each.stat().st_ino].data
            sound = len(durable_) if data.startswith(durable_) else 0
            live[name], lost[name] = data, durable_
            half[name] = data[: (sound + len(data) + 1) // 2]
            zeros[name] = data[:sound] + b"\0" * (len(data) - sound)
        strict = dict(_durable(self._top, ""))
        trees = {"strict": strict, "lost": lost, "half": half, "zeros": zeros, "live": live}
        where = path.relative_to(self._root).as_posix()
        self.moments.append(Moment(f"{step} {where}", trees, frozenset(self.acknowledged)))


def _durable(folder: _Node, before: str) -> Iterator[tuple[str, bytes | None]]:
    for name, node in folder.entries.items():
        if node.is_folder:
            yield before + name, None
            yield from _durable(node, f"{before}{name}/")
        else:
            yield before + name, node.data
