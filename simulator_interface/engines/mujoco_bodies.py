"""The bodies of a world in MuJoCo: all is seen from above, so robots slide and turn in a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.errors import ConfigError
from mrta_falsify.core.world import World
from simulator_interface.convex_parts import convex_parts
from simulator_interface.engines import gaps
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.masses import PlanarMass
from simulator_interface.engines.sensing import Surroundings

try:
    import mujoco
except ModuleNotFoundError as missing:
    raise ConfigError(
        "engine mujoco needs MuJoCo; install it in the checkout with: pip install '.[mujoco]'"
    ) from missing

# What collides: a body's type meets another's affinity. The other bits are of single people.
ROBOT, SOLID, HUMAN = 1, 2, 4
EVERYTHING = 0x7FFFFFFF
OWN_BITS = tuple(1 << k for k in range(3, 31))  #: of people who pass through a robot for now
TALL, LOW = 1.0, 0.2  # m, half heights of what stands and of robots: bodies meet at their sides
AWAY = 1e4  # m; where people wait who are not in the building
#: m; touching bodies are seen from here on, and pushed apart from 0 on
TOUCH = 1e-3
STIFF = (0.95, 0.99, 0.001, 0.5, 2.0)  # MuJoCo's solimp: hard from 1 mm on


class MujocoBodies:
    """A MuJoCo model of a world, with its state.

    Args:
        world: of the episode.
        fleet: its robots.
        masses: of the robots.
        around: what stands in it.
        step: of the solver [s].
        iterations: of the solver.
    """

    def __init__(
        self,
        world: World,
        fleet: Fleet,
        masses: Sequence[PlanarMass],
        around: Surroundings,
        step: float,
        iterations: int,
    ) -> None:
        self._around = around
        self._spec = spec = mujoco.MjSpec()
        spec.option.timestep = step
        spec.option.iterations = iterations
        spec.option.gravity = [0.0, 0.0, 0.0]
        # A state that has run away must be seen, not silently begun anew.
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        spec.memory = 1 << 26  # B
        for polygon in world.solid_polygons():
            self._add_prism(spec.worldbody, polygon, TALL, SOLID)
        self._solids = [
            self._add_prism(spec.worldbody, event.polygon, TALL, SOLID)
            for event in around.blockages
        ]
        robots = [
            self._add_robot(model.footprint, mass)
            for model, mass in zip(fleet.models, masses, strict=True)
        ]
        people = [self._add_person(human.radius) for human in world.humans]
        pieces = [self._add_piece(piece.outline) for piece in around.pieces]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.robots = np.array([geom.id for geom in robots], dtype=np.int64)  #: (N,) shapes
        self._people = np.array([geom.id for geom in people], dtype=np.int64)
        self._pieces = [int(self.model.body_mocapid[body.id]) for body in pieces]
        self._own_bit: dict[int, int] = {}  # person -> bit, while passing through a robot
        self._robot_of, self._column = self._read_kinds()

    @property
    def blockages(self) -> int:
        """How many blockages have bodies."""
        return len(self._solids)

    # --- building ------------------------------------------------------------------------

    def _add_prism(self, body: Any, outline: Array, half: float, kind: int) -> list[Any]:
        """Add upright shapes over an outline ``(V, 2)`` [m] to a body."""
        shapes = []
        for part in convex_parts(outline):
            name = f"prism{len(self._spec.meshes)}"
            corners = [np.column_stack([part, np.full(len(part), z)]) for z in (-half, half)]
            mesh = self._spec.add_mesh(name=name)
            mesh.uservert = np.concatenate(corners).ravel()
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            shapes.append(
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=name,
                    contype=kind,
                    conaffinity=EVERYTHING if kind == ROBOT else 0,
                    condim=1,  # without friction, as wheels do not climb walls
                    gap=TOUCH,
                    solimp=STIFF,
                )
            )
        return shapes

    def _add_robot(self, footprint: Array, mass: PlanarMass) -> Any:
        body = self._spec.worldbody.add_body()
        for axis in ([1, 0, 0], [0, 1, 0]):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        body.explicitinertial = True
        body.mass = mass.mass
        body.ipos = [*mass.centre, 0.0]
        body.inertia = [mass.inertia] * 3
        (shape,) = self._add_prism(body, footprint, LOW, ROBOT)
        return shape

    def _add_person(self, radius: float) -> Any:
        body = self._spec.worldbody.add_body(mocap=True, pos=[AWAY, AWAY, 0.0])
        return body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[radius, TALL, 0.0],
            contype=HUMAN,
            conaffinity=0,
            condim=1,
            gap=TOUCH,
            solimp=STIFF,
        )

    def _add_piece(self, outline: Array) -> Any:
        body = self._spec.worldbody.add_body(mocap=True)
        self._add_prism(body, outline, TALL, SOLID)
        return body

    def _read_kinds(self) -> tuple[IntArray, IntArray]:
        """Tell of each shape which robot it is (-1: none) and its column of contacts."""
        robot_of = np.full(self.model.ngeom, -1, dtype=np.int64)
        column = np.full(self.model.ngeom, gaps.STATIC, dtype=np.int64)
        robot_of[self.robots] = np.arange(len(self.robots))
        column[self.robots] = gaps.ROBOT
        column[self._people] = gaps.HUMAN
        return robot_of, column

    # --- between sub-steps ---------------------------------------------------------------

    def place_people(self, human: Array) -> None:
        """Put people at ``human`` ``(H, 2)`` [m]; those who are not present stand far away."""
        if len(human):
            present = self._around.present[:, None]
            self.data.mocap_pos[: len(human), :2] = np.where(present, human, AWAY)

    def place_pieces(self) -> None:
        """Put movable furniture where people have pushed it."""
        for mocap, (x, y, turn) in zip(
            self._pieces, self._around.furniture_pose.tolist(), strict=True
        ):
            self.data.mocap_pos[mocap] = x, y, 0.0
            self.data.mocap_quat[mocap] = math.cos(turn / 2.0), 0.0, 0.0, math.sin(turn / 2.0)

    def note_blockages(self) -> None:
        """Let the blockages that stand collide, and no other."""
        standing = set(self._around.standing)
        for number, shapes in enumerate(self._solids):
            for shape in shapes:
                self.model.geom_contype[shape.id] = SOLID if number in standing else 0

    def collide(self, robot: int, human: int, enable: bool) -> None:
        """Let a robot and a person collide, or pass through each other."""
        shape, person = self.robots[robot], self._people[human]
        if not enable:
            free = (bit for bit in OWN_BITS if bit not in self._own_bit.values())
            bit = self._own_bit.setdefault(human, next(free, OWN_BITS[-1]))
            self.model.geom_contype[person] = bit
            self.model.geom_conaffinity[shape] &= ~bit
            return
        bit = self._own_bit[human]
        self.model.geom_conaffinity[shape] |= bit
        if all(self.model.geom_conaffinity[self.robots] & bit):
            del self._own_bit[human]
            self.model.geom_contype[person] = HUMAN

    def take_state(self, other: MujocoBodies) -> None:
        """Go on where ``other``, of the same robots and people, has come to."""
        for name in ("qpos", "qvel", "qacc_warmstart", "mocap_pos", "mocap_quat"):
            getattr(self.data, name)[:] = getattr(other.data, name)
        for shapes in ("robots", "_people"):
            mine, theirs = getattr(self, shapes), getattr(other, shapes)
            self.model.geom_contype[mine] = other.model.geom_contype[theirs]
            self.model.geom_conaffinity[mine] = other.model.geom_conaffinity[theirs]
        self._own_bit = other._own_bit
        self.data.time = other.data.time

    def advance(self, forces: Array) -> None:
        """Solve one sub-step under ``forces`` ``(N, 3)`` [N, N, N m]."""
        self.data.qfrc_applied[:] = forces.ravel()
        mujoco.mj_step(self.model, self.data)

    def fill_contact(self, contact: BoolArray) -> None:
        """Mark what robots touch in ``contact`` ``(N, 3)`` (robot, human, static)."""
        if not self.data.ncon:
            return
        near = np.asarray(self.data.contact.dist) <= TOUCH
        for one, other in np.asarray(self.data.contact.geom)[near].tolist():
            for a, b in ((one, other), (other, one)):
                if self._robot_of[a] >= 0:
                    contact[self._robot_of[a], self._column[b]] = True
