"""A stack as it was at a commit: the same configuration, with its files in a worktree."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path

from mrta_falsify.campaigns.code_digest import places_of_stack
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.verbs.bisect.repository import Repository


def repository_of(config: StackConfig, specifications: Sequence[str]) -> Repository:
    """Find the git repository that a stack's own files lie in.

    Args:
        config: the stack.
        specifications: that judge it, which may be the user's own.

    Raises:
        InputError: there is none, or more than one.
    """
    places = [
        folder if "*" in pattern else folder / pattern
        for folder, pattern in places_of_stack(config, specifications)
    ]
    if not places and config.stack is not None and config.stack.command:
        places = [Path(config.stack.folder)]
    found = {repository for place in places if (repository := _repository_with(place)) is not None}
    tops = sorted(str(repository.top) for repository in found)
    if len(tops) == 1:
        return Repository(Path(tops[0]))
    if tops:
        raise InputError(f"--bisect: the stack lies in more than one repository: {tops}")
    where = ", ".join(sorted(map(str, set(places)))) or "only shipped layers"
    raise InputError(
        f"--bisect: no git repository holds the stack ({where}); it must be a command or a module "
        "whose files are in one"
    )


def _repository_with(place: Path) -> Repository | None:
    """Find the repository that a file or folder is part of, not only beside."""
    found = Repository.around(place if place.is_dir() else place.parent)
    return found if found is not None and found.holds(place) else None


def moved(config: StackConfig, top: Path, worktree: Path) -> StackConfig:
    """Take a stack's files from a worktree.

    Args:
        config: the stack, in the repository at ``top``.
        top: of the repository.
        worktree: of the same repository.

    Raises:
        InputError: its folder does not exist in the worktree.
    """
    if config.stack is None or not config.stack.command:
        return config
    stack = config.stack
    folder = Path(stack.folder)
    place = _inside(folder, top, worktree)
    if not place.is_dir():
        raise InputError(f"the folder {folder} does not exist")
    words = tuple(_moved_word(folder / word, word, top, worktree) for word in stack.command)
    return dataclasses.replace(
        config, stack=dataclasses.replace(stack, folder=str(place), command=words)
    )


def _moved_word(path: Path, word: str, top: Path, worktree: Path) -> str:
    """Take a file that is part of a commit from the worktree, any other from where it is."""
    if not path.is_file():
        return word
    path = Path(os.path.normpath(path))
    there = _inside(path, top, worktree)
    return str(there if there.is_file() or Repository(top).holds(path) else path)


def _inside(path: Path, top: Path, worktree: Path) -> Path:
    """Give the place in the worktree of a path in the repository; others stay as they are."""
    return worktree / path.relative_to(top) if path.is_relative_to(top) else path
