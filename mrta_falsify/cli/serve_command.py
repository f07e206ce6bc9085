"""The command ``serve``."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from mrta_falsify.cli import output
from mrta_falsify.cli.door import ExitCode
from mrta_falsify.cli.group import main
from mrta_falsify.cli.options import FILE, count_option

PORT = 8377


@main.command("serve")
@click.argument("directory", type=FILE)
@count_option("--port", 0, 65535, default=PORT, text="Of this machine; 0: any that is free.")
@click.option(
    "--lichtblick",
    default="",
    metavar="ADDRESS",
    help="Let this Lichtblick read the runs of failures, as http://localhost:8080, and link to it.",
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def serve_command(directory: Path, port: int, lichtblick: str, opens: bool) -> int:
    """Show a campaign in the browser while it runs, until Ctrl-C.

    Only this machine can ask for it, and nothing can be changed by it. Requests that another page
    makes are refused; only the Lichtblick that is named may read runs.
    """
    from mrta_falsify.verbs.serve import LiveServer

    with LiveServer(directory, port, lichtblick=lichtblick) as server:
        click.echo(server.address)
        if opens and not webbrowser.open(server.address):
            output.say(f"no browser was found; open {server.address} yourself")
        server.serve_forever()
    return ExitCode.DONE
