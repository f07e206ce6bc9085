"""An observed value is one row: its shape, and what becomes of it in traces and digests.

The row stands beside the field, in :mod:`.fleet`. Columns of the trace, the digest, the check of a
trace file, the comparison of two traces, frames that nothing was measured for and the message to a
foreign stack follow from it.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Observed:
    """What becomes of a value that is observed each tick.

    Args:
        shape: of a tick's value: N robots, H people, A rays a robot, F movable pieces of furniture,
            or a number.
        nothing: what stands for a value that nobody measured; its type is that of the column.
        finite: whether nan and infinity are refused in a trace file.
        hashed: whether it counts for the trace's digest. A value that is new is not hashed: the
            digests of runs that are stored stay what they are.
        optional: whether a trace may lack it, as older ones do; a frame that is made without it
            has ``nothing`` there.
        kept_as: type in the trace, where it is kept with fewer digits than it is computed with.
    """

    shape: tuple[str | int, ...] = ()
    nothing: float = 0.0
    finite: bool = False
    hashed: bool = True
    optional: bool = False
    kept_as: str = ""

    def blank(self, lengths: Mapping[str, int]) -> Any:
        """Make the value that nobody measured; what ``lengths`` does not give is 0 long."""
        shape = [n if isinstance(n, int) else lengths.get(n, 0) for n in self.shape]
        return np.full(shape, self.nothing)


def observed_in(kind: type) -> dict[str, Observed]:
    """List the observed values among the fields of a class, by name, in their order."""
    hints = typing.get_type_hints(kind, include_extras=True)
    rows = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: row[0] for name, row in rows.items() if row and isinstance(row[0], Observed)}
