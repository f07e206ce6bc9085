"""A failure that was decided at 31.4 s by the queue policy, as `explain` tells it."""

from __future__ import annotations

from mrta_falsify.core.inevitability import ChanceCurve, Inevitability, RewoundTo
from mrta_falsify.core.probability import failure_probability

NAME = "queue policy: <another>"


def _points(*rows):
    return tuple(
        RewoundTo(time=time, chance=failure_probability(failed, runs))
        for time, failed, runs in rows
    )


DECIDED = Inevitability(
    onset=38.0,
    found=40.0,
    curves=(
        ChanceCurve(
            replaced="nothing",
            change="the stack as it is",
            points=_points((0.0, 6, 6), (20.0, 6, 6)),
            open_until=None,
            lost_from=0.0,
        ),
        ChanceCurve(
            replaced="layer",
            name="queue_policy",
            change=NAME,
            points=_points((0.0, 0, 6), (31.0, 1, 6), (31.4, 6, 6)),
            open_until=31.0,
            lost_from=31.4,
        ),
    ),
    decided_at=31.4,
    by="queue_policy",
    runs=30,
)
