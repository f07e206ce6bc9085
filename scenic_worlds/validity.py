"""Whether a sampled world may be run, which Scenic itself cannot tell."""

from __future__ import annotations

import re

from mrta_falsify.core import codec
from mrta_falsify.core.codec import is_sound
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.world import World
from simulator_interface import starts


class WorldValidity:
    """Refuses sampled worlds that cannot be read from a file, or cannot be run.

    Parts that are the same objects as in the last world that passed, such as the floor of most
    programs, are not checked again.

    Args:
        where: the program, which begins every message.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._passed: World | None = None

    def check(self, world: World) -> None:
        """Refuse ``world``, made from an accepted scene, if it may not be run.

        Raises:
            WorldError: the first value that is not allowed, and whose it is; or a robot's
                start that is taken.
        """
        if not is_sound(world, self._passed):
            try:
                codec.decode(World, codec.encode(world), where=self._where)
            except InputError as error:
                raise WorldError(_with_name(str(error), world)) from None
        try:
            starts.check_starts(world)
        except WorldError as error:
            raise WorldError(f"{self._where}: {error}") from None
        self._passed = world


def _with_name(text: str, world: World) -> str:
    """Add the name of the object that a text calls by its place in the world."""
    match = re.search(r"\b(robots|humans|furniture|events)\[(\d+)\]", text)
    if match is None:
        return text
    name = getattr(world, match[1])[int(match[2])].name
    return f"{text[: match.end()]} ({name}){text[match.end() :]}"
