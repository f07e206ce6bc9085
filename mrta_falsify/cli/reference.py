"""All commands, options and exit codes as one value, read from the parser itself.

``--help-json`` prints it, the documentation's page of options is made from it, and a test compares
``docs/commands.md`` with it.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import click

from mrta_falsify.cli.door import MEANINGS
from mrta_falsify.cli.group import COMMANDS, exit_codes


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """An argument or an option."""

    name: str  #: of the Python function's parameter, as a rule
    flags: tuple[str, ...]  #: ``-o``, ``--output``; of an argument: none
    value: str  #: what stands for the value in the help; empty: a flag without one
    kind: str  #: ``flag``, ``integer``, ``float``, ``choice``, ``path``, ``listing`` or ``text``
    choices: tuple[str, ...]  #: values allowed, empty: not a choice
    low: float | None  #: bounds of a number, included unless ``low_open``
    high: float | None
    low_open: bool
    default: Any  #: None: none
    required: bool
    repeatable: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A command."""

    name: str
    summary: str  #: one line
    usage: str  #: one line
    text: str  #: paragraphs with empty lines between them
    arguments: tuple[Parameter, ...]
    options: tuple[Parameter, ...]
    exit_codes: dict[str, str]  #: by number


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandLine:
    """The command line."""

    program: str
    version: str
    options: tuple[Parameter, ...]  #: that stand before a command
    exit_codes: dict[str, str]  #: by number
    commands: tuple[Command, ...]  #: by name


def describe(group: click.Group) -> CommandLine:
    """Describe the command line whose commands belong to ``group``."""
    context = click.Context(group, info_name=group.name)
    return CommandLine(
        program=str(group.name),
        version=metadata.version("mrta-falsify"),
        options=_options(group, context),
        exit_codes={str(int(code)): text for code, text in MEANINGS.items()},
        commands=tuple(_command(group, name, context) for name in group.list_commands(context)),
    )


def _command(group: click.Group, name: str, context: click.Context) -> Command:
    command = group.get_command(context, name)
    if command is None:
        raise KeyError(name)
    own = click.Context(command, info_name=name, parent=context)
    paragraphs = [inspect.cleandoc(text or "") for text in (command.help, command.epilog)]
    return Command(
        name=name,
        summary=COMMANDS[name].summary,
        usage=" ".join([own.command_path, *command.collect_usage_pieces(own)]),
        text="\n\n".join(text for text in paragraphs if text),
        arguments=tuple(
            _parameter(param, own) for param in command.params if isinstance(param, click.Argument)
        ),
        options=_options(command, own),
        exit_codes={str(code): text for code, text in exit_codes(name).items()},
    )


def _options(command: click.Command, context: click.Context) -> tuple[Parameter, ...]:
    own = [param for param in command.params if isinstance(param, click.Option)]
    return tuple(_parameter(param, context) for param in own)


def _parameter(param: click.Parameter, context: click.Context) -> Parameter:
    kind, is_flag = param.type, bool(getattr(param, "is_flag", False))
    default = None if is_flag else param.to_info_dict().get("default")
    return Parameter(
        name=str(param.name),
        flags=tuple(param.opts) if isinstance(param, click.Option) else (),
        value="" if is_flag else param.make_metavar(context),
        kind="flag" if is_flag else _kind(kind),
        choices=tuple(map(str, kind.choices)) if isinstance(kind, click.Choice) else (),
        low=getattr(kind, "min", None),
        high=getattr(kind, "max", None),
        low_open=bool(getattr(kind, "min_open", False)),
        default=_plain(default),
        required=param.required,
        repeatable=param.multiple or param.nargs == -1,
        text=getattr(param, "help", None) or "",
    )


def _plain(default: Any) -> Any:
    """Turn a default into what JSON can say; None where nothing stands for it."""
    if default is None or default == ():
        return None
    return default if isinstance(default, int | float | str) else str(default)


def _kind(kind: click.ParamType[Any]) -> str:
    """Name a type: click's names of ranges are those of their numbers."""
    return kind.name.removesuffix(" range")
