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


def repository_of(
    config: StackConfig, specifications: Sequence[str], *, is_built: bool = False
) -> Repository:
    """Find the git repository that a stack's own files lie in.

    Args:
        config: the stack.
        specifications: that judge it, which may be the user's own.
        is_built: its program is not part of the repository that its folder lies in.

    Raises:
        InputError: there is none, or more than one.
    """
    own = config.stack
    folders = [Path(own.folder)] if own is not None and own.command else []
    places = [
        folder if "*" in pattern else folder / pattern
        for folder, pattern in places_of_stack(config, specifications)
    ] or folders
    found = {_repository_with(place) for place in places}
    found |= {Repository.around(folder) for folder in folders if is_built}
    tops = sorted(str(one.top) for one in found if one is not None)
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


def moved(config: StackConfig, top: Path, worktree: Path, *, is_built: bool = False) -> StackConfig:
    """Take a stack's files from a worktree.

    Args:
        config: the stack, in the repository at ``top``.
        top: of the repository.
        worktree: of the same repository.
        is_built: the stack was built in the worktree.

    Raises:
        InputError: its folder does not exist in the worktree, or a file that the build makes.
    """
    if config.stack is None or not config.stack.command:
        return config
    stack = config.stack
    folder = Path(stack.folder)
    place = _inside(folder, top, worktree)
    if not place.is_dir():
        raise InputError(f"the folder {folder} does not exist")
    words = tuple(
        _moved_word(folder / word, word, top, worktree, is_built=is_built) for word in stack.command
    )
    return dataclasses.replace(
        config, stack=dataclasses.replace(stack, folder=str(place), command=words)
    )


def _moved_word(path: Path, word: str, top: Path, worktree: Path, *, is_built: bool) -> str:
    """Take a file that is part of a commit, or built, from the worktree, others from their place.

    Raises:
        InputError: the build has not made the file.
    """
    path = Path(os.path.normpath(path))
    there = _inside(path, top, worktree)
    if there.is_file():
        return str(there)
    if not path.is_file():
        return word
    if Repository(top).holds(path):
        return str(there)
    if is_built and path.resolve().is_relative_to(top):  # a link out of it is no product
        raise InputError(f"the build has not made {path.relative_to(top)}")
    return str(path)


def _inside(path: Path, top: Path, worktree: Path) -> Path:
    """Give the place in the worktree of a path in the repository; others stay as they are."""
    return worktree / path.relative_to(top) if path.is_relative_to(top) else path
