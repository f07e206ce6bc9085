"""Between the frames of the robots, of the map and of Bullet's bodies: poses, twists, motors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit


class Inertial(NamedTuple):
    """The inertial frames of all robots, in the robots' own frames."""

    offset: Array  #: (N, 3) [m]
    turned: Array  #: (N, 4) quaternions x, y, z, w
    holonomic: IntArray  #: (N,) 1: it has three joints along the map's axes instead


@njit(cache=True)
def motor_targets(
    set_point: Array, loss: Array, pose: Array, wheels: Array, holonomic: IntArray
) -> Array:
    """Compute joint speeds ``(N, 3)`` for body twists; only two count for two wheels.

    Args:
        set_point: ``(N, 3)`` forward, left [m/s], turn [rad/s].
        loss: ``(N, 2)`` shares of speed that slip takes.
        pose: ``(N, 3)``.
        wheels: ``(N, 2)`` radius and separation [m].
        holonomic: ``(N,)`` 1: three joints along the map's axes.
    """
    out = np.zeros((len(set_point), 3))
    for i in range(len(set_point)):
        forward, left, turn = set_point[i, 0], set_point[i, 1], set_point[i, 2]
        if holonomic[i] == 1:
            keep = 1.0 - loss[i, 0]
            c, s = math.cos(pose[i, 2]), math.sin(pose[i, 2])
            out[i, 0] = keep * (c * forward - s * left)
            out[i, 1] = keep * (s * forward + c * left)
            out[i, 2] = (1.0 - loss[i, 1]) * turn
        else:
            radius, half = wheels[i, 0], 0.5 * wheels[i, 1]
            out[i, 0] = (forward - half * turn) / radius * (1.0 - loss[i, 0])
            out[i, 1] = (forward + half * turn) / radius * (1.0 - loss[i, 1])
    return out


@njit(cache=True)
def floor_poses(raw: Array, inertial: Inertial) -> Array:
    """Convert poses of inertial frames to poses ``(N, 3)`` of the robot frames.

    ``raw`` ``(N, 7)`` is position and quaternion (x, y, z, w), or joint positions.
    """
    offset, turned, holonomic = inertial.offset, inertial.turned, inertial.holonomic
    out = np.zeros((len(raw), 3))
    for i in range(len(raw)):
        yaw = raw[i, 2]
        x, y = raw[i, 0], raw[i, 1]
        if holonomic[i] == 0:
            ax, ay, az, aw = raw[i, 3], raw[i, 4], raw[i, 5], raw[i, 6]
            bx, by, bz, bw = -turned[i, 0], -turned[i, 1], -turned[i, 2], turned[i, 3]
            qx = aw * bx + ax * bw + ay * bz - az * by
            qy = aw * by - ax * bz + ay * bw + az * bx
            qz = aw * bz + ax * by - ay * bx + az * bw
            qw = aw * bw - ax * bx - ay * by - az * bz
            yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
            ox, oy, oz = offset[i, 0], offset[i, 1], offset[i, 2]
            x -= (
                (1.0 - 2.0 * (qy * qy + qz * qz)) * ox
                + 2.0 * (qx * qy - qw * qz) * oy
                + 2.0 * (qx * qz + qw * qy) * oz
            )
            y -= (
                2.0 * (qx * qy + qw * qz) * ox
                + (1.0 - 2.0 * (qx * qx + qz * qz)) * oy
                + 2.0 * (qy * qz - qw * qx) * oz
            )
        out[i, 0], out[i, 1] = x, y
        out[i, 2] = math.pi - (math.pi - yaw) % (2.0 * math.pi)
    return out


@njit(cache=True)
def body_twists(raw: Array, pose: Array, offset: Array, holonomic: IntArray) -> Array:
    """Convert map velocities of inertial frames to twists ``(N, 3)`` of the robot frames."""
    out = np.zeros((len(raw), 3))
    for i in range(len(raw)):
        c, s = math.cos(pose[i, 2]), math.sin(pose[i, 2])
        turn = raw[i, 2]
        out[i, 0] = c * raw[i, 0] + s * raw[i, 1]
        out[i, 1] = -s * raw[i, 0] + c * raw[i, 1]
        out[i, 2] = turn
        if holonomic[i] == 0:
            out[i, 0] += turn * offset[i, 1]
            out[i, 1] -= turn * offset[i, 0]
    return out
