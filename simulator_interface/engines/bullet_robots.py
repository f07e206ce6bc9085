"""The robots in a Bullet client: their motors and brakes, and where they are."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.bodies import Fleet
from simulator_interface.engines.bullet_client import (
    FLOOR,
    HUMAN,
    NO_TURN,
    ROBOT,
    SOLID,
    WHEEL,
    BulletClient,
    native_output_muted,
    pybullet,
)
from simulator_interface.engines.bullet_frames import Inertial, body_twists, floor_poses
from simulator_interface.engines.robot_models import RobotModel

TOUCH = 1e-3  # m; a contact point nearer than this is a touch (Bullet reports some that are apart)
AT_REST = (0.005, 0.005, 0.02)  # m/s, m/s, rad/s; slower than this a robot counts as standing
BRAKE_AFTER = 0.2  # s of standing without a set point, then the brake holds it
CARRIED = 3  # driven joints of a holonomic base


class _Body(NamedTuple):
    """A robot in Bullet."""

    number: int  #: body
    joints: tuple[int, ...]  #: driven, in the model's order
    forces: tuple[float, ...]  #: limits of their motors [N] or [N m]


class _Holding(NamedTuple):
    """Which robots stand, and who is to be held or let go."""

    standing_for: Array  #: (N,) [s]
    may_brake: BoolArray  #: (N,)
    is_braked: BoolArray  #: (N,)
    pushed: BoolArray  #: (N,) held, and moves all the same
    due: BoolArray  #: (N,) is to be held


class BulletRobots:
    """The robots of a world in a client.

    Raises:
        UnknownNameError: a model names a joint that its URDF does not have.
        InputError: a model's URDF cannot be used.
    """

    def __init__(self, client: BulletClient, fleet: Fleet, world: World) -> None:
        n = len(world.robots)
        self._client = client
        self._fleet = fleet
        self._bodies = [
            _load_robot(client, model, robot.pose)
            for robot, model in zip(world.robots, fleet.models, strict=True)
        ]
        #: position and turn of the inertial frames in the robot frames
        self.inertial = Inertial(np.zeros((n, 3)), np.tile(NO_TURN, (n, 1)), fleet.holonomic)
        for i, body in enumerate(self._bodies):
            info = pybullet.getDynamicsInfo(body.number, -1, **client.call)
            self.inertial.offset[i], self.inertial.turned[i] = info[3], info[4]
            client.column[body.number] = gaps.ROBOT
        #: (N, 2) radius and separation [m]
        self.wheels = np.array(
            [[model.wheel_radius, model.wheel_separation] for model in fleet.models]
        ).reshape(n, 2)
        self._targets: list[list[float]] = [[] for _ in range(n)]
        self._holding = _Holding(
            standing_for=np.zeros(n),
            may_brake=fleet.holonomic == 0,
            is_braked=np.zeros(n, dtype=np.bool_),
            pushed=np.zeros(n, dtype=np.bool_),
            due=np.zeros(n, dtype=np.bool_),
        )
        for i in range(n):
            self._brake(i, hold=False)

    def __len__(self) -> int:
        return len(self._bodies)

    # --- motors and brakes ---------------------------------------------------------------

    def drive(self, speeds: Array) -> None:
        """Set the motors to joint speeds ``(N, 3)``; only two count for two wheels."""
        targets = speeds.tolist()
        for i, body in enumerate(self._bodies):
            if targets[i] == self._targets[i]:
                continue  # a motor keeps its target
            if self._holding.is_braked[i]:
                self._brake(i, hold=False)
            pybullet.setJointMotorControlArray(
                body.number,
                body.joints,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=targets[i][: len(body.joints)],
                forces=body.forces,
                **self._client.call,
            )
        self._targets = targets

    def _brake(self, robot: int, *, hold: bool) -> None:
        """Hold a robot where it stands, or let it go.

        A standing robot creeps by 0.3 mm/s, as far as the solver is from convergence. Held, it
        sleeps in Bullet's sense: what runs into it wakes it, and it costs no time.
        """
        self._holding.is_braked[robot] = hold
        state = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING + pybullet.ACTIVATION_STATE_WAKE_UP
        if hold:
            state = pybullet.ACTIVATION_STATE_ENABLE_SLEEPING + pybullet.ACTIVATION_STATE_SLEEP
        number = self._bodies[robot].number
        pybullet.changeDynamics(number, -1, activationState=state, **self._client.call)

    def update_brakes(self, velocity: Array, set_point: Array, dt: float) -> None:
        """Brake the robots that stand.

        A held robot that moves was pushed, and Bullet has woken it already.

        Args:
            velocity: ``(N, 3)`` forward, left [m/s], turn [rad/s].
            set_point: ``(N, 3)`` of the same.
            dt: since the last call [s].
        """
        holding = self._holding
        if not _fill_brakes(velocity, set_point, dt, holding):
            return
        for i in holding.pushed.nonzero()[0].tolist():
            self._brake(i, hold=False)
        for i in holding.due.nonzero()[0].tolist():
            self._brake(i, hold=True)

    # --- where they are ------------------------------------------------------------------

    def read_pose(self) -> Array:
        """Read poses ``(N, 3)`` x, y [m], yaw [rad]."""
        return floor_poses(self.read_raw(), self.inertial)

    def read_raw(self) -> Array:
        """Read what Bullet says of the poses ``(N, 7)``; see :func:`.bullet_frames.floor_poses`."""
        client, raw = self._client.number, []
        for body in self._bodies:
            if len(body.joints) == CARRIED:
                states = pybullet.getJointStates(body.number, body.joints, client)
                raw += [*(state[0] for state in states), *NO_TURN]
            else:
                position, turn = pybullet.getBasePositionAndOrientation(body.number, client)
                raw += position
                raw += turn
        return np.array(raw).reshape(-1, 7)

    def read_velocity(self, pose: Array) -> Array:
        """Read body twists ``(N, 3)`` forward, left [m/s], turn [rad/s] at poses ``(N, 3)``."""
        call = self._client.call
        found: list[float] = []
        for body in self._bodies:
            if len(body.joints) == CARRIED:
                states = pybullet.getJointStates(body.number, body.joints, **call)
                found += [state[1] for state in states]
            else:
                linear, angular = pybullet.getBaseVelocity(body.number, **call)
                found += linear[0], linear[1], angular[2]
        raw = np.array(found).reshape(-1, 3)
        return body_twists(raw, pose, self.inertial.offset, self._fleet.holonomic)

    def put(self, robot: int, x: float, y: float) -> None:
        """Put a robot at (x, y) [m]."""
        body = self._bodies[robot]
        if len(body.joints) == CARRIED:
            for joint, value in zip(body.joints, (x, y, 0.0), strict=True):
                pybullet.resetJointState(body.number, joint, value, 0.0, **self._client.call)
        else:
            number = self._client.number
            position, turn = pybullet.getBasePositionAndOrientation(body.number, number)
            self._client.place(body.number, (x, y, position[2]), turn)

    def shift(self, offset: Array) -> None:
        """Move robots by ``offset`` ``(N, 2)`` [m]."""
        call = self._client.call
        for i, body in enumerate(self._bodies):
            if not offset[i].any():
                continue
            self._brake(i, hold=False)
            if len(body.joints) == CARRIED:
                for joint, move in zip(body.joints[:2], offset[i].tolist(), strict=True):
                    at = pybullet.getJointState(body.number, joint, **call)
                    pybullet.resetJointState(body.number, joint, at[0] + move, at[1], **call)
            else:
                position, turn = pybullet.getBasePositionAndOrientation(body.number, **call)
                linear, angular = pybullet.getBaseVelocity(body.number, **call)
                x, y = position[:2] + offset[i]
                self._client.place(body.number, (x, y, position[2]), turn)
                pybullet.resetBaseVelocity(body.number, linear, angular, **call)

    # --- what they touch -----------------------------------------------------------------

    def fill_contact(self, robots: IntArray, contact: BoolArray) -> None:
        """Mark what ``robots`` touch in ``contact`` ``(N, 3)`` (robot, human, static)."""
        column_of = self._client.column
        for i in robots:
            for point in pybullet.getContactPoints(self._bodies[i].number, **self._client.call):
                column = column_of.get(point[2])
                if column is not None and point[8] <= TOUCH:
                    contact[i, column] = True

    def collide_with(self, robot: int, body: int, *, enable: bool) -> None:
        """Let a robot and another body collide, or pass through each other."""
        number, call = self._bodies[robot].number, self._client.call
        for link in range(-1, pybullet.getNumJoints(number, **call)):
            pybullet.setCollisionFilterPair(body, number, -1, link, int(enable), **call)


@njit(cache=True)
def _fill_brakes(velocity: Array, set_point: Array, dt: float, holding: _Holding) -> bool:
    """Write who is to be let go and who is to be held; say whether anybody is."""
    news = False
    for i in range(len(velocity)):
        stands, moves = True, False
        for k in range(3):
            stands = stands and abs(velocity[i, k]) < AT_REST[k] and set_point[i, k] == 0.0
            moves = moves or velocity[i, k] != 0.0
        holding.standing_for[i] = holding.standing_for[i] + dt if stands else 0.0
        pushed = holding.is_braked[i] and moves
        is_long = holding.standing_for[i] >= BRAKE_AFTER
        is_held = holding.is_braked[i] and not pushed
        holding.pushed[i], holding.due[i] = pushed, is_long and not is_held and holding.may_brake[i]
        news = news or pushed or holding.due[i]
    return news


# --- from URDF to body -------------------------------------------------------------------


def _load_robot(client: BulletClient, model: RobotModel, pose: Array) -> _Body:
    x, y, yaw = (float(value) for value in pose)
    is_carried = model.base == "holonomic"
    where = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    if not is_carried:
        where = ([x, y, 0.0], [0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])
    try:
        with native_output_muted():  # merging links is chatty
            number = pybullet.loadURDF(
                model.urdf,
                *where,
                useFixedBase=is_carried,
                flags=pybullet.URDF_MERGE_FIXED_LINKS + pybullet.URDF_USE_INERTIA_FROM_FILE,
                **client.call,
            )
    except pybullet.error as error:
        raise FormatError(f"{model.urdf}: Bullet cannot load it: {error}") from None
    joints = _driven_joints(client, number, model)
    _tune_links(client, number, model, joints)
    if is_carried:
        for joint, value in zip(joints, (x, y, yaw), strict=True):
            pybullet.resetJointState(number, joint, value, **client.call)
        return _Body(number, joints, (model.max_force, model.max_force, model.max_torque))
    return _Body(number, joints, (model.max_torque, model.max_torque))


def _driven_joints(client: BulletClient, number: int, model: RobotModel) -> tuple[int, ...]:
    count = pybullet.getNumJoints(number, **client.call)
    infos = [pybullet.getJointInfo(number, j, **client.call) for j in range(count)]
    known = {info[1].decode(): j for j, info in enumerate(infos)}
    for name in model.joints:
        if name not in known:
            raise UnknownNameError("joint", name, known, where=model.urdf)
        if infos[known[name]][2] not in (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC):
            raise ConfigError(f"{model.urdf}: joint {name!r} cannot be driven")
    return tuple(known[name] for name in model.joints)


def _tune_links(
    client: BulletClient, number: int, model: RobotModel, joints: tuple[int, ...]
) -> None:
    """Set friction, damping and collision groups of a robot's links."""
    wheels = joints if model.base == "differential" else ()
    for link in range(-1, pybullet.getNumJoints(number, **client.call)):
        is_wheel = link in wheels
        pybullet.changeDynamics(
            number,
            link,
            lateralFriction=1.0 if is_wheel else 0.0,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            **client.call,
        )
        if is_wheel and model.wheels_touch == "floor":
            client.collide(number, link, WHEEL, FLOOR)
        else:
            client.collide(number, link, ROBOT, ROBOT | SOLID | FLOOR | HUMAN)
