"""The second physics engine: MuJoCo, one fresh model per episode.

Bases are driven by forces that reach the set point within a sub-step, as far as motors and wheels
can. How it compares with PyBullet: ``docs/engine.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.world import World
from simulator_interface.engines.actuation import move_set_points
from simulator_interface.engines.mujoco_bodies import MujocoBodies
from simulator_interface.engines.overlaps import Overlaps
from simulator_interface.engines.pedestrians import move_people
from simulator_interface.engines.physics import PhysicsEngine
from simulator_interface.engines.planar_drive import driving_forces, gather_bases


class MujocoEngine(PhysicsEngine):
    """Rigid bases on a floor with solids and people."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Accuracy and sensing."""

        step_size: float = quantity(above=0.0, high=0.05, unit="s", default=0.0125)
        solver_iterations: int = quantity(low=1, high=1000, default=20)
        ray_count: int = quantity(low=1, high=360, default=12)
        ray_range: float = quantity(above=0.0, unit="m", default=10.0)

    def _build(self, world: World) -> None:
        self._bases, self._masses = gather_bases(self._fleet)
        self._bodies: MujocoBodies | None = self._new_bodies(world)
        poses = np.array([robot.pose for robot in world.robots])
        self.bodies.data.qpos[:] = poses.ravel()
        self._overlaps = Overlaps(self._fleet, self._observer, self._around, self._collide)
        self._place_pieces()
        self._place_people()

    def _new_bodies(self, world: World) -> MujocoBodies:
        options = self._options
        return MujocoBodies(
            world, self._fleet, self._masses, self._around, self._step, options.solver_iterations
        )

    @property
    def bodies(self) -> MujocoBodies:
        """The model and its state, from the start to the end of an episode."""
        assert self._bodies is not None, "the engine has not been started"
        return self._bodies

    # --- bodies --------------------------------------------------------------------------

    def _read_pose(self) -> Array:
        pose: Array = self.bodies.data.qpos.reshape(-1, 3).copy()
        pose[:, 2] = np.pi - (np.pi - pose[:, 2]) % (2.0 * np.pi)
        return pose

    def _read_velocity(self) -> Array:
        raw, yaw = self.bodies.data.qvel.reshape(-1, 3), self._pose[:, 2]
        c, s = np.cos(yaw), np.sin(yaw)
        forward, left = c * raw[:, 0] + s * raw[:, 1], c * raw[:, 1] - s * raw[:, 0]
        return np.column_stack([forward, left, raw[:, 2]])

    def _run_substep(
        self, command: Array, human_velocity: Array, time: float, touched: BoolArray
    ) -> float:
        actuation, observer, around = self._actuation, self._observer, self._around
        move_set_points(command, time, actuation.motors, actuation.count)
        set_point, velocity = actuation.motors.set_point, self.bodies.data.qvel.reshape(-1, 3)
        forces = driving_forces(
            set_point, actuation.loss, self._pose, velocity, self._bases, self._step
        )
        people, solids, pose = around.people(self._human), around.solids, self._pose
        move_people(people, human_velocity, self._step, pose, observer.prints, solids, touched)
        self._place_people()
        self.bodies.advance(forces)
        self._pose = self._read_pose()
        return observer.observe(self._pose, self._human)

    def _place_people(self) -> None:
        self.bodies.place_people(self._human)
        if self._overlaps.pairs:
            self._overlaps.release(self._human)

    def _fill_contact(self, robots: IntArray, contact: BoolArray) -> None:
        self.bodies.fill_contact(contact)

    def _collide(self, robot: int, human: int, enable: bool) -> None:
        self.bodies.collide(robot, human, enable)

    def _put(self, robot: int, x: float, y: float) -> None:
        data = self.bodies.data
        data.qpos.reshape(-1, 3)[robot] = x, y, 0.0
        data.qvel.reshape(-1, 3)[robot] = 0.0

    def _shift(self, offset: Array) -> None:
        self.bodies.data.qpos.reshape(-1, 3)[:, :2] += offset

    def _place_pieces(self) -> None:
        self.bodies.place_pieces()

    def _note_changes(self) -> None:
        if len(self._around.blockages) > self.bodies.blockages:  # people put something down
            before, self._bodies = self.bodies, self._new_bodies(self._around.world)
            self._bodies.take_state(before)
        self.bodies.note_blockages()
        self._overlaps.note_arrivals(self._human)

    # --- end -----------------------------------------------------------------------------

    def close(self) -> None:
        """Let go of the model."""
        self._bodies = None
