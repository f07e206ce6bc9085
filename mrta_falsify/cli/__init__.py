"""The command line; ``main`` is the console script.

Each module adds its commands to the group when it is imported. A command parses its options, calls
the function of the Python face that has its name, and prints the value. Options carry the names of
that function's parameters, so a command hands them on as they are; a test compares the two.
"""

from mrta_falsify.cli import allocate_command as allocate_command
from mrta_falsify.cli import campaign_commands as campaign_commands
from mrta_falsify.cli import compare_command as compare_command
from mrta_falsify.cli import demo_command as demo_command
from mrta_falsify.cli import export_command as export_command
from mrta_falsify.cli import failure_commands as failure_commands
from mrta_falsify.cli import machine_commands as machine_commands
from mrta_falsify.cli import program_commands as program_commands
from mrta_falsify.cli import report_command as report_command
from mrta_falsify.cli import run_commands as run_commands
from mrta_falsify.cli import trial_commands as trial_commands
from mrta_falsify.cli.group import main

__all__ = ["main"]
