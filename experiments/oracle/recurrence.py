"""Proof that a run goes on as it does: its poses repeat themselves.

Stack and engine are deterministic and the labelled worlds have no noise. Poses that have
repeated themselves for longer than any clock of the stack runs therefore repeat themselves for
good. A robot at rest is the simplest case.
"""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array

REPEATED = 40.0  # s that must repeat themselves; the stack's longest clock is 15 s (late feedback)
SHORTEST = 20.0  # s, smallest shift at which they are compared, a multiple of the period
LONGEST = 80.0  # s, largest
#: m or rad between two repetitions: rounding. Over 3,600 s it adds up to less than a micrometre.
SAME = 1e-9
#: m or rad; what differs by more must not drift apart: a robot creeps off an unstable balance
#: by ever larger steps
ROUNDING = 1e-12


def repeats_itself(poses: Array, dt: float, *, clock: float = 0.0) -> bool:
    """Whether the last poses of a run repeat earlier ones.

    Args:
        poses: ``(K, N, 3)`` x [m], y [m], yaw [rad], one row a tick.
        dt: of a tick [s].
        clock: a timer that may run without showing in the poses, beside the shipped stack's [s].
    """
    window, shortest = round((REPEATED + clock) / dt), round(SHORTEST / dt)
    longest = min(round(LONGEST / dt), len(poses) - window)
    if longest < shortest:
        return False
    shifts = np.arange(shortest, longest + 1)
    is_same = _apart(poses[len(poses) - 1 - shifts], poses[-1]).max(axis=(1, 2)) <= SAME
    last = poses[-window:]
    for shift in shifts[is_same][:10].tolist():
        apart = _apart(poses[-window - shift : len(poses) - shift], last)
        before, lately = apart[: window // 2].max(), apart[window // 2 :].max()
        if max(before, lately) <= SAME and lately <= max(2.0 * before, ROUNDING):
            return True
    return False


def _apart(a: Array, b: Array) -> Array:
    """Distances of poses per coordinate, whole turns apart counted as equal."""
    difference = np.abs(a - b)
    yaw = difference[..., 2]
    difference[..., 2] = np.minimum(yaw % (2.0 * np.pi), -yaw % (2.0 * np.pi))
    return np.asarray(difference)
