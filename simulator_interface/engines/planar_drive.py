"""The forces that drive rigid bases over the floor, for solvers that have no wheels."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from simulator_interface.engines.actuation import slipping
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.masses import PlanarMass, read_mass

GRAVITY = 9.81  # m/s^2
FRICTION = 1.0  # of wheels on the floor, as in PyBullet


class Bases(NamedTuple):
    """What the motors of N bases carry, and how strong they are."""

    mass: Array  #: (N,) [kg]
    centre: Array  #: (N, 2) of mass, in the robot frame [m]
    inertia: Array  #: (N,) about the centre of mass [kg m^2]
    separation: Array  #: (N,) of the wheels [m]
    push: Array  #: (N,) most that a wheel's motor, or a slider, pushes with [N]
    twist: Array  #: (N,) most that a turntable turns with [N m]
    grip: Array  #: (N,) most that the wheels hold on the floor [N]
    holonomic: IntArray  #: (N,) 1: moves in every direction


def gather_bases(fleet: Fleet) -> tuple[Bases, tuple[PlanarMass, ...]]:
    """Gather the masses and motors of a fleet.

    Raises:
        FormatError: a URDF has no mass.
    """
    masses = tuple(read_mass(Path(model.urdf)) for model in fleet.models)
    mass = np.array([one.mass for one in masses])
    push = [
        model.max_force if model.base == "holonomic" else model.max_torque / model.wheel_radius
        for model in fleet.models
    ]
    bases = Bases(
        mass=mass,
        centre=np.array([one.centre for one in masses]).reshape(-1, 2),
        inertia=np.array([one.inertia for one in masses]),
        separation=np.array([model.wheel_separation for model in fleet.models]),
        push=np.array(push),
        twist=np.array([model.max_torque for model in fleet.models]),
        grip=FRICTION * GRAVITY * mass,
        holonomic=fleet.holonomic,
    )
    return bases, masses


@njit(cache=True)
def driving_forces(
    set_point: Array, loss: Array, pose: Array, velocity: Array, bases: Bases, step: float
) -> Array:
    """Find the forces that bring bases to their set points within a sub-step, as far as they can.

    Args:
        set_point: ``(N, 3)`` forward, left [m/s], turn [rad/s].
        loss: ``(N, 2)`` shares of speed that slip takes.
        pose: ``(N, 3)``.
        velocity: ``(N, 3)`` of the robots' origins along the map's axes [m/s], turn [rad/s].
        bases: that are driven.
        step: [s].

    Returns:
        ``(N, 3)`` force along the map's axes [N] and torque [N m] at the robots' origins.
    """
    out = np.zeros((len(pose), 3))
    for i in range(len(pose)):
        forward, left, turn = set_point[i, 0], set_point[i, 1], set_point[i, 2]
        if bases.holonomic[i] == 1:
            forward, left = forward * (1.0 - loss[i, 0]), left * (1.0 - loss[i, 0])
            turn *= 1.0 - loss[i, 1]
        else:
            forward, turn = slipping(forward, turn, bases.separation[i], loss[i])
        c, s = math.cos(pose[i, 2]), math.sin(pose[i, 2])
        m, spin = bases.mass[i], velocity[i, 2]
        ax = (c * forward - s * left - velocity[i, 0]) / step
        ay = (s * forward + c * left - velocity[i, 1]) / step
        aw = (turn - spin) / step
        # the centre of mass goes round the origin
        dx = c * bases.centre[i, 0] - s * bases.centre[i, 1]
        dy = s * bases.centre[i, 0] + c * bases.centre[i, 1]
        fx = m * (ax - dy * aw - dx * spin * spin)
        fy = m * (ay + dx * aw - dy * spin * spin)
        torque = bases.inertia[i] * aw + dx * fy - dy * fx
        push, twist = bases.push[i], bases.twist[i]
        if bases.holonomic[i] == 1:
            out[i, 0] = min(push, max(-push, fx))
            out[i, 1] = min(push, max(-push, fy))
            out[i, 2] = min(twist, max(-twist, torque))
            continue
        along, across = c * fx + s * fy, c * fy - s * fx
        right = min(push, max(-push, 0.5 * along + torque / bases.separation[i]))
        other = min(push, max(-push, 0.5 * along - torque / bases.separation[i]))
        along, torque = right + other, 0.5 * (right - other) * bases.separation[i]
        size, grip = math.sqrt(along * along + across * across), bases.grip[i]
        share = 1.0 if size <= grip else grip / size
        most = 0.5 * bases.separation[i] * grip
        out[i, 0] = share * (c * along - s * across)
        out[i, 1] = share * (s * along + c * across)
        out[i, 2] = min(most, max(-most, torque))
    return out
