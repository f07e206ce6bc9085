"""Planted defects: parts of the stack that are exchanged for faulty ones, to test the search.

All are off by default. ``defects: [name]`` in the stack YAML switches them on. A defect is an entry
point of the group ``mrta_falsify.defect``; ours are in :mod:`mrta_falsify.testing.faults`::

    [project.entry-points."mrta_falsify.defect"]
    my_fault = "my_package.my_module:MY_FAULT"

Where the stack builds a part that a defect concerns, it builds the faulty one instead; the part
knows nothing of it.
"""

from __future__ import annotations

import functools
import importlib.metadata
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mrta_falsify.core.errors import ConfigError, UnknownNameError

GROUP = "mrta_falsify.defect"
Part = TypeVar("Part")


@dataclass(frozen=True, slots=True)
class Defect:
    """One planted defect."""

    layer: str  #: layer that is to blame
    what: str  #: what goes wrong
    #: class of the stack, and the class derived from it that takes its place
    parts: Mapping[type, type]


@functools.cache
def _entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    found = importlib.metadata.entry_points(group=GROUP)
    return {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}


def defect_names() -> tuple[str, ...]:
    """List the registered defects, sorted."""
    return tuple(_entry_points())


def check_defect(name: str) -> None:
    """Refuse a name that is not registered.

    Raises:
        UnknownNameError: it is not.
    """
    if name not in _entry_points():
        raise UnknownNameError("defect", name, defect_names(), where="defects")


@functools.cache
def defect(name: str) -> Defect:
    """Load a defect.

    Raises:
        UnknownNameError: the name is not registered.
        ConfigError: what is registered is no defect, or cannot be imported.
    """
    check_defect(name)
    try:
        loaded = _entry_points()[name].load()
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"defects: {name!r} cannot be loaded: {error}") from error
    if not isinstance(loaded, Defect):
        raise ConfigError(f"defects: {name!r} is {type(loaded).__name__}; it must be a Defect")
    return loaded


def with_defects(part: type[Part], names: Collection[str]) -> type[Part]:
    """Give the class of a part with defects planted; the class itself if none concerns it.

    Args:
        part: class that the stack is about to build.
        names: defects switched on.
    """
    if not names:
        return part
    sound: Any = part
    made: type[Part] = _faulty(sound, tuple(sorted(names)))
    return made


@functools.cache
def _faulty(part: type, names: tuple[str, ...]) -> type:
    faults = tuple(
        faulty
        for name in names
        for sound, faulty in defect(name).parts.items()
        if issubclass(part, sound)
    )
    if not faults:
        return part
    bases = (*dict.fromkeys(faults), part)
    return type(part.__name__, bases, {"__module__": part.__module__})
