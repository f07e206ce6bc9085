"""The exceptions of the project.

::

    MrtaFalsifyError
    +-- InputError             the user's input is wrong: exit code 2
    |   +-- ConfigError        a stack or campaign option
    |   +-- WorldError           a world that cannot be run
    |   +-- FormatError          a file that is not what its name says
    |   |   +-- DoubledKeyError    a key stands twice in an object
    |   +-- UnknownNameError     a plug-in, layer, room or specification that is not registered
    +-- HarnessError           the toolkit itself failed: exit code 3
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class MrtaFalsifyError(Exception):
    """Root of every exception that this project raises on purpose."""


class InputError(MrtaFalsifyError):
    """Something the user gave is wrong; the message says what, where and what is allowed."""


class ConfigError(InputError):
    """An option has a value that is not allowed."""


class WorldError(InputError):
    """A world describes something that cannot be simulated."""


class FormatError(InputError):
    """A file does not follow its format."""


class DoubledKeyError(FormatError):
    """A key stands twice in an object."""


class UnknownNameError(InputError):
    """A name is not registered.

    Args:
        kind: what was looked up, for example ``planner``.
        name: the name given.
        known: the names that exist.
        where: file and field the name came from, empty if it came from code.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], *, where: str = "") -> None:
        known = sorted(known)
        nearest = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {nearest[0]!r}?" if nearest else "."
        prefix = f"{where}: " if where else ""
        listing = ", ".join(known) if known else "none"
        super().__init__(f"{prefix}unknown {kind} {name!r}{hint} Known: {listing}")


class InputNote(UserWarning):
    """Something the user gave is read otherwise than it may be meant; the message says how.

    It is a warning, so that readers need not hand it on. The command line prints it as a note.
    """


class HarnessError(MrtaFalsifyError):
    """The toolkit itself failed; this is never a verdict about the stack under test."""
