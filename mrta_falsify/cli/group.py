"""The group that all commands belong to; a command's module is imported when it is called."""

from __future__ import annotations

import importlib
import json
from importlib import metadata
from typing import Any, NamedTuple

import click

from mrta_falsify.cli.exits import MEANINGS, Door, ExitCode
from mrta_falsify.core.errors import UnknownNameError


class Listed(NamedTuple):
    """A command in the list of ``--help``."""

    module: str  #: of ``mrta_falsify.cli``, adds the command when it is imported
    summary: str  #: in one line of 80 columns
    violated: str = ""  #: what exit code 1 means, empty: the command never ends with it
    failed: str = ""  #: what exit code 3 means beside a failure of the toolkit


COMMANDS = {
    "allocate": Listed(
        "allocate_command",
        "Plan which robot serves which task of a task file.",
        violated="a deadline is not kept, or cannot be",
    ),
    "bench": Listed("machine_commands", "Measure the speed of every layer on this machine."),
    "campaign": Listed(
        "campaign_commands",
        "Search a Scenic program for failures of the stack.",
        violated="a violation was found",
        failed="a trial was lost three times",
    ),
    "certify": Listed(
        "failure_commands",
        "Prove deadlocks from world and trace.",
        violated="a deadlock without a certificate",
    ),
    "check": Listed("program_commands", "Compile, sample and lint Scenic programs."),
    "ci": Listed(
        "ci_command",
        "Run what changed; list new, ongoing and resolved failures.",
        violated="something fails; with `--fail-on new` something new",
    ),
    "compare": Listed("compare_command", "Compare samplers on one scenario."),
    "completion": Listed("completion_command", "Print the completion script of a shell."),
    "corpus": Listed(
        "failure_commands",
        "Run stored failures, or the zoo, on a stack.",
        violated="not all failures are fixed, or a scene of the zoo not as known",
    ),
    "demo": Listed("demo_command", "Show the main job in miniature on the AWS hospital."),
    "doctor": Listed(
        "machine_commands",
        "Check this machine: libraries, cache, determinism.",
        failed="something needed is broken",
    ),
    "stack-test": Listed(
        "machine_commands",
        "Test a foreign stack.",
        violated="a check failed",
    ),
    "explain": Listed("failure_commands", "Find the layer that a failure belongs to."),
    "export": Listed("export_command", "Write a world, or a trial, for another system."),
    "import": Listed("import_command", "Make a floor of a map, or a scenario of a log."),
    "init": Listed("campaign_commands", "Write a first scenario and stack file."),
    "issue": Listed("issue_command", "Write a failure as an issue, with world and pictures."),
    "list": Listed("trial_commands", "List the trials of a campaign."),
    "minimize": Listed("failure_commands", "Find the smallest world that fails in the same way."),
    "plugins": Listed("machine_commands", "List the components of every extension point."),
    "replay": Listed(
        "trial_commands",
        "Run a stored trial again and compare digests.",
        violated="digests differ",
    ),
    "report": Listed("report_command", "Write the failure report of a campaign."),
    "run": Listed(
        "run_commands",
        "Run the full stack in one world and judge it.",
        violated="a violation was found",
    ),
    "sample": Listed("program_commands", "Write worlds sampled from a Scenic program."),
    "show": Listed("trial_commands", "Show one trial: verdicts, evidence, digests."),
    "travel-times": Listed("run_commands", "Measure how long a robot takes from room to room."),
}

#: commands and options whose names changed; the old one still works, with a warning
RENAMED = {"door-test": "stack-test", "--jittered": "--perturbed", "--then": "--secondary-spec"}
#: commands that are gone: what to do instead
REMOVED = {"serve": "`mrta-falsify report DIR --watch 5 --open` rewrites the page while it runs"}


def exit_codes(name: str) -> dict[int, str]:
    """Say what the exit codes of a command mean."""
    listed = COMMANDS[name]
    broken = MEANINGS[ExitCode.HARNESS] + (f", or {listed.failed}" if listed.failed else "")
    own = {ExitCode.VIOLATED: listed.violated, ExitCode.HARNESS: broken}
    return {int(code): text for code, text in (MEANINGS | own).items() if text}


class CommandWithCodes(click.Command):
    """A command whose help ends with its own exit codes, and that knows old names of options."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, old names of options replaced."""
        flags = {flag for param in self.params for flag in param.opts}
        for place, word in enumerate(args):
            flag, equals, value = word.partition("=")
            if flag in RENAMED and flag not in flags and RENAMED[flag] in flags:
                _warn_renamed(flag)
                args[place] = RENAMED[flag] + equals + value
        return super().parse_args(ctx, args)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the epilog, then what exit codes 1 and 3 mean here."""
        super().format_epilog(ctx, formatter)
        listed = COMMANDS[str(self.name)]
        own = {ExitCode.VIOLATED: listed.violated, ExitCode.HARNESS: listed.failed}
        lines = [f"Exit code {code}: {text}." for code, text in own.items() if text]
        if lines:
            formatter.write_paragraph()
            formatter.write_text(" ".join(lines))


def _warn_renamed(name: str) -> None:
    click.echo(f"note: {name} is called {RENAMED[name]} now", err=True)


class LazyDoor(Door):
    """A door whose commands are imported when they are called, so that ``--help`` is quick."""

    command_class = CommandWithCodes

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, sorted."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is no such command."""
        if cmd_name in COMMANDS:
            importlib.import_module(f"mrta_falsify.cli.{COMMANDS[cmd_name].module}")
        return super().get_command(ctx, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that is called.

        Raises:
            click.UsageError: there is none of that name.
        """
        if args and args[0] in RENAMED:
            _warn_renamed(args[0])
            args = [RENAMED[args[0]], *args[1:]]
        if args and args[0] in REMOVED:
            raise click.UsageError(f"{args[0]} is gone: {REMOVED[args[0]]}", ctx)
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(str(UnknownNameError("command", args[0], COMMANDS)), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].summary) for name in sorted(COMMANDS)])

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the exit codes mean."""
        formatter.write_paragraph()
        codes = ", ".join(f"{code} {text}" for code, text in MEANINGS.items())
        formatter.write_text(f"Exit codes: {codes}.")


def described() -> dict[str, Any]:
    """Describe all commands and options as click does, each command with its exit codes."""
    context = click.Context(main, info_name=main.name)
    info = main.to_info_dict(context)
    for name, command in info["commands"].items():
        command["exit_codes"] = exit_codes(name)
    codes = {int(code): text for code, text in MEANINGS.items()}
    return {"version": metadata.version("mrta-falsify"), "exit_codes": codes, **info}


def _print_described(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        click.echo(json.dumps(described(), indent=2, default=str))
        context.exit()


@click.group("mrta-falsify", cls=LazyDoor, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--help-json",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_described,
    help="Print all commands, options and exit codes as one JSON object.",
)
@click.version_option(package_name="mrta-falsify", message="mrta-falsify %(version)s")
def main() -> None:
    """Find, explain and reproduce deadlocks in multi-robot task-allocation stacks.

    The first time: `mrta-falsify demo`, or `mrta-falsify init` for files of your own.
    """
