"""How a control period is cut into the engines' sub-steps."""

from __future__ import annotations

import math


def count_substeps(dt: float, step_size: float) -> int:
    """Count the sub-steps of at most ``step_size`` [s] in a control period ``dt`` [s]."""
    return max(1, math.ceil(dt / step_size - 1e-9))
