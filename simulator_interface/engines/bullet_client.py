"""A PyBullet client, and the bodies that stand in it: floor, solids, furniture, people."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.errors import ConfigError
from simulator_interface.engines.rays import next_corners


@contextlib.contextmanager
def native_output_muted() -> Iterator[None]:
    """Discard what C code writes to the standard streams meanwhile."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [(number, os.dup(number)) for number in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number, _ in kept:
            os.dup2(nowhere, number)
        yield
    finally:
        for number, copy in kept:
            os.dup2(copy, number)
            os.close(copy)
        os.close(nowhere)


try:
    with native_output_muted():  # importing it prints a greeting
        import pybullet as pybullet  # noqa: PLC0414 - the other modules import it from here
except ModuleNotFoundError as missing:
    raise ConfigError(
        "engine bullet needs PyBullet, which has wheels for Linux x86-64 with Python 3.11 only; "
        "take --set engine=mujoco, or install it in the checkout with: pip install '.[bullet]'"
    ) from missing

# Collision groups; ROBOT is also the group that Bullet gives to its rays.
ROBOT, SOLID, FLOOR, WHEEL, HUMAN, GHOST = 1, 2, 64, 128, 256, 512
AWAY = -50.0  # m; height at which bodies wait that are not in the building
BODY_HEIGHT = 1.7  # m, people
CAPSULE_DEPTH = 0.3  # m; the round lower end of a person is below the floor
LEAST_BARREL = 0.1  # m; a person wider than high is still a capsule
SOLID_DEPTH = 0.1  # m; solids begin below the floor
LEAST_HEIGHT = 0.3  # m; even a low obstacle stops a robot
NO_TURN = (0.0, 0.0, 0.0, 1.0)  # quaternion x, y, z, w


class BulletClient:
    """A connection to Bullet with a world of its own.

    Args:
        step: length of a sub-step [s].
        iterations: of the constraint solver.
        contact_margin: contact points farther apart than this are dropped [m].
        gui: open Bullet's window.

    Raises:
        ConfigError: ``gui`` is set without a display.
    """

    def __init__(self, *, step: float, iterations: int, contact_margin: float, gui: bool) -> None:
        if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
            raise ConfigError(
                "engine.gui is true, but there is no display; set DISPLAY, or gui: false"
            )
        self._gui = gui
        self.number: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
        self.call = {"physicsClientId": self.number}  #: last arguments of every call
        self.column: dict[int, int] = {}  #: body -> column of ``Sensed.contact``
        pybullet.setGravity(0.0, 0.0, -9.81, **self.call)
        # The contact margin is a global of the Bullet library: set it for every client.
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=step,
            numSolverIterations=iterations,
            contactBreakingThreshold=contact_margin,
            deterministicOverlappingPairs=1,
            **self.call,
        )

    def close(self) -> None:
        """Disconnect; the client cannot be used afterwards."""
        with contextlib.suppress(pybullet.error):  # the user may have closed the window
            pybullet.disconnect(physicsClientId=self.number)

    def collide(self, body: int, link: int, group: int, mask: int) -> None:
        """Put a link into a collision ``group``; it meets the groups in ``mask``."""
        pybullet.setCollisionFilterGroupMask(body, link, group, mask, **self.call)

    def place(self, body: int, position: tuple[float, ...], turn: tuple[float, ...]) -> None:
        """Put a body at a position [m] with a turn (quaternion x, y, z, w)."""
        pybullet.resetBasePositionAndOrientation(body, position, turn, self.number)

    def remove(self, body: int) -> None:
        """Take a body out of the world."""
        self.column.pop(body, None)
        pybullet.removeBody(body, **self.call)

    def add_floor(self) -> None:
        """Add the endless level floor at height 0."""
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **self.call)
        # Bullet would draw the endless plane, which takes 10 ms even without a window.
        drawn = -1
        if not self._gui:
            drawn = pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=0.01, **self.call)
        floor = pybullet.createMultiBody(0.0, plane, drawn, useMaximalCoordinates=1, **self.call)
        pybullet.changeDynamics(floor, -1, lateralFriction=1.0, restitution=0.0, **self.call)
        self.collide(floor, -1, FLOOR, ROBOT | WHEEL)

    def add_solid(self, polygons: Sequence[Array], heights: Sequence[float]) -> int:
        """Add one body for the upright sides of all ``polygons``; one is faster than many.

        Args:
            polygons: outlines ``(V, 2)`` [m].
            heights: of their upper edges [m].
        """
        vertices, indices = side_faces(polygons, heights)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices.tolist(),
            indices=indices.tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            **self.call,
        )
        return self._add_body(shape, SOLID)

    def add_piece(self, outline: Array, height: float) -> int:
        """Add movable furniture: the convex body over an outline ``(V, 2)`` [m]."""
        vertices, _ = side_faces([outline], [height])
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=vertices.tolist(), **self.call
        )
        return self._add_body(shape, SOLID)

    def add_person(self, radius: float) -> int:
        """Add a person, a capsule of ``radius`` [m] that waits outside the building."""
        length = max(BODY_HEIGHT + CAPSULE_DEPTH - 2.0 * radius, LEAST_BARREL)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_CAPSULE, radius=radius, height=length, **self.call
        )
        return self._add_body(shape, HUMAN, basePosition=[0, 0, AWAY])

    def _add_body(self, shape: int, group: int, **where: list[int | float]) -> int:
        """Add a body that robots alone run into."""
        body: int = pybullet.createMultiBody(
            0.0, shape, useMaximalCoordinates=1, **where, **self.call
        )
        # Without friction a wheel cannot climb a wall.
        pybullet.changeDynamics(body, -1, lateralFriction=0.0, restitution=0.0, **self.call)
        self.collide(body, -1, group, ROBOT)
        return body


def side_faces(polygons: Sequence[Array], heights: Sequence[float]) -> tuple[Array, IntArray]:
    """List the triangles of the upright sides of extruded polygons.

    Args:
        polygons: outlines ``(V, 2)`` [m].
        heights: of their upper edges [m].

    Returns:
        Vertices ``(P, 3)`` [m] and flat vertex numbers ``(3 T,)``.
    """
    points = np.concatenate(polygons)
    tops = np.repeat(np.maximum(heights, LEAST_HEIGHT), [len(polygon) for polygon in polygons])
    low = np.column_stack([points, np.full(len(points), -SOLID_DEPTH)])
    high = np.column_stack([points, tops])
    a, b, n = np.arange(len(points)), next_corners(polygons), len(points)
    faces = np.stack([a, b, b + n, a, b + n, a + n], axis=1)
    return np.concatenate([low, high]), faces.ravel()
