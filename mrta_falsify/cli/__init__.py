"""The command line; ``main`` is the console script."""

from mrta_falsify.cli.commands import main

__all__ = ["main"]
