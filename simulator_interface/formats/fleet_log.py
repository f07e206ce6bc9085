"""What was recorded of a fleet: where its robots were, where they were sent, and on which map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.geometry import wrap_angle
from simulator_interface.formats.nav2 import OccupancyGrid

SILENT_FOR = 5.0  # s without a pose up to the end, from then on the import says so
GAP = 2.0  # s between poses, and 3 times the usual step: the robot may have stood
USUAL_SPEED, LEAST_SPEED = 0.5, 0.1  # m/s, of a robot whose own is not known, and of any
TURN_RATE = 1.0  # rad/s, as slow as robots turn on the spot


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
    duration: float  #: to the end of the recording, whatever was told last [s]
    notes: tuple[str, ...] = ()  #: what a reader should know, in words
    is_cut: bool = False  #: something of the recording could not be read
    begins_at: float | None = None  #: seconds since 1970; None: it is not known

    def silent(self) -> tuple[RobotLog, ...]:
        """List the robots whose poses end well before the recording does."""
        return tuple(r for r in self.robots if self.duration - float(r.time[-1]) > SILENT_FOR)


def with_stands(time: Array, pose: Array) -> tuple[Array, Array]:
    """Let a robot stand in the gaps between its poses, and set out in time for the next one.

    Localisation that tells poses only in motion (AMCL) is silent while a robot stands. Between the
    poses before and after, it would creep for all of that time.

    Args:
        time: ``(K,)`` growing [s].
        pose: ``(K, 3)`` x [m], y [m], yaw [rad].

    Returns:
        Both with a pose added before the end of every such gap.
    """
    step = np.diff(time)
    away = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    turn = np.abs(wrap_angle(np.diff(pose[:, 2])))
    least = max(GAP, 3.0 * float(np.median(step))) if len(step) else GAP
    drives = (step <= least) & (step > 0.0) & (away > LEAST_SPEED * step)
    speed = float(np.percentile(away[drives] / step[drives], 75)) if drives.any() else USUAL_SPEED
    needs = np.maximum(away / max(speed, LEAST_SPEED), turn / TURN_RATE)
    stands = np.flatnonzero((step > least) & (step - needs > 0.5))
    return (
        np.insert(time, stands + 1, time[stands + 1] - needs[stands]),
        np.insert(pose, stands + 1, pose[stands], axis=0),
    )


def thinned(times: Array, least: float) -> IntArray:
    """Number the samples ``(K,)`` that follow each other by at least ``least`` [s]."""
    kept: list[int] = []
    for k, time in enumerate(times.tolist()):
        if not kept or time - times[kept[-1]] >= least:
            kept.append(k)
    return np.array(kept, dtype=np.int64)
