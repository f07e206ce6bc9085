"""Where in a program each object was made, for messages that must name a line."""

from __future__ import annotations

import sys
from typing import Any

from scenic_worlds.shipped import is_library_file

SCENIC_ENDINGS = (".scenic", ".sc")


def note_origin(thing: Any) -> None:
    """Remember the line of the program that makes ``thing``; called while it is made."""
    frame = sys._getframe(1)
    while frame is not None:
        filename = frame.f_code.co_filename
        if filename.endswith(SCENIC_ENDINGS) and not is_library_file(filename):
            object.__setattr__(thing, "_made_at", (filename, frame.f_lineno))
            return
        frame = frame.f_back  # type: ignore[assignment] # None ends the loop


def origin_of(thing: Any) -> tuple[str, int] | None:
    """Find the file and line that made an object; None for other libraries' objects."""
    found: tuple[str, int] | None = getattr(thing, "_made_at", None)
    return found
