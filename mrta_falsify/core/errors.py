"""The exceptions of the project.

::

    MrtaFalsifyError
    +-- InputError             the user's input is wrong: exit code 2
    |   +-- ConfigError        a stack or campaign option
    |   +-- WorldError           a world that cannot be run
    |   +-- FormatError          a file that is not what its name says
    |   |   +-- DoubledKeyError    a key stands twice in an object
    |   +-- UnknownNameError     a plug-in, layer, room or specification that is not registered
    |   +-- NeedsOption          what is done only where an option asks for it
    +-- PlaceError             a file cannot be written: full, removed, not allowed: exit code 2
    +-- HarnessError           the toolkit itself failed: exit code 3
"""

from __future__ import annotations

from collections.abc import Iterable

from mrta_falsify.core.spelling import did_you_mean

MAX_NAME = 80  # characters of an unknown name in a message


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
        name = name if len(name) <= MAX_NAME else name[:MAX_NAME] + "..."
        hint = did_you_mean(name, known) or "."
        prefix = f"{where}: " if where else ""
        listing = ", ".join(known) if known else "none"
        super().__init__(f"{prefix}unknown {kind} {name!r}{hint} Known: {listing}")


class NeedsOption(InputError):  # noqa: N818 - says what is missing
    """A command does something only where an option asks for it.

    Args:
        message: what it would do, without the option.
        option: of the command line, as ``--trust``; a verb in Python has a parameter of that name.
    """

    def __init__(self, message: str, option: str) -> None:
        super().__init__(f"{message}; it needs {option}")
        self.option = option


class PlaceError(MrtaFalsifyError):
    """A file cannot be written where it should be: the disk is full, its folder was removed.

    It is no :class:`InputError`: those are answers that a record or a report may hold, such as "no
    scene". What ran when a file could not be written has no result.

    Args:
        text: the file, why it cannot be written, and what to do about that.
        then: how to go on when that is done; empty: it goes without saying.
    """

    def __init__(self, text: str, *, then: str = "") -> None:
        super().__init__(text)
        self.then = then

    def __str__(self) -> str:
        """Write it in one sentence."""
        return f"{self.args[0]}, then {self.then}" if self.then else str(self.args[0])


class InputNote(UserWarning):
    """Something the user gave is read otherwise than it may be meant; the message says how.

    It is a warning, so that readers need not hand it on. The command line prints it as a note.
    """


class HarnessError(MrtaFalsifyError):
    """The toolkit itself failed; this is never a verdict about the stack under test."""
