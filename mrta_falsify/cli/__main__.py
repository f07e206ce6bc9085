"""``python -m mrta_falsify.cli``."""

from mrta_falsify.cli.commands import main

main()
