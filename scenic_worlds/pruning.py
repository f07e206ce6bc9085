"""Undoes what Scenic's pruning does to the distribution of a program.

Scenic 3.1 restricts the points that objects are placed at to where requirements can hold, after
it has compiled a program (``scenic.core.pruning``). That must not change the distribution
conditional on the requirements, and does in three cases:

- An object stands at a point and an offset, as by ``on REGION``, ``beyond POINT by D`` and
  ``at POINT + OFFSET``. Scenic replaces the sum. Its orientation, and whatever else depends on
  the point, still depends on the old one, so position and orientation are drawn apart. The offset
  may also reach out of the container, where the point needs not lie in it.
- The object is mutated: the container holds the mutated object, not the point before the noise.
- The new region depends on other random values, such as what a randomly placed robot sees. Each
  place of the robot is then equally likely, however little it leaves for the object.

What is undone here is left to rejection.
"""

from __future__ import annotations

from typing import Any

from scenic.core.distributions import Samplable, needsSampling
from scenic.core.regions import AllRegion, PointInRegionDistribution, PolygonalFootprintRegion
from scenic.core.scenarios import Scenario


def undo_unfaithful_pruning(scenario: Scenario) -> None:
    """Let positions have Scenic's own distribution again where pruning has changed it.

    Args:
        scenario: compiled by Scenic, changed in place.
    """
    for thing in scenario.objects:
        position = thing.position
        is_pruned = isinstance(position, Samplable) and position._conditioned is not position
        if is_pruned and not _keeps_distribution(thing, position):
            position.conditionTo(position)


def _keeps_distribution(thing: Any, position: Samplable) -> bool:
    """Whether an object's position is pruned without a change of the distribution."""
    if not isinstance(position, PointInRegionDistribution):
        return False
    if isinstance(position.region, (AllRegion, PolygonalFootprintRegion)):
        return True  # `visible`: only the pruned region can be drawn from
    mutates = needsSampling(thing.mutationScale) or thing.mutationScale != 0
    return not mutates and not needsSampling(position._conditioned.region)
