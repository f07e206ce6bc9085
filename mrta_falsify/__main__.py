"""``python -m mrta_falsify``: the command line."""

from mrta_falsify.core.start import leave_here

leave_here()

from mrta_falsify.cli import main  # noqa: E402 - what it imports is looked for from now on

main()
