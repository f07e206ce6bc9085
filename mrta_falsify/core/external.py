"""A stack in a process of its own: the command that starts it, and what it may do."""

from __future__ import annotations

import os
import shlex
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError

EXEC = "exec:"  # begins a command where a name could stand

#: how a copy of the run gets a copy of the stack; auto: fork if the stack can, else replay
Branching = Literal["auto", "fork", "replay", "never"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalStack:
    """A stack that runs as a process of its own and is asked over a socket."""

    command: tuple[str, ...]
    folder: str = ""  #: where it is run, empty: where the harness is
    env: dict[str, str] = field(default_factory=dict)  #: set in its environment
    params: dict[str, Any] = field(default_factory=dict)  #: handed on in `world`
    #: by name, other parameters that ``explain`` tries
    variants: dict[str, dict[str, Any]] = field(default_factory=dict)
    branch: Branching = "auto"
    tick_limit: float = quantity(above=0.0, unit="s", default=10.0)  #: wall clock, for one answer
    start_limit: float = quantity(above=0.0, unit="s", default=60.0)  #: until it is ready
    #: simulated time that each answer is held back, on top of what the stack says that it took
    delay: float = quantity(low=0.0, unit="s", default=0.0, came_later=True)

    def __post_init__(self) -> None:
        if not self.command:
            raise ConfigError("stack.command is empty; it must name a program")

    def label(self) -> str:
        """Write the command in one line."""
        return shlex.join(self.command)


def parse_exec(text: str, *, where: str, folder: Path | None = None) -> ExternalStack:
    """Read ``exec:CMD``.

    Args:
        text: the command behind ``exec:``, as a shell would split it.
        where: it stands, for messages.
        folder: relative paths are relative to it; None: the current one.

    Raises:
        ConfigError: the text is no such command, or there is no such program.
    """
    if not text.startswith(EXEC):
        raise ConfigError(f"{where}: {text!r} must read exec:CMD")
    try:
        command = tuple(shlex.split(text.removeprefix(EXEC)))
    except ValueError as error:
        raise ConfigError(f"{where}: {text!r} cannot be split: {error}") from None
    if not command:
        raise ConfigError(f"{where}: no command follows exec:")
    return located(ExternalStack(command=command), where=where, folder=folder or Path.cwd())


def located(stack: ExternalStack, *, where: str, folder: Path) -> ExternalStack:
    """Bind a command to the folder that its relative paths are relative to.

    Raises:
        ConfigError: the folder or the program does not exist.
    """
    place = folder / stack.folder
    if not place.is_dir():
        raise ConfigError(f"{where}: the folder {place} does not exist")
    program = stack.command[0]
    known = (place / program).exists() if os.sep in program else shutil.which(program)
    if not known:
        raise ConfigError(f"{where}: there is no program {program!r} in {place} or on the path")
    return replace(stack, folder=str(place.resolve()))
