"""The command line; ``main`` is the console script.

Each module adds its commands to the group when it is imported.
"""

from mrta_falsify.cli import allocate_command as allocate_command
from mrta_falsify.cli import campaign_commands as campaign_commands
from mrta_falsify.cli import demo as demo
from mrta_falsify.cli import export_command as export_command
from mrta_falsify.cli import failure_commands as failure_commands
from mrta_falsify.cli import family_command as family_command
from mrta_falsify.cli import scenario_commands as scenario_commands
from mrta_falsify.cli import study_commands as study_commands
from mrta_falsify.cli.run_commands import main

__all__ = ["main"]
