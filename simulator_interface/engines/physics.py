"""What engines with contact physics share: a tick, in sub-steps, around a solver of bodies.

A solver carries the bodies; everything that is measured, and how people step, is the same for all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Actuation
from simulator_interface.engines.bodies import check_start_footprints, gather_fleet, outside
from simulator_interface.engines.sensing import Observer, RayOptions, Surroundings
from simulator_interface.engines.substeps import count_substeps
from simulator_interface.staging import Stage

NEAR_CONTACT = 0.02  # m; contact points are asked for below this gap


class PhysicsEngine(ABC):
    """Robots that motors drive among solids and people; a subclass brings the solver.

    Args:
        options: with ``step_size`` [s], ``ray_count`` and ``ray_range`` [m].
    """

    def __init__(self, options: Any) -> None:
        self._options = options

    # --- what a solver brings ------------------------------------------------------------

    @abstractmethod
    def _build(self, world: World) -> None:
        """Fill a new solver; the order of the bodies is part of what makes runs repeatable."""

    @abstractmethod
    def _read_pose(self) -> Array:
        """Read poses ``(N, 3)`` x, y [m], yaw [rad]."""

    @abstractmethod
    def _read_velocity(self) -> Array:
        """Read body twists ``(N, 3)`` forward, left [m/s], turn [rad/s]."""

    @abstractmethod
    def _run_substep(
        self, command: Array, human_velocity: Array, time: float, touched: BoolArray
    ) -> float:
        """Move motors and people, solve, and measure; gives the least gap of any robot [m].

        Args:
            command: ``(N, 3)`` body twists.
            human_velocity: ``(H, 2)`` [m/s].
            time: when the sub-step begins [s].
            touched: ``(N,)`` set for robots that held up a person.
        """

    @abstractmethod
    def _fill_contact(self, robots: IntArray, contact: BoolArray) -> None:
        """Mark what ``robots`` touch in ``contact`` ``(N, 3)`` (robot, human, static)."""

    @abstractmethod
    def _place_pieces(self) -> None:
        """Put movable furniture where people have pushed it."""

    @abstractmethod
    def _note_changes(self) -> None:
        """Take in the blockages that stand and the people who are present."""

    @abstractmethod
    def _put(self, robot: int, x: float, y: float) -> None:
        """Put a robot at (x, y) [m], at rest."""

    @abstractmethod
    def _shift(self, offset: Array) -> None:
        """Move robots by ``offset`` ``(N, 2)`` [m]."""

    @abstractmethod
    def close(self) -> None:
        """Free everything; may be called twice."""

    def _begin_tick(self) -> None:  # noqa: B027 - most need nothing
        """Prepare for the sub-steps of a tick."""

    def _end_tick(self, velocity: Array) -> None:  # noqa: B027 - most need nothing
        """Take in the twists ``(N, 3)`` at the end of a tick."""

    def _distances(self, time: float) -> Array:
        """Distances ``(N, A)`` [m] to what the rays hit, inf: nothing."""
        return self._observer.exact_distances(self._pose, time)

    # --- an episode ----------------------------------------------------------------------

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`.

        Raises:
            WorldError: a robot's start is taken.
            UnknownNameError: unknown robot model.
            InputError: a model's URDF cannot be used.
        """
        check_start_footprints(world)
        options = self._options
        self._fleet = gather_fleet(world.robots)
        self._dt = dt
        self._substeps = count_substeps(dt, options.step_size)
        self._step = dt / self._substeps
        self._actuation = Actuation(self._fleet, world.robots, world.seed, self._step)
        self._around = Surroundings(world)
        rays = RayOptions(count=options.ray_count, max_range=options.ray_range)
        self._observer = Observer(self._fleet, self._around, rays)
        self._human = np.array(human_position, dtype=np.float64).reshape(len(world.humans), 2)
        self._tick = 0
        self._build(world)
        self._pose = self._read_pose()
        self._around.update(0.0, self._is_taken)
        self._observer.begin_tick()
        self._observer.observe(self._pose, self._human)
        self._note_changes()
        return self._sense(np.zeros_like(self._human))

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`."""
        around, observer = self._around, self._observer
        self._actuation.begin_tick(self._dt)
        observer.begin_tick()
        self._begin_tick()
        walked_from = self._human.copy()
        touched = np.zeros(len(self._pose), dtype=np.bool_)
        for k in range(self._substeps):
            time = (self._tick + k / self._substeps) * self._dt
            if not around.is_settled(time) and around.update(time, self._is_taken):
                self._note_changes()
            least = self._run_substep(command.twist, human_velocity, time, touched)
            self._actuation.count += 1
            if least <= NEAR_CONTACT:
                near = np.flatnonzero(observer.gap.min(axis=1) <= NEAR_CONTACT)
                self._fill_contact(near, observer.contact)
        observer.contact[:, gaps.HUMAN] |= touched
        self._tick += 1
        if around.update(self._tick * self._dt, self._is_taken):
            self._note_changes()
        return self._sense((self._human - walked_from) / self._dt)

    def _sense(self, human_velocity: Array) -> Sensed:
        time = self._tick * self._dt
        velocity = self._read_velocity()
        self._end_tick(velocity)
        return self._observer.sensed(
            tick=self._tick,
            time=time,
            pose=self._pose.copy(),
            velocity=velocity,
            human_position=self._human.copy(),
            human_velocity=human_velocity,
            distances=self._distances(time),
        )

    # --- between steps -------------------------------------------------------------------

    def arrange(self, stage: Stage) -> None:
        """See :class:`simulator_interface.staging.StagedEngine`."""
        moved = np.isfinite(stage.placed[:, 0])
        self._human[moved] = stage.placed[moved]
        self._around.arrange(stage, self._tick * self._dt, self._is_taken)
        self._place_pieces()
        self._note_changes()

    def forget_after(self, time: float) -> None:
        """See :class:`simulator_interface.staging.ForgettingPart`."""
        self._around.forget_after(time)

    def remove(self, robot: int) -> None:
        """See :class:`simulator_interface.staging.RemovingEngine`."""
        x, y, _ = outside(self._around.world, robot)
        self._put(robot, x, y)
        self._look_again()

    def shift(self, offset: Array) -> None:
        """See :class:`simulator_interface.staging.ShiftingEngine`."""
        self._shift(offset)
        self._look_again()

    def _look_again(self) -> None:
        self._pose = self._read_pose()
        self._observer.observe(self._pose, self._human)

    def _is_taken(self, polygon: Array) -> bool:
        return self._observer.is_taken(polygon, self._pose, self._read_velocity(), self._human)
