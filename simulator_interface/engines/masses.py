"""How heavy a robot is: the inertias of its URDF, taken together as one rigid body in the plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import FormatError
from simulator_interface.engines.footprints import link_frames, origin_frame, parse_urdf


@dataclass(frozen=True, slots=True, eq=False)
class PlanarMass:
    """A rigid body that slides and turns on the floor."""

    mass: float  #: [kg]
    centre: Array  #: (2,) of mass, in the frame of the root link [m]
    inertia: float  #: about the upright axis through the centre of mass [kg m^2]


def read_mass(urdf: Path) -> PlanarMass:
    """Sum up the inertials of a URDF, all joints at zero.

    Raises:
        FormatError: not a URDF, or it has no mass.
    """
    robot = parse_urdf(urdf)
    frames = link_frames(robot, urdf)
    masses, places, inertia = [], [], 0.0
    for link in robot.findall("link"):
        inertial = link.find("inertial")
        mass = None if inertial is None else inertial.find("mass")
        if inertial is None or mass is None:
            continue
        frame = frames[link.get("name", "")] @ origin_frame(inertial)
        masses.append(float(mass.get("value", "0")))
        places.append(frame[:2, 3])
        up = frame[2, :3]  # the upright axis in the inertial's frame
        inertia += float(up @ _inertia(inertial.find("inertia")) @ up)
    total = math.fsum(masses)
    if total <= 0.0:
        raise FormatError(f"{urdf}: no link has a mass; an engine with contact needs one")
    at = np.array(places)
    centre = np.array(masses) @ at / total
    inertia += float(np.array(masses) @ ((at - centre) ** 2).sum(axis=1))
    if inertia <= 0.0:
        raise FormatError(f"{urdf}: no link has an inertia; an engine with contact needs one")
    return PlanarMass(total, centre, inertia)


def _inertia(element: object) -> Array:
    read = getattr(element, "get", lambda name, default: default)
    xx, xy, xz, yy, yz, zz = (
        float(read(name, "0")) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
