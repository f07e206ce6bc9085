"""The physics engine: PyBullet, one fresh client per episode, no saved states.

How it is tuned, and why contact with people is handled the way it is: ``docs/engine.md``.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Actuation
from simulator_interface.engines.bodies import RobotModel, check_starts, gather_fleet, outside
from simulator_interface.engines.kinematic import count_substeps
from simulator_interface.engines.pedestrians import move_people
from simulator_interface.engines.rays import next_corners, ray_directions
from simulator_interface.engines.sensing import Observer, RayOptions, Surroundings
from simulator_interface.staging import Stage


@contextlib.contextmanager
def _native_output_muted() -> Iterator[None]:
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


with _native_output_muted():  # it greets everybody who imports it
    import pybullet

# collision groups; ROBOT is also the group Bullet gives to its rays
ROBOT, SOLID, FLOOR, WHEEL, HUMAN, GHOST = 1, 2, 64, 128, 256, 512
AWAY = -50.0  # m; where bodies wait that are not in the building
NEAR_PERSON = 1.0  # m between surfaces, below which a person stands in Bullet's world
NEAR_CONTACT = 0.02  # m; contact points are asked for below this gap
TOUCH = 1e-3  # m; a contact point nearer than this is a touch (Bullet reports some that are apart)
BODY_HEIGHT = 1.7  # m, people
CAPSULE_DEPTH = 0.3  # m; the round lower end of a person is below the floor
SOLID_DEPTH = 0.1  # m; solids begin below the floor
LEAST_HEIGHT = 0.3  # m; even a low obstacle stops a robot
RAY_HEIGHT = 0.2  # m
AT_REST = (0.005, 0.005, 0.02)  # m/s, m/s, rad/s; slower than this a robot counts as standing
BRAKE_AFTER = 0.2  # s of standing without a set point, then the brake holds it
CARRIED = 3  # driven joints of a holonomic base
NO_TURN = (0.0, 0.0, 0.0, 1.0)


class _Body(NamedTuple):
    """A robot in Bullet."""

    number: int  #: body
    joints: tuple[int, ...]  #: driven, in the model's order
    forces: tuple[float, ...]  #: limits of their motors [N] or [N m]


class _Overlap(NamedTuple):
    """A robot and a person who do not collide until they have come apart."""

    body: int  #: the person's
    robot: int
    human: int


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
        self._client = -1

    # --- start ---------------------------------------------------------------------------

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`.

        Raises:
            WorldError: a robot's start is taken.
            UnknownNameError: unknown robot model.
            InputError: a model's URDF cannot be used.
        """
        check_starts(world)
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
        self._connect()
        self._column: dict[int, int] = {}  # body -> column of ``contact``
        self._build_floor_and_solids(world)
        self._build_robots(world)
        self._build_people(world)
        self._build_pieces()
        self._blocks: dict[int, int] = {}  # blockage number -> body
        self._overlaps: list[_Overlap] = []
        self._pose = self._read_pose()
        self._around.update(0.0, self._is_taken)
        self._observer.begin_tick()
        self._observer.observe(self._pose, self._human)
        self._note_changes()
        return self._sense(np.zeros_like(self._human))

    def _connect(self) -> None:
        self.close()
        if self._options.gui:
            if sys.platform == "linux" and not os.environ.get("DISPLAY"):
                raise ConfigError(
                    "engine.gui is true, but there is no display; set DISPLAY, or gui: false"
                )
            self._client = pybullet.connect(pybullet.GUI)
        else:
            self._client = pybullet.connect(pybullet.DIRECT)
        self._call = {"physicsClientId": self._client}
        pybullet.setGravity(0.0, 0.0, -9.81, **self._call)
        # The contact margin is a global of the Bullet library: set it for every client.
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self._step,
            numSolverIterations=self._options.solver_iterations,
            contactBreakingThreshold=self._options.contact_margin,
            deterministicOverlappingPairs=1,
            **self._call,
        )

    def _build_floor_and_solids(self, world: World) -> None:
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **self._call)
        # Bullet would draw the endless plane, which takes 10 ms: nobody looks at a plain client.
        drawn = -1
        if not self._options.gui:
            drawn = pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=0.01, **self._call)
        floor = pybullet.createMultiBody(0.0, plane, drawn, useMaximalCoordinates=1, **self._call)
        pybullet.changeDynamics(floor, -1, lateralFriction=1.0, restitution=0.0, **self._call)
        self._sort(floor, -1, FLOOR, ROBOT | WHEEL)
        polygons = world.solid_polygons()
        heights = [wall.height for wall in world.walls]
        heights += [item.height for item in world.furniture if not item.movable]
        if polygons:
            self._column[self._add_solid(polygons, heights)] = gaps.STATIC

    def _add_solid(self, polygons: Sequence[Array], heights: Sequence[float]) -> int:
        """One body for the upright sides of all ``polygons``; one is faster than many."""
        vertices, indices = side_faces(polygons, heights)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices.tolist(),
            indices=indices.tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            **self._call,
        )
        body: int = pybullet.createMultiBody(0.0, shape, useMaximalCoordinates=1, **self._call)
        # Without friction a wheel cannot climb a wall.
        pybullet.changeDynamics(body, -1, lateralFriction=0.0, restitution=0.0, **self._call)
        self._sort(body, -1, SOLID, ROBOT)
        return body

    def _sort(self, body: int, link: int, group: int, mask: int) -> None:
        pybullet.setCollisionFilterGroupMask(body, link, group, mask, **self._call)

    def _build_robots(self, world: World) -> None:
        self._bodies: list[_Body] = []
        n = len(world.robots)
        self._offset = np.zeros((n, 3))
        self._turned = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        for i, (robot, model) in enumerate(zip(world.robots, self._fleet.models, strict=True)):
            body = self._load_robot(model, robot.pose)
            info = pybullet.getDynamicsInfo(body.number, -1, **self._call)
            self._offset[i], self._turned[i] = info[3], info[4]
            self._column[body.number] = gaps.ROBOT
            self._bodies.append(body)
        self._wheels = np.array(
            [[model.wheel_radius, model.wheel_separation] for model in self._fleet.models]
        ).reshape(n, 2)
        self._targets: list[list[float]] = [[] for _ in range(n)]
        self._standing_for = np.zeros(n)  # s
        self._is_braked = np.zeros(n, dtype=np.bool_)
        for i in range(n):
            self._brake(i, hold=False)

    def _brake(self, robot: int, *, hold: bool) -> None:
        """Hold a robot where it stands, or let it go.

        A standing robot creeps by 0.3 mm/s, as far as the solver is from convergence. Held, it
        sleeps in Bullet's sense: what runs into it wakes it, and it costs no time.
        """
        self._is_braked[robot] = hold
        state = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING + pybullet.ACTIVATION_STATE_WAKE_UP
        if hold:
            state = pybullet.ACTIVATION_STATE_ENABLE_SLEEPING + pybullet.ACTIVATION_STATE_SLEEP
        number = self._bodies[robot].number
        pybullet.changeDynamics(number, -1, activationState=state, **self._call)

    def _update_brakes(self, velocity: Array) -> None:
        """Brake who stands; who moves though it is held was pushed, and is awake already."""
        stands = (np.abs(velocity) < AT_REST).all(axis=1)
        stands &= ~self._actuation.set_point.any(axis=1)
        self._standing_for = np.where(stands, self._standing_for + self._dt, 0.0)
        pushed = self._is_braked & velocity.any(axis=1)
        for i in np.flatnonzero(pushed):
            self._brake(int(i), hold=False)
        due = (self._standing_for >= BRAKE_AFTER) & ~self._is_braked
        for i in np.flatnonzero(due & (self._fleet.holonomic == 0)):
            self._brake(int(i), hold=True)

    def _load_robot(self, model: RobotModel, pose: Array) -> _Body:
        x, y, yaw = (float(value) for value in pose)
        is_carried = model.base == "holonomic"
        where = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        if not is_carried:
            where = ([x, y, 0.0], [0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])
        try:
            with _native_output_muted():  # merging links is chatty
                number = pybullet.loadURDF(
                    model.urdf,
                    *where,
                    useFixedBase=is_carried,
                    flags=pybullet.URDF_MERGE_FIXED_LINKS + pybullet.URDF_USE_INERTIA_FROM_FILE,
                    **self._call,
                )
        except pybullet.error as error:
            raise FormatError(f"{model.urdf}: Bullet cannot load it: {error}") from None
        joints = self._joints(number, model)
        self._tune_links(number, model, joints)
        if is_carried:
            for joint, value in zip(joints, (x, y, yaw), strict=True):
                pybullet.resetJointState(number, joint, value, **self._call)
            return _Body(number, joints, (model.max_force, model.max_force, model.max_torque))
        return _Body(number, joints, (model.max_torque, model.max_torque))

    def _joints(self, number: int, model: RobotModel) -> tuple[int, ...]:
        count = pybullet.getNumJoints(number, **self._call)
        infos = [pybullet.getJointInfo(number, j, **self._call) for j in range(count)]
        known = {info[1].decode(): j for j, info in enumerate(infos)}
        for name in model.joints:
            if name not in known:
                raise UnknownNameError("joint", name, known, where=model.urdf)
            if infos[known[name]][2] not in (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC):
                raise ConfigError(f"{model.urdf}: joint {name!r} cannot be driven")
        return tuple(known[name] for name in model.joints)

    def _tune_links(self, number: int, model: RobotModel, joints: tuple[int, ...]) -> None:
        wheels = joints if model.base == "differential" else ()
        for link in range(-1, pybullet.getNumJoints(number, **self._call)):
            is_wheel = link in wheels
            pybullet.changeDynamics(
                number,
                link,
                lateralFriction=1.0 if is_wheel else 0.0,
                restitution=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                **self._call,
            )
            if is_wheel and model.wheels_touch == "floor":
                self._sort(number, link, WHEEL, FLOOR)
            else:
                self._sort(number, link, ROBOT, ROBOT | SOLID | FLOOR | HUMAN)

    def _build_people(self, world: World) -> None:
        self._people: list[int] = []
        self._is_in = np.zeros(len(world.humans), dtype=np.bool_)  # stands in Bullet's world
        self._near = np.zeros(len(world.humans), dtype=np.bool_)
        self._was_present = np.zeros(len(world.humans), dtype=np.bool_)
        for human in world.humans:
            length = max(BODY_HEIGHT + CAPSULE_DEPTH - 2.0 * human.radius, 0.1)
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_CAPSULE, radius=human.radius, height=length, **self._call
            )
            body = pybullet.createMultiBody(
                0.0, shape, basePosition=[0, 0, AWAY], useMaximalCoordinates=1, **self._call
            )
            pybullet.changeDynamics(body, -1, lateralFriction=0.0, restitution=0.0, **self._call)
            self._sort(body, -1, HUMAN, ROBOT)
            self._column[body] = gaps.HUMAN
            self._people.append(body)

    def _build_pieces(self) -> None:
        """Movable furniture: convex bodies that are put where people push them."""
        self._pieces: list[int] = []
        for piece in self._around.pieces:
            vertices, _ = side_faces([piece.outline], [piece.item.height])
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_MESH, vertices=vertices.tolist(), **self._call
            )
            body = pybullet.createMultiBody(0.0, shape, useMaximalCoordinates=1, **self._call)
            pybullet.changeDynamics(body, -1, lateralFriction=0.0, restitution=0.0, **self._call)
            self._sort(body, -1, SOLID, ROBOT)
            self._column[body] = gaps.STATIC
            self._pieces.append(body)
        self._place_pieces()

    def _place_pieces(self) -> None:
        for body, (x, y, turn) in zip(
            self._pieces, self._around.furniture_pose.tolist(), strict=True
        ):
            turned = (0.0, 0.0, math.sin(turn / 2.0), math.cos(turn / 2.0))
            pybullet.resetBasePositionAndOrientation(body, (x, y, 0.0), turned, self._client)

    # --- step ----------------------------------------------------------------------------

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
        body = self._bodies[robot]
        x, y, _ = outside(self._around.world, robot)
        if len(body.joints) == CARRIED:
            for joint, value in zip(body.joints, (x, y, 0.0), strict=True):
                pybullet.resetJointState(body.number, joint, value, 0.0, **self._call)
        else:
            position, turn = pybullet.getBasePositionAndOrientation(body.number, self._client)
            place = (x, y, position[2])
            pybullet.resetBasePositionAndOrientation(body.number, place, turn, self._client)
        self._pose = self._read_pose()
        self._observer.observe(self._pose, self._human)

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`."""
        around, observer = self._around, self._observer
        self._actuation.begin_tick(self._dt)
        observer.begin_tick()
        walked_from = self._human.copy()
        touched = np.zeros(len(self._pose), dtype=np.bool_)
        for k in range(self._substeps):
            time = (self._tick + k / self._substeps) * self._dt
            if around.update(time, self._is_taken):
                self._note_changes()
            self._drive(self._actuation.advance(command.twist, time))
            move_people(
                around.people(self._human),
                human_velocity,
                self._step,
                self._pose,
                observer.prints,
                around.solids,
                touched,
            )
            self._place_people()
            if self._overlaps:
                self._release_overlaps()
            pybullet.stepSimulation(self._client)
            self._pose = self._read_pose()
            if observer.observe(self._pose, self._human) <= NEAR_CONTACT:
                self._read_contacts()
        observer.contact[:, gaps.HUMAN] |= touched
        self._tick += 1
        if around.update(self._tick * self._dt, self._is_taken):
            self._note_changes()
        return self._sense((self._human - walked_from) / self._dt)

    def _drive(self, set_point: Array) -> None:
        targets = _motor_targets(
            set_point, self._actuation.loss, self._pose, self._wheels, self._fleet.holonomic
        ).tolist()
        for i, body in enumerate(self._bodies):
            if targets[i] == self._targets[i]:
                continue  # a motor keeps its target
            if self._is_braked[i]:
                self._brake(i, hold=False)
            pybullet.setJointMotorControlArray(
                body.number,
                body.joints,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=targets[i][: len(body.joints)],
                forces=body.forces,
                **self._call,
            )
        self._targets = targets

    def _read_pose(self) -> Array:
        client, raw = self._client, []
        for body in self._bodies:
            if len(body.joints) == CARRIED:
                states = pybullet.getJointStates(body.number, body.joints, client)
                raw.append((*(state[0] for state in states), *NO_TURN))
            else:
                position, turn = pybullet.getBasePositionAndOrientation(body.number, client)
                raw.append(position + turn)
        holonomic = self._fleet.holonomic
        return _floor_poses(np.array(raw).reshape(-1, 7), self._offset, self._turned, holonomic)

    def _read_velocity(self) -> Array:
        raw = np.zeros((len(self._bodies), 3))
        for i, body in enumerate(self._bodies):
            if self._fleet.holonomic[i]:
                states = pybullet.getJointStates(body.number, body.joints, **self._call)
                raw[i] = [state[1] for state in states]
            else:
                linear, angular = pybullet.getBaseVelocity(body.number, **self._call)
                raw[i] = linear[0], linear[1], angular[2]
        return _body_twists(raw, self._pose, self._offset, self._fleet.holonomic)

    def _read_contacts(self) -> None:
        observer = self._observer
        for i in np.flatnonzero(observer.gap.min(axis=1) <= NEAR_CONTACT):
            for point in pybullet.getContactPoints(self._bodies[i].number, **self._call):
                column = self._column.get(point[2])
                if column is not None and point[8] <= TOUCH:
                    observer.contact[i, column] = True

    # --- people and blockages ------------------------------------------------------------

    def _place_people(self) -> None:
        """Only people near a robot stand in Bullet's world; to move them all costs too much."""
        if not self._people:
            return
        around, near = self._around, self._near
        if _fill_near_people(
            self._human,
            around.human_radius,
            around.present,
            self._pose,
            self._fleet.reach,
            self._is_in,
            near,
        ):
            for h in np.flatnonzero(near | self._is_in):
                z = 0.5 * (BODY_HEIGHT - CAPSULE_DEPTH) if near[h] else AWAY
                x, y = self._human[h].tolist()
                pybullet.resetBasePositionAndOrientation(
                    self._people[h], (x, y, z), (0.0, 0.0, 0.0, 1.0), self._client
                )
            self._is_in[:] = near

    def _note_arrivals(self) -> None:
        """People who appear on top of a robot."""
        present = self._around.present
        for h in np.flatnonzero(present & ~self._was_present):
            self._note_overlaps(int(h))
        self._was_present = present

    def _note_changes(self) -> None:
        self._stand_blockages()
        self._note_arrivals()

    def _stand_blockages(self) -> None:
        standing = self._around.standing
        for number in sorted(set(self._blocks) - set(standing)):
            body = self._blocks.pop(number)
            del self._column[body]
            pybullet.removeBody(body, **self._call)
        for number in sorted(set(standing) - set(self._blocks)):
            event = self._around.blockages[number]
            body = self._add_solid([event.polygon], [event.height])
            self._blocks[number] = body
            self._column[body] = gaps.STATIC

    def _gap(self, pair: _Overlap) -> float:
        i = pair.robot
        placed, corners = self._observer.placed[i], int(self._fleet.corners[i])
        x, y = self._human[pair.human]
        radius = self._around.human_radius[pair.human]
        return float(gaps.polygon_point_gap(placed, corners, x, y) - radius)

    def _is_taken(self, polygon: Array) -> bool:
        return self._observer.is_taken(polygon, self._pose, self._read_velocity(), self._human)

    def _note_overlaps(self, human: int) -> None:
        """Who appears on top of a robot must not throw it: no collision until it has left."""
        for i in range(len(self._bodies)):
            pair = _Overlap(self._people[human], i, human)
            if self._gap(pair) < 0.0:
                self._overlaps.append(pair)
                self._collide(pair, enable=False)

    def _release_overlaps(self) -> None:
        for pair in self._overlaps:
            if self._gap(pair) >= 0.0:
                self._collide(pair, enable=True)
        self._overlaps = [pair for pair in self._overlaps if self._gap(pair) < 0.0]
        for pair in self._overlaps:
            self._observer.contact[pair.robot, gaps.HUMAN] = True

    def _collide(self, pair: _Overlap, *, enable: bool) -> None:
        robot = self._bodies[pair.robot].number
        for link in range(-1, pybullet.getNumJoints(robot, **self._call)):
            pybullet.setCollisionFilterPair(pair.body, robot, -1, link, int(enable), **self._call)

    # --- sense ---------------------------------------------------------------------------

    def _sense(self, human_velocity: Array) -> Sensed:
        time = self._tick * self._dt
        velocity = self._read_velocity()
        self._update_brakes(velocity)
        parked = self._observer.parked(self._pose, time)
        if self._options.rays == "bullet":
            distances = self._bullet_distances(np.flatnonzero(parked))
        else:
            distances = self._observer.exact_distances(self._pose, parked)
        return self._observer.sensed(
            tick=self._tick,
            time=time,
            pose=self._pose,
            velocity=velocity,
            human_position=self._human.copy(),
            human_velocity=human_velocity,
            distances=distances,
        )

    def _bullet_distances(self, parked: IntArray) -> Array:
        """Distances ``(N, A)`` [m] by Bullet's own rays; each robot's turn without itself."""
        options = self._options
        out = np.full((len(self._pose), options.ray_count), np.inf)
        directions = ray_directions(self._observer.aimed(self._pose)[:, 2], options.ray_count)
        ghosts = {
            int(i): self._add_solid([self._observer.placed[i, : self._fleet.corners[i]]], [0.5])
            for i in parked
        }
        for ghost in ghosts.values():
            self._sort(ghost, -1, GHOST, ROBOT)
        for i, pose in enumerate(self._pose):
            if i in ghosts:
                self._sort(ghosts[i], -1, 0, 0)
            origin = np.array([pose[0], pose[1], RAY_HEIGHT])
            ends = origin + options.ray_range * np.pad(directions[i], ((0, 0), (0, 1)))
            hits = pybullet.rayTestBatch(
                [origin.tolist()] * options.ray_count,
                ends.tolist(),
                numThreads=1,
                collisionFilterMask=SOLID | GHOST,
                **self._call,
            )
            for a, hit in enumerate(hits):
                if hit[0] >= 0:
                    out[i, a] = hit[2] * options.ray_range
            if i in ghosts:
                self._sort(ghosts[i], -1, GHOST, ROBOT)
        for ghost in ghosts.values():
            pybullet.removeBody(ghost, **self._call)
        return out

    def close(self) -> None:
        """Disconnect the client."""
        if self._client < 0:
            return
        with contextlib.suppress(pybullet.error):  # the user may have closed the window
            pybullet.disconnect(physicsClientId=self._client)
        self._client = -1


def side_faces(polygons: Sequence[Array], heights: Sequence[float]) -> tuple[Array, IntArray]:
    """Triangles of the upright sides of extruded polygons.

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


@njit(cache=True)
def _fill_near_people(
    position: Array,
    radius: Array,
    present: BoolArray,
    pose: Array,
    reach: Array,
    was_in: BoolArray,
    near: BoolArray,
) -> bool:
    """Write who ``(H,)`` is present and near a robot; says whether Bullet must hear of it."""
    news = False
    for h in range(len(position)):
        near[h] = False
        for i in range(len(pose)):
            apart = math.hypot(position[h, 0] - pose[i, 0], position[h, 1] - pose[i, 1])
            near[h] = near[h] or apart < radius[h] + NEAR_PERSON + reach[i]
        near[h] = near[h] and present[h]
        news = news or near[h] or was_in[h]
    return news


@njit(cache=True)
def _motor_targets(
    set_point: Array, loss: Array, pose: Array, wheels: Array, holonomic: IntArray
) -> Array:
    """Joint speeds ``(N, 3)`` for body twists; only two count for two wheels."""
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
def _floor_poses(raw: Array, offset: Array, turned: Array, holonomic: IntArray) -> Array:
    """Poses ``(N, 3)`` of the robot frames from those of the inertial frames.

    ``raw`` ``(N, 7)`` is position and quaternion (x, y, z, w), or joint positions;
    ``offset``, ``turned`` are position and quaternion of the inertial in the robot frame.
    """
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
def _body_twists(raw: Array, pose: Array, offset: Array, holonomic: IntArray) -> Array:
    """Twists ``(N, 3)`` of the robot frames from map velocities of the inertial frames."""
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
