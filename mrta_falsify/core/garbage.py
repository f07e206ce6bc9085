"""How often a process of the toolkit collects garbage."""

from __future__ import annotations

import gc

SELDOM = 10_000  # new objects between two collections; Python's preset is 700


def collect_seldom() -> None:
    """Collect garbage seldom, in a process that is the toolkit's own.

    Reading programs and compiled code makes a million objects that stay. Each collection on the way
    looks at them in vain.
    """
    gc.set_threshold(SELDOM)
