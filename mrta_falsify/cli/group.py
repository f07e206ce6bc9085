"""The group that all commands belong to."""

from __future__ import annotations

import click

from mrta_falsify.cli.door import Door


@click.group("mrta-falsify", cls=Door, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="mrta-falsify", message="mrta-falsify %(version)s")
def main() -> None:
    """Find, explain and reproduce deadlocks in multi-robot task-allocation stacks.

    Exit codes: 0 nothing violated, 1 violations found, 2 bad input, 3 the toolkit itself
    failed, 130 interrupted.
    """
