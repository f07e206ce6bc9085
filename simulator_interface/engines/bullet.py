"""The physics engine: PyBullet, one fresh client per episode, no saved states.

How it is tuned, and why contact with people is handled the way it is: ``docs/engine.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Actuation
from simulator_interface.engines.bodies import check_start_footprints, gather_fleet, outside
from simulator_interface.engines.bullet_client import GHOST, ROBOT, SOLID, BulletClient, pybullet
from simulator_interface.engines.bullet_people import BulletPeople
from simulator_interface.engines.bullet_robots import BulletRobots
from simulator_interface.engines.bullet_substeps import (
    Bases,
    SubStep,
    fill_observed,
    fill_prepared,
    nothing_prepared,
)
from simulator_interface.engines.rays import ray_directions
from simulator_interface.engines.sensing import Observer, RayOptions, Surroundings
from simulator_interface.engines.substeps import count_substeps
from simulator_interface.staging import Stage

NEAR_CONTACT = 0.02  # m; contact points are asked for below this gap
RAY_HEIGHT = 0.2  # m, at which Bullet's own rays leave a robot
GHOST_HEIGHT = 0.5  # m, of the solids that stand for parked robots in Bullet's own rays


class BulletEngine:
    """Wheeled robots on a floor with solids and people."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Tuned by ``benchmarks/engine/tune.py``."""

        step_size: float = quantity(above=0.0, high=0.05, unit="s", default=0.0125)
        solver_iterations: int = quantity(low=1, high=1000, default=8)
        contact_margin: float = quantity(
            above=0.0, high=0.05, unit="m", default=0.001
        )  #: contact points farther apart are dropped
        gui: bool = False
        rays: Literal["exact", "bullet"] = "exact"
        ray_count: int = quantity(low=1, high=360, default=12)
        ray_range: float = quantity(above=0.0, unit="m", default=10.0)

    def __init__(self, options: Options) -> None:
        self._options = options
        self._client: BulletClient | None = None

    # --- start ---------------------------------------------------------------------------

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
        self._pose = self._robots.read_pose()
        self._around.update(0.0, self._is_taken)
        self._observer.begin_tick()
        self._observer.observe(self._pose, self._human)
        self._note_changes()
        return self._sense(np.zeros_like(self._human))

    def _connect(self) -> BulletClient:
        options = self._options
        return BulletClient(
            step=self._step,
            iterations=options.solver_iterations,
            contact_margin=options.contact_margin,
            gui=options.gui,
        )

    def _build(self, world: World) -> None:
        """Fill a new client; the order of the bodies is part of what makes runs repeatable."""
        self.close()
        self._client = client = self._connect()
        client.add_floor()
        self._build_solids(world)
        self._robots = BulletRobots(client, self._fleet, world)
        self._people = BulletPeople(
            client, world, self._robots, self._fleet, self._observer, self._around
        )
        self._pieces = [
            client.add_piece(piece.outline, piece.item.height) for piece in self._around.pieces
        ]
        client.column.update(dict.fromkeys(self._pieces, gaps.STATIC))
        self._place_pieces()
        self._blocks: dict[int, int] = {}  # blockage number -> body
        actuation, holonomic = self._actuation, self._fleet.holonomic
        self._bases = Bases(actuation.motors, actuation.loss, self._robots.wheels, holonomic)
        self._prepared = nothing_prepared(len(world.robots), len(world.humans))

    def _build_solids(self, world: World) -> None:
        polygons = world.solid_polygons()
        if polygons:
            heights = [wall.height for wall in world.walls]
            heights += [item.height for item in world.furniture if not item.movable]
            self.client.column[self.client.add_solid(polygons, heights)] = gaps.STATIC

    @property
    def client(self) -> BulletClient:
        """The connection to Bullet, from the start to the end of an episode."""
        assert self._client is not None, "the engine has not been started"
        return self._client

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
        self._robots.put(robot, x, y)
        self._pose = self._robots.read_pose()
        self._observer.observe(self._pose, self._human)

    def shift(self, offset: Array) -> None:
        """See :class:`simulator_interface.staging.ShiftingEngine`."""
        self._robots.shift(offset)
        self._pose = self._robots.read_pose()
        self._observer.observe(self._pose, self._human)

    def _place_pieces(self) -> None:
        """Put movable furniture where people have pushed it."""
        poses = self._around.furniture_pose.tolist()
        for body, (x, y, turn) in zip(self._pieces, poses, strict=True):
            turned = (0.0, 0.0, math.sin(turn / 2.0), math.cos(turn / 2.0))
            self.client.place(body, (x, y, 0.0), turned)

    def _note_changes(self) -> None:
        """Take in the blockages that stand and the people who are present."""
        standing = self._around.standing
        for number in sorted(set(self._blocks) - set(standing)):
            self.client.remove(self._blocks.pop(number))
        for number in sorted(set(standing) - set(self._blocks)):
            event = self._around.blockages[number]
            body = self.client.add_solid([event.polygon], [event.height])
            self._blocks[number] = body
            self.client.column[body] = gaps.STATIC
        self._people.note_arrivals(self._human)

    def _things(self) -> gaps.Obstructions:
        """Gather what a robot may run into now."""
        around = self._around
        return gaps.Obstructions(self._observer.prints, around.solids, around.people(self._human))

    def _is_taken(self, polygon: Array) -> bool:
        velocity = self._robots.read_velocity(self._pose)
        return self._observer.is_taken(polygon, self._pose, velocity, self._human)

    # --- step ----------------------------------------------------------------------------

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`."""
        around, observer = self._around, self._observer
        self._actuation.begin_tick(self._dt)
        observer.begin_tick()
        prepared, walked_from = self._prepared, self._human.copy()
        prepared.touched[:] = False
        things = self._things()
        for k in range(self._substeps):
            time = (self._tick + k / self._substeps) * self._dt
            if not around.is_settled(time) and around.update(time, self._is_taken):
                self._note_changes()
                things = self._things()
            step = SubStep(time, self._step, self._actuation.count)
            self._actuation.count += 1
            are_near = fill_prepared(
                step, command.twist, human_velocity, self._pose, self._bases, things, prepared
            )
            self._robots.drive(prepared.targets)
            if are_near:
                self._people.place(self._human, prepared)
            if self._people.overlaps:
                self._people.release_overlaps(self._human)
            pybullet.stepSimulation(self.client.number)
            raw, inertial = self._robots.read_raw(), self._robots.inertial
            least = fill_observed(raw, inertial, self._pose, things, observer.gap, observer.nearest)
            if least <= NEAR_CONTACT:
                near = np.flatnonzero(observer.gap.min(axis=1) <= NEAR_CONTACT)
                self._robots.fill_contact(near, observer.contact)
        observer.contact[:, gaps.HUMAN] |= prepared.touched
        self._tick += 1
        if around.update(self._tick * self._dt, self._is_taken):
            self._note_changes()
        return self._sense((self._human - walked_from) / self._dt)

    # --- sense ---------------------------------------------------------------------------

    def _sense(self, human_velocity: Array) -> Sensed:
        time = self._tick * self._dt
        velocity = self._robots.read_velocity(self._pose)
        self._robots.update_brakes(velocity, self._actuation.motors.set_point, self._dt)
        if self._options.rays == "bullet":
            parked = self._observer.parked(self._pose, time)
            distances = self._bullet_distances(np.flatnonzero(parked))
        else:
            distances = self._observer.exact_distances(self._pose, time)
        return self._observer.sensed(
            tick=self._tick,
            time=time,
            pose=self._pose.copy(),
            velocity=velocity,
            human_position=self._human.copy(),
            human_velocity=human_velocity,
            distances=distances,
        )

    def _bullet_distances(self, parked: IntArray) -> Array:
        """Distances ``(N, A)`` [m] by Bullet's own rays; no robot meets its own ghost.

        A ghost is a solid on the footprint of a parked robot, there for these rays only.
        """
        options, client, corners = self._options, self.client, self._fleet.corners
        out = np.full((len(self._pose), options.ray_count), np.inf)
        directions = ray_directions(self._observer.aimed(self._pose)[:, 2], options.ray_count)
        ghosts = {
            int(i): client.add_solid([self._observer.placed[i, : corners[i]]], [GHOST_HEIGHT])
            for i in parked
        }
        for ghost in ghosts.values():
            client.collide(ghost, -1, GHOST, ROBOT)
        for i, pose in enumerate(self._pose):
            if i in ghosts:
                client.collide(ghosts[i], -1, 0, 0)
            out[i] = self._cast(pose[:2], directions[i])
            if i in ghosts:
                client.collide(ghosts[i], -1, GHOST, ROBOT)
        for ghost in ghosts.values():
            client.remove(ghost)
        return out

    def _cast(self, place: Array, directions: Array) -> Array:
        """Distances ``(A,)`` [m] from ``place`` ``(2,)`` along unit vectors ``(A, 2)``."""
        options = self._options
        origin = np.array([*place, RAY_HEIGHT])
        ends = origin + options.ray_range * np.pad(directions, ((0, 0), (0, 1)))
        hits = pybullet.rayTestBatch(
            [origin.tolist()] * options.ray_count,
            ends.tolist(),
            numThreads=1,
            collisionFilterMask=SOLID | GHOST,
            **self.client.call,
        )
        return np.array([hit[2] * options.ray_range if hit[0] >= 0 else np.inf for hit in hits])

    # --- end -----------------------------------------------------------------------------

    def close(self) -> None:
        """Disconnect the client."""
        if self._client is not None:
            self._client.close()
            self._client = None
