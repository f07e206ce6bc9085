"""What pictures and pages of a run are made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunView:
    """What pictures and pages of one run are made from."""

    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...] = ()
    costmap: Costmap | None = None  #: at time 0
    facts: tuple[tuple[str, str], ...] = ()  #: label and text, shown in this order


def kept_column(trace: Trace, name: str) -> np.ndarray | None:
    """Column of a trace; None if the trace was not kept, or is empty."""
    column = trace.columns.get(name)
    return column if column is not None and len(column) else None
