"""The group that all commands belong to; a command's module is imported when it is called."""

from __future__ import annotations

import importlib
from typing import NamedTuple

import click

from mrta_falsify.cli.door import Door


class Listed(NamedTuple):
    """A command in the list of ``--help``."""

    module: str  #: of ``mrta_falsify.cli``, adds the command when it is imported
    summary: str  #: in one line of 80 columns


COMMANDS = {
    "allocate": Listed("allocate_command", "Plan which robot serves which task of a task file."),
    "bench": Listed("machine_commands", "Measure the speed of every layer on this machine."),
    "campaign": Listed("campaign_commands", "Search a Scenic program for failures of the stack."),
    "certify": Listed("failure_commands", "Prove deadlocks from World and trace."),
    "check": Listed("program_commands", "Compile, sample and lint Scenic programs."),
    "ci": Listed("ci_command", "Run what changed; tell new, ongoing and resolved failures."),
    "compare": Listed("compare_command", "Compare samplers on one scenario."),
    "corpus": Listed("failure_commands", "Run stored failures, or the zoo, on a stack."),
    "demo": Listed("demo_command", "Show the main job in miniature on the AWS hospital."),
    "doctor": Listed("machine_commands", "Check this machine: libraries, cache, determinism."),
    "door-test": Listed("machine_commands", "Test a stack in a process of its own."),
    "explain": Listed("failure_commands", "Ask which layer a failure belongs to."),
    "export": Listed("export_command", "Write a world, or a trial, for another system."),
    "family": Listed("failure_commands", "Find the rule behind a failure."),
    "import": Listed("import_command", "Make a floor of a Nav2 map and a file of rooms."),
    "init": Listed("campaign_commands", "Write a scenario and a stack file to begin with."),
    "issue": Listed("issue_command", "Write a failure as an issue, with all that belongs to it."),
    "list": Listed("trial_commands", "List the trials of a campaign."),
    "minimize": Listed("failure_commands", "Find the smallest world that fails in the same way."),
    "plugins": Listed("machine_commands", "List the components of every extension point."),
    "replay": Listed("trial_commands", "Run a stored trial again and compare digests."),
    "report": Listed("report_command", "Write the failure report of a campaign."),
    "run": Listed("run_commands", "Run the full stack in one world and judge it."),
    "sample": Listed("program_commands", "Write worlds sampled from a Scenic program."),
    "show": Listed("trial_commands", "Show one trial: verdicts, evidence, digests."),
    "travel-times": Listed("run_commands", "Measure how long a robot takes from room to room."),
}


class LazyDoor(Door):
    """A door whose commands are imported when they are called, so that ``--help`` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, sorted."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is no such command."""
        if cmd_name in COMMANDS:
            importlib.import_module(f"mrta_falsify.cli.{COMMANDS[cmd_name].module}")
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].summary) for name in sorted(COMMANDS)])


@click.group("mrta-falsify", cls=LazyDoor, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="mrta-falsify", message="mrta-falsify %(version)s")
def main() -> None:
    """Find, explain and reproduce deadlocks in multi-robot task-allocation stacks.

    Exit codes: 0 nothing violated, 1 violations found, 2 bad input, 3 the toolkit itself
    failed, 130 interrupted.
    """
