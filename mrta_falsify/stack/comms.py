"""Which communication links are up, and what the robots are told when that changes."""

from __future__ import annotations

import bisect
import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import BoolArray
from mrta_falsify.core.fleet import StackEvent
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


class LinkTimetable:
    """Links of a world's robots from each change to the next.

    Epoch 0 is the time before the first change; change n begins epoch n.

    Args:
        world: with its outages.
        until: outages that begin later are left out [s].
    """

    def __init__(self, world: World, until: float = math.inf) -> None:
        events = tuple(event for event in world.events if event.start <= until)
        world = dataclasses.replace(world, events=events) if until < math.inf else world
        self._robots = len(world.robots)
        self._changes = outage_times(world)
        self._links = [links_at(world, time) for time in (-1.0, *self._changes)]

    def epoch_at(self, time: float) -> int:
        """Number of the epoch at ``time`` [s]."""
        return bisect.bisect_right(self._changes, time)

    def links(self, epoch: int) -> Links:
        """Links in an epoch."""
        return self._links[epoch]

    def changes(self, earlier: int, epoch: int, time: float) -> list[StackEvent]:
        """Tell which links went down and came back between two epochs."""
        events = []
        for robot in range(self._robots):
            before = self._links[earlier].down_for(robot)
            now = self._links[epoch].down_for(robot)
            lost = ", ".join(name for name in now if name not in before)
            back = ", ".join(name for name in before if name not in now)
            for kind, names in (("comms-lost", lost), ("comms-back", back)):
                if names:
                    events.append(StackEvent(time=time, kind=kind, robot=robot, detail=names))
        return events


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
