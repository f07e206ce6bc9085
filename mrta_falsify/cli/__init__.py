"""The command line; ``main`` is the console script.

A command parses its options, calls the function of the Python face that has its name, and prints
the value. Options carry the names of that function's parameters, so a command hands them on as
they are; a test compares the two.
"""

import sys

if sys.argv[:1] == ["-m"]:  # Python looks for `-m mrta_falsify.cli`, before anything else of ours
    from mrta_falsify.core.start import leave_here

    leave_here()

from mrta_falsify.cli import stopping
from mrta_falsify.core.garbage import collect_seldom

stopping.listen_while_loading()
collect_seldom()

from mrta_falsify.cli.group import main  # noqa: E402 - it takes a while, and may be interrupted

__all__ = ["main"]
