"""A digest of the code that an answer comes from: this toolkit's, and that of named components."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mrta_falsify.campaigns.code_content import content_digest
from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import Choice, StackConfig
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.external import ExternalStack
from mrta_falsify.core.record import versions

PACKAGES = ("mrta_falsify", "simulator_interface", "scenic_worlds", "samplers")  #: that runs use
OURS = tuple(Path(__file__).resolve().parents[2] / package for package in PACKAGES)
SUFFIXES = (".py", ".scenic", ".json", ".yaml")


def code_digest(config: StackConfig, specifications: Iterable[str] = ()) -> str:
    """Hash the code of a stack, of specifications and of the toolkit, with all versions.

    A component of the user's own counts with all Python files of its package, or of the folder
    that its module lies in. A stack or layer in a process of its own counts with the files that its
    command names, and the sources beside them.

    Args:
        config: the stack.
        specifications: names, as of ``--spec``.
    """
    theirs = [_digest_of(*place) for place in sorted({*places_of_stack(config, specifications)})]
    return codec.digest([versions(), [_digest_of_ours(place) for place in OURS], theirs])


def known_code_digest(
    stacks: Iterable[StackConfig], specifications: Iterable[str] = ()
) -> str | None:
    """Hash the code of stacks, of specifications and of the toolkit.

    Args:
        stacks: that run, one after the other.
        specifications: names, as of ``--spec``.

    Returns:
        None where a foreign stack may change without our seeing it: it runs
        already, its command names no file, or there is too much beside these to read.
    """
    found: list[str] = []
    names = tuple(specifications)
    for config in stacks:
        found.append(code_digest(config, names))
        for program in _programs_of(config, names):
            places = [folder / name for folder, name in _places_of_program(program)]
            files = [path for path in places if path.is_file()]
            content = content_digest(files) if files else None
            if content is None:
                return None
            found.append(content)
    return codec.digest(found)


def _programs_of(config: StackConfig, specifications: Iterable[str]) -> Iterator[ExternalStack]:
    """Yield the stack, and the layers, that are processes of their own."""
    if config.stack is not None:
        yield config.stack
    for component in _components_of(config, specifications):
        command = getattr(component, "COMMAND", None)
        if command is not None:
            yield command


def places_of_stack(
    config: StackConfig, specifications: Iterable[str] = ()
) -> Iterator[tuple[Path, str]]:
    """Yield the folders of what is not ours, each with the pattern of its files.

    Args:
        config: the stack.
        specifications: names, as of ``--spec``.
    """
    yield from _places_of_program(config.stack)
    for component in _components_of(config, specifications):
        yield from _places_of_program(getattr(component, "COMMAND", None))
        module = sys.modules.get(component.__module__)
        file = getattr(module, "__file__", None)
        if file is None or any(Path(file).resolve().is_relative_to(place) for place in OURS):
            continue
        levels = component.__module__.count(".")
        folder = Path(file).resolve().parent
        if levels:
            yield (folder.parents[levels - 2] if levels > 1 else folder), "**/*"
        else:  # a module of its own may lie in a folder that holds anything
            yield folder, "*"


def _components_of(config: StackConfig, specifications: Iterable[str]) -> Iterator[Any]:
    """Yield the components that a stack and specifications name, but for formulas."""
    named = [("specification", name) for name in specifications]
    for field in dataclasses.fields(config):
        choice = getattr(config, field.name)
        if isinstance(choice, Choice):
            named.append((field.name, choice.name))
    for point, name in named:
        with contextlib.suppress(InputError):  # a formula, or what is not installed
            yield registry.load(point, name)


def _places_of_program(stack: ExternalStack | None) -> Iterator[tuple[Path, str]]:
    folder = Path(stack.folder) if stack is not None else Path()
    for word in stack.command if stack is not None else ():
        path = (folder / word).resolve()
        if path.is_file():
            yield path.parent, path.name
            if path.is_relative_to(folder.resolve()):
                yield path.parent, "*"


@functools.cache
def _digest_of_ours(folder: Path) -> str:
    return _digest_of(folder, "**/*")


def _digest_of(folder: Path, pattern: str) -> str:
    seen = hashlib.sha256()
    for path in sorted(folder.glob(pattern)):
        if (path.suffix in SUFFIXES or path.name == pattern) and path.is_file():
            seen.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return seen.hexdigest()
