"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from mrta_falsify.cli import output

Command = TypeVar("Command", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)


class FiniteRange(click.FloatRange):
    """A number from a range; infinity and NaN, which pass every comparison, are refused."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number, or a usage error."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def format_option(command: Command) -> Command:
    """``--format text|json``, as ``style``."""
    return click.option(
        "--format",
        "style",
        type=click.Choice(output.FORMATS),
        default="text",
        show_default=True,
        help="json prints one JSON object on stdout and nothing else there.",
    )(command)


def stack_options(command: Command) -> Command:
    """``--stack FILE`` and repeatable ``--set LAYER[.OPTION]=VALUE``, as ``settings``."""
    command = click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="LAYER[.OPTION]=VALUE",
        help="Choose an implementation or set an option; defects=[a,b] plants defects. Repeatable.",
    )(command)
    return click.option(
        "--stack", type=FILE, metavar="FILE", help="YAML with a name or options per layer."
    )(command)


def spec_option(command: Command) -> Command:
    """Repeatable ``--spec NAME``, as ``specs``."""
    return click.option(
        "--spec",
        "specs",
        multiple=True,
        metavar="NAME",
        help="Judge this specification; stl:FORMULA for your own. Repeatable; default: all.",
    )(command)


def param_option(command: Command) -> Command:
    """Repeatable ``-p NAME=VALUE`` for Scenic's global parameters, as ``params``."""
    return click.option(
        "-p",
        "--param",
        "params",
        multiple=True,
        metavar="NAME=VALUE",
        help="Override a global parameter of the Scenic program. Repeatable.",
    )(command)


def trial_arguments(command: Command) -> Command:
    """A campaign's directory and a trial in it, as ``directory`` and ``name``."""
    command = click.argument("name", metavar="ID")(command)
    return click.argument("directory", type=FILE)(command)


def workers_option(command: Command) -> Command:
    """``--workers W``, processes at a time."""
    return click.option(
        "--workers",
        type=click.IntRange(1, 512),
        help="Processes; default: one per core. Changes no result.",
    )(command)


def jittered_option(default: int, text: str) -> Callable[[Command], Command]:
    """``--jittered N``."""
    return count_option("--jittered", 0, 100, default=default, text=text)


def count_option(
    flag: str, low: int, high: int, *, default: int, text: str
) -> Callable[[Command], Command]:
    """``flag N``, a whole number from ``low`` to ``high``."""
    return click.option(
        flag,
        type=click.IntRange(low, high),
        default=default,
        show_default=True,
        metavar="N",
        help=text,
    )
