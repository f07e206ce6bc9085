"""``python -m mrta_falsify``: the command line."""

from mrta_falsify.cli import main

main()
