"""What was recorded of a fleet: where its robots were, where they were sent, and on which map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from simulator_interface.formats.nav2 import OccupancyGrid


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotLog:
    """One robot's record; times [s] count from the begin of the log."""

    name: str
    time: Array  #: (K,) growing [s], K >= 1
    pose: Array  #: (K, 3) x [m], y [m], yaw [rad], map frame
    source: str  #: what the poses are from, in words
    goals: tuple[tuple[float, Array], ...] = ()  #: time [s] and place (2,) [m]
    paths: tuple[tuple[float, Array], ...] = ()  #: time [s] and points (L, 2) [m]

    def at(self, times: Array) -> Array:
        """Interpolate poses ``(T, 3)`` at ``times`` ``(T,)`` [s]; before and after, it stands."""
        yaw = np.unwrap(self.pose[:, 2])
        columns = (self.pose[:, 0], self.pose[:, 1], yaw)
        return np.stack([np.interp(times, self.time, column) for column in columns], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetLog:
    """A log of a fleet."""

    robots: tuple[RobotLog, ...]  #: by name
    grid: OccupancyGrid | None  #: the map; None: the log has none
    duration: float  #: [s]
    notes: tuple[str, ...] = ()  #: what a reader should know, in words


def thinned(times: Array, least: float) -> IntArray:
    """Number the samples ``(K,)`` that follow each other by at least ``least`` [s]."""
    kept: list[int] = []
    for k, time in enumerate(times.tolist()):
        if not kept or time - times[kept[-1]] >= least:
            kept.append(k)
    return np.array(kept, dtype=np.int64)
