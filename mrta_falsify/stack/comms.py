"""Which communication links are up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import BoolArray
from mrta_falsify.core.world import LINKS, CommsOutage, World


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Links of all robots at one moment; True means up."""

    dispatcher: BoolArray  #: (N,)
    planner: BoolArray  #: (N,)
    states: BoolArray  #: (N,)
    leader: BoolArray  #: (N,)

    def down_for(self, robot: int) -> tuple[str, ...]:
        """Names of the links of one robot that are down."""
        return tuple(name for name in LINKS if not getattr(self, name)[robot])


def links_at(world: World, time: float) -> Links:
    """Links of the robots of ``world`` at ``time`` [s]."""
    up = {name: np.ones(len(world.robots), dtype=np.bool_) for name in LINKS}
    for event in world.events:
        if isinstance(event, CommsOutage) and event.start <= time < event.end:
            for number, robot in enumerate(world.robots):
                if not event.robots or robot.name in event.robots:
                    for link in event.links:
                        up[link][number] = False
    return Links(**up)


def outage_times(world: World) -> tuple[float, ...]:
    """Times [s] at which a link changes, sorted."""
    outages = [event for event in world.events if isinstance(event, CommsOutage)]
    return tuple(sorted({time for event in outages for time in (event.start, event.end)}))
