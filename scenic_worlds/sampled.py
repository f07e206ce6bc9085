"""Whether a sampled world is one that may be run: what Scenic itself does not know."""

from __future__ import annotations

import re

from mrta_falsify.core import codec
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import World
from simulator_interface import starts


def check_sampled(world: World, where: str) -> None:
    """Refuse a sampled world that could not be read from a file, or not be run.

    Args:
        world: of a scene that was accepted.
        where: the program, which begins every message.

    Raises:
        WorldError: the first value that is not allowed, and whose it is; or a robot's start
            that is taken.
    """
    try:
        codec.decode(World, codec.encode(world), where=where)
    except InputError as error:
        raise WorldError(_with_name(str(error), world)) from None
    try:
        starts.check_starts(world)
    except WorldError as error:
        raise WorldError(f"{where}: {error}") from None


def _with_name(text: str, world: World) -> str:
    """``text`` with the name of the object that it calls by its place in the world."""
    match = re.search(r"\b(robots|humans|furniture|events)\[(\d+)\]", text)
    if match is None:
        return text
    name = getattr(world, match[1])[int(match[2])].name
    return f"{text[: match.end()]} ({name}){text[match.end() :]}"
