"""Holm's correction of p-values for many tests at once."""

from __future__ import annotations

from collections.abc import Sequence


def adjusted(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values, in their order: one at most ``level`` is rejected at that family-wise level.

    Reference: Holm, "A simple sequentially rejective multiple test procedure", 1979.
    """
    found, largest = [1.0] * len(p_values), 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        largest = max(largest, min(1.0, p_values[i] * (len(p_values) - rank)))
        found[i] = largest
    return found
