"""Logs by their kind: ROS 2 recordings, and runs of this toolkit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError
from mrta_falsify.core.trace import Trace, read_trace
from mrta_falsify.core.wait_account import is_kept
from mrta_falsify.core.world import World, read_world
from simulator_interface.formats.fleet_log import FleetLog, RobotLog
from simulator_interface.formats.rosbag_log import is_bag, read_bag

TRACE, WORLD = "trace.zip", "world.json"


def is_log(path: Path) -> bool:
    """Whether a path is named as a log is: a bag, or a run with its trace."""
    return _is_run(path) or is_bag(path)


def _is_run(path: Path) -> bool:
    return path.name == TRACE or (path.is_dir() and (path / TRACE).exists())


def read_log(path: Path) -> tuple[FleetLog, World | None]:
    """Read a log, and the world that was run if it is one of ours.

    Args:
        path: a bag; a run's folder with ``world.json`` and ``trace.zip``, or its trace.

    Raises:
        InputError: it is missing, damaged, or tells no robot's poses.
    """
    if not _is_run(path):
        return read_bag(path), None
    folder = path if path.is_dir() else path.parent
    world = read_world(folder / WORLD)
    trace = read_trace(folder / TRACE)
    if not is_kept(trace):
        raise FormatError(f"{folder / TRACE}: has no frames; only its digest was kept")
    log = _log_of_trace(trace)
    if trace.world_digest != world.digest():
        raise FormatError(f"{folder / TRACE}: is of another world than {folder / WORLD}")
    return log, world


def _log_of_trace(trace: Trace) -> FleetLog:
    times = np.asarray(trace.columns["time"], dtype=np.float64)
    poses = np.asarray(trace.columns["pose"], dtype=np.float64)
    goals = np.asarray(trace.columns["goal"], dtype=np.float64)
    return FleetLog(
        robots=tuple(
            RobotLog(
                name=name,
                time=frozen_array(times),
                pose=frozen_array(poses[:, i]),
                source="a trace",
                goals=_changes(times, goals[:, i]),
                paths=tuple(
                    (float(change.tick * trace.dt), change.points)
                    for change in trace.paths
                    if change.robot == i and len(change.points)
                ),
            )
            for i, name in enumerate(trace.robots)
        ),
        grid=None,
        duration=float(times[-1]),
    )


def _changes(times: Array, goals: Array) -> tuple[tuple[float, Array], ...]:
    """List when a goal ``(K, 2)`` became another one."""
    found: list[tuple[float, Array]] = []
    for time, goal in zip(times.tolist(), goals, strict=True):
        if np.isfinite(goal).all() and (not found or not np.array_equal(found[-1][1], goal)):
            found.append((time, frozen_array(goal)))
    return tuple(found)
