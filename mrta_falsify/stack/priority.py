"""Priority rules: who goes first where robots meet."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import IntArray
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.protocols import PriorityView
from mrta_falsify.core.registry import WithoutOptions


class FixedOrder:
    """One order for the whole episode, as MRTA-Sim: the largest robot number first.

    MRTA-Sim reads the number from the last digit of the robot's name, which ends at nine
    robots; here it is the robot's place in the world, whatever its name.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Who goes first."""

        order: tuple[int, ...] = ()  #: robot numbers, best first; others follow, largest first

        def __post_init__(self) -> None:
            if len(set(self.order)) != len(self.order) or min(self.order, default=0) < 0:
                raise ConfigError(
                    f"order is {list(self.order)}; it must list different robot numbers, "
                    "counted from 0"
                )

    def __init__(self, options: Options) -> None:
        self._options = options

    def ranks(self, view: PriorityView) -> IntArray:
        """See :class:`~mrta_falsify.core.protocols.PriorityRule`."""
        return _fixed_ranks(self._options.order, len(view.active)).copy()


class DistanceToGoal(WithoutOptions):
    """The robot with the shortest way left goes first; equal ones by smaller number."""

    def ranks(self, view: PriorityView) -> IntArray:
        """See :class:`~mrta_falsify.core.protocols.PriorityRule`."""
        return _ranks_of(np.argsort(view.distance_to_goal, kind="stable"))


@functools.lru_cache(maxsize=16)
def _fixed_ranks(order: tuple[int, ...], n: int) -> IntArray:
    """Ranks of ``n`` robots: the listed ones, then the others, the largest number first."""
    first = [robot for robot in order if robot < n]
    rest = [robot for robot in reversed(range(n)) if robot not in first]
    return _ranks_of(np.array(first + rest, dtype=np.int64))


def _ranks_of(order: IntArray) -> IntArray:
    """Rank ``(N,)`` of each robot, from robot numbers ``(N,)`` with the best first."""
    ranks = np.empty(len(order), dtype=np.int64)
    ranks[order] = np.arange(len(order))
    return ranks
