"""Shipped layouts and fixed worlds, read from package data.

A file holds either a whole :class:`~mrta_falsify.core.world.World`, or a *change*:
``{"layout": name, "replace": {field: value}}``, the world fields that differ from a layout.
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any

from mrta_falsify.core import codec
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.core.world import World

_LAYOUTS = ("aws_hospital", "aws_hospital_as_published")
_WORLDS = ("aws_hospital_day",)


def layout_names() -> tuple[str, ...]:
    """Names that :func:`load_layout` knows."""
    return _LAYOUTS


def load_layout(name: str) -> World:
    """A shipped layout: a world without robots, humans, tasks and events.

    Args:
        name: ``aws_hospital`` (repaired roadways) or ``aws_hospital_as_published``.

    Raises:
        UnknownNameError: no such layout.
    """
    if name not in _LAYOUTS:
        raise UnknownNameError("layout", name, _LAYOUTS)
    return _load(name)


def world_names() -> tuple[str, ...]:
    """Names that :func:`load_world` knows."""
    return _WORLDS


def load_world(name: str) -> World:
    """A shipped fixed world, ready to run.

    Args:
        name: ``aws_hospital_day``: 6 robots, 8 humans, 6 tasks of testcase_6agents_3_3, 900 s.

    Raises:
        UnknownNameError: no such world.
    """
    if name not in _WORLDS:
        raise UnknownNameError("world", name, _WORLDS)
    return _load(name)


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
