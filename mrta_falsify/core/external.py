"""A foreign stack: how it is started or reached, and what it may do."""

from __future__ import annotations

import os
import shlex
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from mrta_falsify.core.codec import later, quantity, shown
from mrta_falsify.core.errors import ConfigError

EXEC = "exec:"  # begins a command where a name could stand
CONNECT = "connect:"  # begins the address of a stack that runs already
ADAPTER = "stack_adapter"  # extension point of texts with other beginnings
LOOPBACK = ("127.0.0.1", "localhost")  # the only hosts

#: how a copy of the run gets a copy of the stack; auto: fork if the stack can, else replay
Branching = Literal["auto", "fork", "replay", "never"]
#: how tightly a stack keeps to simulated time. stepped: it has done all of a tick's work when it
#: answers. awaited: it waits for its parts, up to a limit. paced: it runs by the wall clock
Coupling = Literal["stepped", "awaited", "paced"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalStack:
    """A stack that runs as a process of its own and is asked over a socket."""

    command: tuple[str, ...] = ()  #: that starts it; empty: it runs already
    connect: str = later("")  #: where it listens: path of a Unix socket, or 127.0.0.1:PORT
    folder: str = ""  #: where it is run, empty: where the harness is
    env: dict[str, str] = field(default_factory=dict)  #: set in its environment
    params: dict[str, Any] = quantity(default=dict)  #: handed on in `world`
    #: by name, other parameters that ``explain`` tries
    variants: dict[str, dict[str, Any]] = quantity(default=dict)
    branch: Branching = "auto"
    tick_limit: float = quantity(above=0.0, unit="s", default=10.0)  #: for one answer
    start_limit: float = quantity(above=0.0, unit="s", default=60.0)  #: until it is ready
    #: simulated time that each answer is held back, on top of what the stack says that it took
    delay: float = quantity(low=0.0, unit="s", default=0.0, came_later=True)
    tasks_ahead: bool = later(False)  #: it is told all tasks at the start, as some read from a file

    def __post_init__(self) -> None:
        if self.connect and self.command:
            raise ConfigError("stack has a command and connect; it must have one of them")
        if not self.command and not self.connect:
            raise ConfigError("stack.command is empty; it must name a program")
        if self.connect:
            self.address()
        words = (*self.command, self.folder, *self.env, *self.env.values())
        if any("\0" in word for word in words) or any("=" in name for name in self.env):
            raise ConfigError("stack: command, folder and env must have no NUL, env no = in a name")
        for name, variant in self.variants.items():
            self._check_variant(name, variant)

    def _check_variant(self, name: str, variant: dict[str, Any]) -> None:
        """Refuse a variant in which a parameter is of another kind than in ``params``."""
        for parameter in variant.keys() & self.params.keys():
            usual, other = self.params[parameter], variant[parameter]
            if _kind(usual) != _kind(other):
                raise ConfigError(
                    f"stack.variants.{name}.{parameter} is {shown(other)}; it must be "
                    f"{_kind(usual)}, as params.{parameter} is"
                )

    def label(self) -> str:
        """Write the command, or the address, in one line."""
        return shlex.join(self.command) if self.command else f"{CONNECT}{self.connect}"

    def address(self) -> str | tuple[str, int]:
        """Give where it listens: the path of a Unix socket, or a loopback host and port.

        Raises:
            ConfigError: the host is another machine, or the port is none.
        """
        host, colon, port = self.connect.rpartition(":")
        if not colon or "/" in self.connect:
            return os.path.join(self.folder, self.connect)
        if host not in LOOPBACK:
            raise ConfigError(f"stack.connect: the host {host!r} must be {' or '.join(LOOPBACK)}")
        if not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise ConfigError(f"stack.connect: the port {port!r} must be from 1 to 65535")
        return host, int(port)


def _kind(value: Any) -> str:
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, (int, float)):
        return "a number"
    kinds: dict[type, str] = {str: "text", list: "a list", tuple: "a list", dict: "an object"}
    return kinds.get(type(value), "null")


def is_adapter(name: str) -> bool:
    """Whether a name is that of a registered adapter."""
    from mrta_falsify.core import registry  # noqa: PLC0415 - it imports this module

    return name in registry.names(ADAPTER)


def parse_stack(text: str, *, where: str, folder: Path | None = None) -> ExternalStack:
    """Read ``exec:CMD``, ``connect:ADDRESS`` or ``ADAPTER:TEXT``; else as :func:`parse_exec`."""
    name, colon, rest = text.partition(":")
    if colon and is_adapter(name):
        from mrta_falsify.core import registry  # noqa: PLC0415 - it imports this module
        from mrta_falsify.core.config import Choice  # noqa: PLC0415

        adapter = registry.build(ADAPTER, Choice(name), where=where)
        adapted: ExternalStack = adapter.stack(rest, where=where, folder=folder or Path.cwd())
        return adapted
    if not text.startswith(CONNECT):
        return parse_exec(text, where=where, folder=folder)
    found = ExternalStack(connect=text.removeprefix(CONNECT))
    return bound_to(found, where=where, folder=folder or Path.cwd())


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
    command = split_command(text.removeprefix(EXEC), where=where)
    return bound_to(ExternalStack(command=command), where=where, folder=folder or Path.cwd())


def split_command(text: str, *, where: str) -> tuple[str, ...]:
    """Split a command into words, as a shell would; no shell runs it.

    Args:
        text: the command.
        where: it stands, for messages.

    Raises:
        ConfigError: a quotation is not closed, or there is no word.
    """
    try:
        command = tuple(shlex.split(text))
    except ValueError as error:
        raise ConfigError(f"{where}: {text!r} cannot be split: {error}") from None
    if not command:
        raise ConfigError(f"{where}: there is no command; it must name a program")
    return command


def bound_to(stack: ExternalStack, *, where: str, folder: Path) -> ExternalStack:
    """Bind a command to the folder that its relative paths are relative to.

    Raises:
        ConfigError: the folder or the program does not exist.
    """
    place = folder / stack.folder
    if not place.is_dir():
        raise ConfigError(f"{where}: the folder {place} does not exist")
    if not stack.command:
        return replace(stack, folder=str(place.resolve()))
    program = stack.command[0]
    known = (place / program).exists() if os.sep in program else shutil.which(program)
    if not known:
        raise ConfigError(
            f"{where}: there is no program {program!r} in {place.resolve()} or on the path; it is "
            "the first word of the command"
        )
    return replace(stack, folder=str(place.resolve()))
