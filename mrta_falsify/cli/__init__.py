"""The command line; ``main`` is the console script.

Each module adds its commands to the group when it is imported.
"""

from mrta_falsify.cli import allocation as allocation
from mrta_falsify.cli import campaigns as campaigns
from mrta_falsify.cli import comparing as comparing
from mrta_falsify.cli import demo as demo
from mrta_falsify.cli import exports as exports
from mrta_falsify.cli import failures as failures
from mrta_falsify.cli import families as families
from mrta_falsify.cli import scenarios as scenarios
from mrta_falsify.cli.commands import main

__all__ = ["main"]
