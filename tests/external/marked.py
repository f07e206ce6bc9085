"""Processes that carry a mark in their environment, however they were started."""

from __future__ import annotations

from pathlib import Path


def marked(mark: str) -> list[int]:
    """Find the numbers of all processes with the text ``mark`` in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            environment = (entry / "environ").read_bytes()
        except OSError:  # it has ended, or is another user's
            continue
        if mark.encode() in environment:
            found.append(int(entry.name))
    return found
