"""Layouts by name or file: shipped floors, generated ones, and a user's own.

A shipped file holds either a whole :class:`~mrta_falsify.core.world.World`, or a *change*:
``{"layout": name, "replace": {field: value}}``, the world fields that differ from a layout.
Generators (:func:`hospital`, :func:`warehouse`) are pure functions from lengths to a layout.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import World
from scenic_worlds.layouts.hospital import hospital
from scenic_worlds.layouts.warehouse import warehouse

_SHIPPED = ("aws_hospital", "aws_hospital_as_published")
#: generators, callable without arguments
GENERATORS: dict[str, Callable[[], World]] = {
    "hospital": hospital,
    "warehouse": warehouse,
}
_WORLDS = ("aws_hospital_day",)
#: endings of files that :func:`load_layout` reads
FILE_ENDINGS = (".json", ".yaml", ".yml", ".sdf", ".world")


def layout_names() -> tuple[str, ...]:
    """List the names that :func:`load_layout` knows."""
    return (*_SHIPPED, *GENERATORS)


def load_layout(name_or_path: str | Path) -> World:
    """Load a layout: a world without robots, humans, tasks and events.

    Args:
        name_or_path: ``aws_hospital`` (repaired roadways), ``aws_hospital_as_published``,
            the name of a generator (with its default lengths), or a user's floor: a world
            file (``.json``), a floor file or a Nav2 map with rooms beside it (``.yaml``),
            or an SDF world with rooms beside it (``.sdf``, ``.world``); see
            ``docs/layouts.md``.

    Raises:
        UnknownNameError: neither a name nor a file of these kinds.
        InputError: the file is broken, or one of its rooms cannot be reached.
    """
    name = str(name_or_path)
    if name in _SHIPPED:
        return _load(name)
    if name in GENERATORS:
        return _generate(name)
    path = Path(name_or_path)
    if path.suffix.lower() in FILE_ENDINGS:
        from scenic_worlds.layouts.files import load_floor  # noqa: PLC0415 - costs an import

        return load_floor(path)
    raise UnknownNameError("layout", name, layout_names())


def world_names() -> tuple[str, ...]:
    """List the names that :func:`load_world` knows."""
    return _WORLDS


def load_world(name: str) -> World:
    """Load a shipped fixed world, ready to run.

    Args:
        name: ``aws_hospital_day``: 6 robots, 8 humans, 6 tasks of testcase_6agents_3_3, 900 s.

    Raises:
        UnknownNameError: no such world.
    """
    if name not in _WORLDS:
        raise UnknownNameError("world", name, _WORLDS)
    return _load(name)


@functools.cache
def _generate(name: str) -> World:
    return GENERATORS[name]()


@functools.cache
def _load(name: str) -> World:
    return codec.decode(World, _world_data(name), where=f"{name}.json")


@functools.cache
def _world_data(name: str) -> dict[str, Any]:
    file = resources.files(__name__) / f"{name}.json"
    data: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    if "layout" in data:
        return {**_world_data(data["layout"]), **data["replace"]}
    return data
