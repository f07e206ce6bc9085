"""The first thing that ``python -m mrta_falsify`` does. Imports nothing that is not loaded."""

from __future__ import annotations

import os
import sys


def leave_here() -> None:
    """Take the current directory from the head of the path, where ``python -m`` has put it.

    No file there is taken for a module of a library. A checkout that is run where it lies is left
    as it is.
    """
    here = os.getcwd()
    top = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    if not sys.flags.safe_path and sys.path[:1] in ([""], [here]) and top != here:
        del sys.path[0]
