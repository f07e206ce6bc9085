"""Options that several commands share; those of a campaign derive from its settings."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import click

from mrta_falsify.campaigns.settings import CampaignSettings, Limits, TrialSettings
from mrta_falsify.cli import output
from mrta_falsify.cli.names import component
from mrta_falsify.core.codec import Rule
from mrta_falsify.core.config import Choice

Command = TypeVar("Command", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)
FORMATS = ("text", "json")
MAX_WORKERS = 512
STACK = "FILE|default|exec:CMD|connect:ADDRESS|ADAPTER:TEXT"  # how a stack is named

#: say how much of a campaign is run, and on what; all other options belong to the campaign
RUN_OPTIONS = frozenset(
    {"workers", "executor", "time_limit", "trust"} | {f.name for f in dataclasses.fields(Limits)}
)


class WholeRange(click.IntRange):
    """A whole number from a range, refused in words."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number, or fail with a usage error."""
        try:
            number = int(value)
        except ValueError:
            self.fail(f"{value!r} is not a whole number; it must be {self._rule()}.", param, ctx)
        if (self.min is not None and number < self.min) or (
            self.max is not None and number > self.max
        ):
            self.fail(f"{number} is not allowed; it must be {self._rule()}.", param, ctx)
        return number

    def _rule(self) -> str:
        if self.max is None:
            return f"at least {self.min}"
        return f"from {self.min} to {self.max}"


class FiniteRange(click.FloatRange):
    """A number from a range; infinity and NaN, which pass every comparison, are refused."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number, or fail with a usage error."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Listing(click.ParamType[tuple[Any, ...]]):
    """Different values with commas between them, as a tuple.

    Args:
        read: reads one value; a ValueError refuses it.
        rule: what the values must be, for messages.
    """

    name = "listing"

    def __init__(self, read: Callable[[str], Any], rule: str) -> None:
        self._read, self._rule = read, rule

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[Any, ...]:
        """Return the values, or fail with a usage error."""
        if isinstance(value, tuple):
            return value
        flag = param.opts[-1] if param is not None else ""
        try:
            found = tuple(self._read(part.strip()) for part in value.split(",") if part.strip())
        except ValueError:
            found = ()
        if not found:
            raise click.UsageError(f"{flag} is {value!r}; it must be {self._rule}", ctx)
        if len(set(found)) < len(found):
            raise click.UsageError(f"{flag} {value}: each may be named once", ctx)
        return found


class Duration(click.ParamType[float]):
    """A time as ``8h``, ``1h30m`` or ``90s``, in seconds."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the seconds, or fail with a usage error."""
        if isinstance(value, float | int):
            return float(value)
        parts = re.fullmatch(r"(?:(\d+)h)?(?:(\d+)m(?:in)?)?(?:(\d+)s)?", value.strip())
        hours, minutes, seconds = (int(part or 0) for part in parts.groups()) if parts else (0,) * 3
        total = 3600 * hours + 60 * minutes + seconds
        if not total:
            self.fail(f"{value!r} is no time; give one as 8h, 1h30m or 90s.", param, ctx)
        return float(total)


# --- from settings -------------------------------------------------------------------------


def campaign_options(command: Command) -> Command:
    """Add an option for every field of a campaign's settings that has a text."""
    for settings in (TrialSettings, CampaignSettings, Limits):
        for field in reversed(dataclasses.fields(settings)):
            if "text" in field.metadata:
                command = setting_option(settings, field.name)(command)
    return command


#: options that are named otherwise than the stored field
FLAGS = {"jittered": "perturbed"}


def setting_option(
    settings: type, name: str, *, default: Any = None, text: str = ""
) -> Callable[[Command], Command]:
    """Make the option of one field of a campaign's settings.

    Args:
        settings: the dataclass.
        name: of the field, which has a text.
        default: instead of the field's.
        text: instead of the field's.
    """
    field = next(f for f in dataclasses.fields(settings) if f.name == name)
    hint = typing.get_type_hints(settings)[name]
    kind, metavar = _parameter_type(name, hint, field.metadata["rule"])
    chosen = field.default if default is None else default
    return click.option(
        f"--{FLAGS.get(name, name).replace('_', '-')}",
        name,
        type=kind,
        metavar=metavar,
        is_flag=kind is bool,
        default=chosen.name if isinstance(chosen, Choice) else chosen,
        show_default=kind is not bool,
        help=text or field.metadata["text"],
    )


def _parameter_type(name: str, hint: Any, rule: Rule) -> tuple[Any, str | None]:
    """Choose click's type for a field, and the word for its value in the help."""
    if hint is bool:
        return bool, None
    if typing.get_origin(hint) is Literal:
        return click.Choice(typing.get_args(hint)), None
    if hint is int:
        return WholeRange(_whole(rule.low), _whole(rule.high)), "N"
    if hint is float:
        low = rule.low if rule.above is None else rule.above
        word = {"s": "SECONDS", "GiB": "GIB"}.get(rule.unit, "X")
        return FiniteRange(low, rule.high, min_open=rule.above is not None), word
    return component(name) if hint is Choice else str, "NAME"


def _whole(bound: float | None) -> int | None:
    return None if bound is None else int(bound)


# --- others ----------------------------------------------------------------------------------


def seed_option(text: str = "") -> Callable[[Command], Command]:
    """Make ``--seed N`` of a command that draws as a campaign does."""
    return setting_option(TrialSettings, "seed", text=text)


