"""A user's own floor from files; see ``docs/layouts.md``."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import World, read_world, without_actors
from scenic_worlds.layouts.derivation import derive_layout
from simulator_interface.formats.floor_yaml import read_floor


def load_floor(path: Path) -> World:
    """Read the layout of a world file (``.json``), a floor file, a Nav2 map or an SDF world.

    Args:
        path: by its ending; see :func:`simulator_interface.formats.floor_yaml.read_floor`.

    Raises:
        InputError: a file cannot be read or is not what its ending says; a room cannot be
            reached.
    """
    if path.suffix.lower() == ".json":
        return without_actors(read_world(path))
    floor = read_floor(path)
    try:
        return derive_layout(floor)
    except WorldError as error:
        raise WorldError(f"{path}: {error}") from None
