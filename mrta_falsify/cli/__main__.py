"""``python -m mrta_falsify.cli``."""

from mrta_falsify.cli.run_commands import main

main()
