"""Tables in Markdown, a row at a time."""

from __future__ import annotations


def heads(*names: str) -> str:
    """Write the heads of a table, and the line below them."""
    return f"{row(*names)}\n{'|---' * len(names)}|"


def row(*cells: object) -> str:
    """Write a row."""
    return f"| {' | '.join(map(str, cells))} |"