def format_option(command: Command) -> Command:
    """Add ``--format text|json``, as ``style``; an interruption is one JSON object, too."""

    @functools.wraps(command)
    def answering(*args: Any, **options: Any) -> Any:
        try:
            return command(*args, **options)
        except KeyboardInterrupt as error:
            if options["style"] == "json":
                output.print_json(output.interruption_data(error))
            raise

    return click.option(
        "--format",
        "style",
        type=click.Choice(FORMATS),
        default="text",
        show_default=True,
        help="Form of the output; json prints one JSON object on stdout and nothing else there.",
    )(cast("Command", answering))


def output_option(
    metavar: str, text: str = "", *, required: bool = False, **default: Any
) -> Callable[[Command], Command]:
    """Make ``-o PATH``, as ``output``; ``default=PATH`` is shown."""
    return click.option(
        "-o",
        "--output",
        type=FILE,
        metavar=metavar,
        required=required,
        show_default=bool(default),
        help=text or None,
        **default,  # click takes default=None for a value
    )


def stack_options(command: Command) -> Command:
    """Add ``--stack`` and repeatable ``--set LAYER[.OPTION]=VALUE``, as ``settings``."""
    command = click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="LAYER[.OPTION]=VALUE",
        help=(
            "Layer or option to change after --stack, for example planner=ompl or "
            "planner.iterations=5000; defects=[a,b] plants faults. Repeatable."
        ),
    )(command)
    return click.option(
        "--stack",
        metavar=STACK,
        help=(
            "Stack under test: a YAML file with a name or options per layer, `default` (the "
            "shipped one), exec:CMD for a program of yours, connect:ADDRESS for one that runs "
            "already, or ADAPTER:TEXT for another kind, for example ros_nodes:nodes.yaml."
        ),
    )(command)


def against_option(command: Command) -> Command:
    """Add ``--against STACK``, the other stack of a campaign."""
    return click.option(
        "--against",
        metavar=STACK,
        help=(
            "Other stack, in the forms of --stack: the search looks for worlds in which "
            "the stack under test fails robustly and the other one passes. It gets the "
            "engine and people of the stack under test."
        ),
    )(command)


def spec_option(command: Command) -> Command:
    """Add repeatable ``--spec NAME``, as ``specs``."""
    return click.option(
        "--spec",
        "specs",
        type=component("specification"),
        multiple=True,
        metavar="NAME",
        help=(
            "Specification to judge, or stl:FORMULA for your own. Repeatable; without it "
            "the default specifications judge."
        ),
    )(command)


def then_option(command: Command) -> Command:
    """Add repeatable ``--secondary-spec NAME`` as ``then``."""
    return click.option(
        "--secondary-spec",
        "then",
        type=component("specification"),
        multiple=True,
        metavar="NAME",
        help="Specification whose violation ends no trial early and does not count for "
        "--stop-after. Repeatable; default: deadlines and all_tasks_done, or none with --spec.",
    )(command)


def confirm_option(command: Command) -> Command:
    """Add ``--confirm ENGINE,ENGINE``, engines for failures, as ``confirm``."""
    return click.option(
        "--confirm",
        type=Listing(str, "names of engines, as bullet,mujoco"),
        default=(),
        metavar="ENGINE,...",
        help=(
            "Engines to run each robust failure on as well, with perturbed runs, for example "
            "bullet,mujoco."
        ),
    )(command)


def param_option(command: Command) -> Command:
    """Add repeatable ``-p NAME=VALUE`` for Scenic's global parameters, as ``params``."""
    return click.option(
        "-p",
        "--param",
        "params",
        multiple=True,
        metavar="NAME=VALUE",
        help=(
            "Value of a global parameter of the Scenic program, for example horizon=300. "
            "Repeatable."
        ),
    )(command)


def trial_arguments(command: Command) -> Command:
    """Add a campaign's directory and a trial in it, as ``directory`` and ``id``."""
    command = click.argument("id", metavar="ID")(command)
    return click.argument("directory", type=FILE)(command)


def trust_option(command: Command) -> Command:
    """Add ``--trust``, to run what the folder of somebody else names."""
    return click.option(
        "--trust",
        is_flag=True,
        callback=lambda context, option, value: output.say if value else False,
        help=(
            "Allow the folder's own code to run: its program, its stack's command, its "
            "components. Needed for a folder that you did not make on this machine; "
            "remembered until that code changes."
        ),
    )(command)


def run_option(text: str) -> Callable[[Command], Command]:
    """Make ``--run``, which makes again what a trial did not keep."""
    return click.option("--run", is_flag=True, help=text)


def workers_option(command: Command) -> Command:
    """Add ``--workers W``, processes at a time."""
    return click.option(
        "--workers",
        type=WholeRange(1, MAX_WORKERS),
        metavar="W",
        help="Number of worker processes; default: one per core. It changes no result.",
    )(command)


def removed_option(flag: str, instead: str) -> Callable[[Command], Command]:
    """Make ``flag VALUE`` a usage error that says what does its work now."""

    def refuse(context: click.Context, _: click.Parameter, value: object) -> None:
        if value is not None:
            raise click.UsageError(f"{flag} has been removed: {instead}", context)

    return click.option(flag, hidden=True, expose_value=False, callback=refuse)


def count_option(
    flag: str, low: int, high: int, *, default: int, text: str
) -> Callable[[Command], Command]:
    """Make ``flag N``, a whole number from ``low`` to ``high``."""
    return click.option(
        flag,
        type=WholeRange(low, high),
        default=default,
        show_default=True,
        metavar="N",
        help=text,
    )
