"""The command ``completion``: the script with which a shell completes words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from click.shell_completion import get_completion_class

from mrta_falsify.cli.exits import ExitCode
from mrta_falsify.cli.group import main

if TYPE_CHECKING:
    from click.shell_completion import ShellComplete

SHELLS = ("bash", "zsh", "fish")
PROGRAM, VARIABLE = "mrta-falsify", "_MRTA_FALSIFY_COMPLETE"  #: the variable that click asks by


@main.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
def completion_command(shell: str) -> int:
    """Print the script with which a shell completes commands, options and names.

    bash: eval "$(mrta-falsify completion bash)" in ~/.bashrc.

    zsh: eval "$(mrta-falsify completion zsh)" in ~/.zshrc, after compinit.

    fish: mrta-falsify completion fish > ~/.config/fish/completions/mrta-falsify.fish
    """
    completer: type[ShellComplete] | None = get_completion_class(shell)
    if completer is None:
        raise click.UsageError(f"SHELL is {shell!r}; it must be one of {', '.join(SHELLS)}")
    click.echo(completer(main, {}, PROGRAM, VARIABLE).source())
    return ExitCode.DONE
