"""A git repository: its commits, and temporary worktrees of them."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mrta_falsify.core.durable import make_folder
from mrta_falsify.core.errors import InputError


@dataclass(frozen=True, slots=True)
class Repository:
    """A git repository that is checked out at ``top``."""

    top: Path

    @classmethod
    def around(cls, folder: Path) -> Repository | None:
        """Find the repository that a folder lies in; None if it is in none."""
        done = _run(folder, "rev-parse", "--show-toplevel") if folder.is_dir() else None
        if done is None or done.returncode:
            return None
        return cls(Path(done.stdout.strip()).resolve())

    def commit(self, name: str) -> str:
        """Resolve the name of a commit.

        Raises:
            InputError: there is no such commit.
        """
        done = _run(self.top, "rev-parse", "--verify", "--quiet", f"{name}^{{commit}}")
        if done.returncode:
            raise InputError(f"--bisect: {name!r} is no commit of {self.top}")
        return done.stdout.strip()

    def is_ancestor(self, one: str, other: str) -> bool:
        """Whether ``other`` comes from ``one``."""
        return not _run(self.top, "merge-base", "--is-ancestor", one, other).returncode

    def holds(self, path: Path) -> bool:
        """Whether a file, or one of a folder, is part of a commit, not only beside it."""
        return bool(_run(self.top, "ls-files", "--", str(path)).stdout)

    def subject(self, commit: str) -> str:
        """Give the first line of a commit's message."""
        return self._said("log", "-1", "--format=%s", commit).strip()

    def between(self, good: Iterable[str], bad: str) -> tuple[str, ...]:
        """List the commits that may be the first bad one, those that halve the range best first.

        Args:
            good: commits that do not fail.
            bad: a commit that does; it is among the result.
        """
        text = self._said("rev-list", "--bisect-all", bad, *(f"^{one}" for one in good))
        return tuple(line.split()[0] for line in text.splitlines() if line)

    @contextlib.contextmanager
    def worktree(self, commit: str, place: Path) -> Iterator[Path]:
        """Check a commit out at ``place``, which is removed at the end, on Ctrl-C as well.

        Args:
            commit: to check out.
            place: a directory that does not exist, or that an earlier call was killed in.
        """
        self._remove(place)
        make_folder(place.parent)
        try:
            self._said("worktree", "add", "--quiet", "--detach", str(place), commit)
            yield place
        finally:
            self._remove(place)

    def _remove(self, place: Path) -> None:
        shutil.rmtree(place, ignore_errors=True)
        _run(self.top, "worktree", "prune")

    def _said(self, *words: str) -> str:
        done = _run(self.top, *words)
        if done.returncode:
            lines = done.stderr.strip().splitlines() or ["no reason given"]
            raise InputError(f"git {words[0]} in {self.top} failed: {lines[-1]}")
        return done.stdout


def _run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run git, out of reach of Ctrl-C: what it has begun is to be whole.

    Raises:
        InputError: git is not installed.
    """
    try:
        return subprocess.run(
            ["git", "-C", str(folder), *words],
            capture_output=True,
            text=True,
            check=False,
            start_new_session=True,
        )
    except FileNotFoundError:
        raise InputError("--bisect needs git, which is not installed") from None
