"""The physics engine: PyBullet, one fresh client per episode, no saved states.

How it is tuned, and why contact with people is handled the way it is: ``docs/engine.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.bullet_client import (
    AWAY,
    BODY_HEIGHT,
    CAPSULE_DEPTH,
    GHOST,
    NO_TURN,
    ROBOT,
    SOLID,
    BulletClient,
    pybullet,
)
from simulator_interface.engines.bullet_robots import BulletRobots
from simulator_interface.engines.bullet_substeps import (
    Bases,
    Prepared,
    SubStep,
    fill_observed,
    fill_prepared,
    nothing_prepared,
)
from simulator_interface.engines.overlaps import Overlaps
from simulator_interface.engines.physics import PhysicsEngine
from simulator_interface.engines.rays import ray_directions
from simulator_interface.engines.sensing import Observer, Surroundings


class BulletPeople:
    """The people of a world in a client."""

    def __init__(
        self,
        client: BulletClient,
        world: World,
        robots: BulletRobots,
        fleet: Fleet,
        observer: Observer,
        around: Surroundings,
    ) -> None:
        self._client = client
        self._robots = robots
        self._fleet = fleet
        self._around = around
        self._bodies = [client.add_person(human.radius) for human in world.humans]
        client.column.update(dict.fromkeys(self._bodies, gaps.HUMAN))
        self.overlaps = Overlaps(fleet, observer, around, self._collide)

    def place(self, human: Array, prepared: Prepared) -> None:
        """Put people at ``human`` ``(H, 2)`` [m].

        Only people near a robot stand in Bullet's world: to move all of them costs too much.
        """
        near, was_in = prepared.near, prepared.was_in
        for h in (near | was_in).nonzero()[0].tolist():
            z = 0.5 * (BODY_HEIGHT - CAPSULE_DEPTH) if near[h] else AWAY
            x, y = human[h].tolist()
            self._client.place(self._bodies[h], (x, y, z), NO_TURN)
        was_in[:] = near

    def _collide(self, robot: int, human: int, enable: bool) -> None:
        self._robots.collide_with(robot, self._bodies[human], enable=enable)


RAY_HEIGHT = 0.2  # m, at which Bullet's own rays leave a robot
GHOST_HEIGHT = 0.5  # m, of the solids that stand for parked robots in Bullet's own rays


class BulletEngine(PhysicsEngine):
    """Wheeled robots on a floor with solids and people."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Tuned by ``experiments/engine/tune.py``."""

        step_size: float = quantity(above=0.0, high=0.05, unit="s", default=0.0125)
        solver_iterations: int = quantity(low=1, high=1000, default=8)
        contact_margin: float = quantity(
            above=0.0, high=0.05, unit="m", default=0.001
        )  #: contact points farther apart are dropped
        gui: bool = False  #: open a window
        rays: Literal["exact", "bullet"] = "exact"
        ray_count: int = quantity(low=1, high=360, default=12)
        ray_range: float = quantity(above=0.0, unit="m", default=10.0)

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self._client: BulletClient | None = None

    # --- start ---------------------------------------------------------------------------

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

    # --- bodies --------------------------------------------------------------------------

    def _read_pose(self) -> Array:
        return self._robots.read_pose()

    def _read_velocity(self) -> Array:
        return self._robots.read_velocity(self._pose)

    def _begin_tick(self) -> None:
        self._gather_things()

    def _gather_things(self) -> None:
        """Gather what a robot may run into now."""
        around, prints = self._around, self._observer.prints
        self._things = gaps.packed(prints, around.solids, around.people(self._human))

    def _run_substep(
        self, command: Array, human_velocity: Array, time: float, touched: BoolArray
    ) -> float:
        prepared, things, observer = self._prepared, self._things, self._observer
        step = SubStep(time, self._step, self._actuation.count)
        are_near = fill_prepared(
            step, command, human_velocity, self._pose, self._bases, things, prepared, touched
        )
        self._robots.drive(prepared.targets)
        if are_near:
            self._people.place(self._human, prepared)
        if self._people.overlaps.pairs:
            self._people.overlaps.release(self._human)
        pybullet.stepSimulation(self.client.number)
        raw, inertial = self._robots.read_raw(), self._robots.inertial
        return fill_observed(raw, inertial, self._pose, things, observer.gap, observer.nearest)

    def _fill_contact(self, robots: IntArray, contact: BoolArray) -> None:
        self._robots.fill_contact(robots, contact)

    def _put(self, robot: int, x: float, y: float) -> None:
        self._robots.put(robot, x, y)

    def _shift(self, offset: Array) -> None:
        self._robots.shift(offset)

    def _end_tick(self, velocity: Array) -> None:
        self._robots.update_brakes(velocity, self._actuation.motors.set_point, self._dt)

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
        self._people.overlaps.note_arrivals(self._human)
        self._gather_things()

    # --- sense ---------------------------------------------------------------------------

    def _distances(self, time: float) -> Array:
        if self._options.rays == "bullet":
            parked = self._observer.parked(self._pose, time)
            return self._bullet_distances(np.flatnonzero(parked))
        return super()._distances(time)

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
