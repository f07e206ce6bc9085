"""``python -m mrta_falsify.cli``."""

from mrta_falsify.cli import main

main()
