"""The engine without contact physics, for screening: same interface, same limits.

Robots follow their set points with a first-order lag; a step that would end inside a solid,
a robot or a person is shortened until it does not, and counts as contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.neighbours import Neighbours, neighbours_within
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Actuation, Motors, move_set_points, slipping
from simulator_interface.engines.bodies import check_start_footprints, gather_fleet, outside
from simulator_interface.engines.gaps import (
    Obstructions,
    PackedObstructions,
    blocks_gap,
    place_outline,
    polygon_gap,
    polygon_point_gap,
    static_gap,
)
from simulator_interface.engines.pedestrians import move_people
from simulator_interface.engines.sensing import Observer, RayOptions, Surroundings
from simulator_interface.engines.substeps import count_substeps
from simulator_interface.staging import Stage

TRAPPED = 0.005  # m; deeper overlap means that something appeared here, and holds no robot
HALVINGS = 6  # a step that is blocked is shortened to a multiple of 1/64


class Drives(NamedTuple):
    """How the robots follow their set points."""

    response: Array  #: (N,) time constant of the lag [s], 0: none
    separation: Array  #: (N,) of the wheels [m]
    holonomic: IntArray  #: (N,) 1: moves in every direction
    loss: Array  #: (N, 2) share of speed lost to slip
    step: float  #: sub-step [s]


class Measured(NamedTuple):
    """What is measured of a tick, sub-step after sub-step."""

    contact: BoolArray  #: (N, 3) touched robot, human, static
    gap: Array  #: (N, 3) least gap [m]
    nearest: IntArray  #: (N, 2) robot, human


class _Moving(NamedTuple):
    """The robots, and what moves them."""

    pose: Array  #: (N, 3)
    velocity: Array  #: (N, 3)
    drives: Drives
    motors: Motors


class _Clock(NamedTuple):
    """Which sub-steps of a tick are meant."""

    tick: int
    dt: float  #: of a tick [s]
    substeps: int  #: of a tick
    first: int
    end: int  #: the first that is not meant any more
    before: int  #: sub-steps before the first, since the start


class KinematicEngine:
    """Moves robots and people by geometry alone."""

    has_no_hidden_state = True  #: see :class:`simulator_interface.staging.ReadableEngine`

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Accuracy and sensing."""

        step_size: float = quantity(above=0.0, high=0.05, unit="s", default=0.025)
        ray_count: int = quantity(low=1, high=360, default=12)
        ray_range: float = quantity(above=0.0, unit="m", default=10.0)

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`.

        Raises:
            WorldError: a robot's start is taken.
            UnknownNameError: unknown robot model.
        """
        check_start_footprints(world)
        fleet = gather_fleet(world.robots)
        self._fleet = fleet
        self._dt = dt
        self._substeps = count_substeps(dt, self._options.step_size)
        self._step = dt / self._substeps
        self._actuation = Actuation(fleet, world.robots, world.seed, self._step)
        self._around = Surroundings(world)
        rays = RayOptions(count=self._options.ray_count, max_range=self._options.ray_range)
        self._observer = Observer(fleet, self._around, rays)
        self._drives = Drives(
            response=np.array([model.response_time for model in fleet.models]),
            separation=np.array([model.wheel_separation for model in fleet.models]),
            holonomic=fleet.holonomic,
            loss=self._actuation.loss,
            step=self._step,
        )
        n = len(world.robots)
        self._pose = np.array([robot.pose for robot in world.robots]).reshape(n, 3)
        self._velocity = np.zeros((n, 3))
        observer = self._observer
        self._moving = _Moving(self._pose, self._velocity, self._drives, self._actuation.motors)
        self._measured = Measured(observer.contact, observer.gap, observer.nearest)
        self._human = np.array(human_position, dtype=np.float64).reshape(len(world.humans), 2)
        self._tick = 0
        self._around.update(0.0, self._is_taken)
        self._observer.begin_tick()
        self._observer.observe(self._pose, self._human)
        return self._sense(np.zeros_like(self._human))

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`."""
        around, observer = self._around, self._observer
        self._actuation.begin_tick(self._dt)
        walked_from = self._human.copy()
        done = 0
        while done < self._substeps:
            around.update((self._tick + done / self._substeps) * self._dt, self._is_taken)
            is_settled = around.is_settled((self._tick + 1) * self._dt)
            clock = _Clock(
                self._tick,
                self._dt,
                self._substeps,
                first=done,
                end=self._substeps if is_settled else done + 1,
                before=self._actuation.count,
            )
            things = gaps.packed(observer.prints, around.solids, around.people(self._human))
            _fill_substeps(
                clock, self._moving, command.twist, human_velocity, things, self._measured
            )
            self._actuation.count += clock.end - done
            done = clock.end
        self._tick += 1
        around.update(self._tick * self._dt, self._is_taken)
        return self._sense((self._human - walked_from) / self._dt)

    def arrange(self, stage: Stage) -> None:
        """See :class:`simulator_interface.staging.StagedEngine`."""
        moved = np.isfinite(stage.placed[:, 0])
        self._human[moved] = stage.placed[moved]
        self._around.arrange(stage, self._tick * self._dt, self._is_taken)

    def forget_after(self, time: float) -> None:
        """See :class:`simulator_interface.staging.ForgettingPart`."""
        self._around.forget_after(time)

    def remove(self, robot: int) -> None:
        """See :class:`simulator_interface.staging.RemovingEngine`."""
        self._pose[robot] = outside(self._around.world, robot)
        self._velocity[robot] = 0.0
        self._observer.observe(self._pose, self._human)

    def shift(self, offset: Array) -> None:
        """See :class:`simulator_interface.staging.ShiftingEngine`."""
        self._pose[:, :2] += offset
        self._observer.observe(self._pose, self._human)

    def _is_taken(self, polygon: Array) -> bool:
        return self._observer.is_taken(polygon, self._pose, self._velocity, self._human)

    def _sense(self, human_velocity: Array) -> Sensed:
        time = self._tick * self._dt
        return self._observer.sensed(
            tick=self._tick,
            time=time,
            pose=self._pose.copy(),
            velocity=self._velocity.copy(),
            human_position=self._human.copy(),
            human_velocity=human_velocity,
            distances=self._observer.exact_distances(self._pose, time),
        )

    def close(self) -> None:
        """Nothing to free."""


@njit(cache=True)
def _fill_hindrance(
    i: int,
    pose: Array,
    where: Array,
    around: Obstructions,
    near: Neighbours,
    body: Array,
    depth: Array,
) -> int:
    """Write gaps below 0 of robot ``i`` at pose ``where`` to ``depth``.

    Its entries are robot, human, permanent static, blockage. ``body`` receives the footprint,
    ``near`` lists the robots that it may overlap.

    Returns:
        The robot it overlaps most, -1: none.
    """
    prints, people, solids = around.prints, around.people, around.solids
    corners, reach = prints.corners[i], prints.reach[i]
    depth[0] = depth[1] = depth[2] = depth[3] = 0.0
    hit = -1
    x, y = where[0], where[1]
    place_outline(prints.outline[i], corners, where, body)
    for m in range(near.first[i], near.first[i + 1]):
        j = near.number[m]
        if math.hypot(pose[j, 0] - x, pose[j, 1] - y) >= reach + prints.reach[j]:
            continue
        gap = polygon_gap(body, corners, prints.placed[j], prints.corners[j], 0.0)
        if gap < depth[0]:
            depth[0] = gap
            hit = j
    for h in range(len(people.position)):
        hx, hy, radius = people.position[h, 0], people.position[h, 1], people.radius[h]
        if people.present[h] and math.hypot(hx - x, hy - y) < reach + radius:
            gap = polygon_point_gap(body, corners, hx, hy) - radius
            depth[1] = min(depth[1], gap)
    depth[2] = static_gap(solids.grid, solids.extra[:0], body, corners, x, y, reach, 0.0)
    if len(solids.extra):
        depth[3] = blocks_gap(solids.extra, body, corners, x, y)
    return hit


@njit(cache=True)
def _is_held(now: Array, then: Array) -> bool:
    """Whether a step would lead into something, or deeper into it."""
    held = False
    for k in range(len(now)):
        held = held or (then[k] < 0.0 and then[k] <= now[k] and now[k] > -TRAPPED)
    return held


@njit(cache=True)
def _fill_moved(pose: Array, twist: Array, step: float, out: Array) -> None:
    """Write ``pose`` after ``step`` of constant body twist to ``out`` (midpoint rule)."""
    yaw = pose[2] + 0.5 * twist[2] * step
    c, s = math.cos(yaw), math.sin(yaw)
    out[0] = pose[0] + step * (c * twist[0] - s * twist[1])
    out[1] = pose[1] + step * (s * twist[0] + c * twist[1])
    out[2] = math.pi - (math.pi - pose[2] - twist[2] * step) % (2.0 * math.pi)


@njit(cache=True)
def _fill_velocity(i: int, velocity: Array, set_point: Array, drives: Drives) -> None:
    """Bring the velocity of robot ``i`` towards its set point, as far as slip and lag allow."""
    forward, left, turn = set_point[i, 0], set_point[i, 1], set_point[i, 2]
    loss = drives.loss[i]
    if drives.holonomic[i] == 1:
        forward *= 1.0 - loss[0]
        left *= 1.0 - loss[0]
        turn *= 1.0 - loss[1]
    else:
        forward, turn = slipping(forward, turn, drives.separation[i], loss)
    lag = drives.response[i]
    share = 1.0 - math.exp(-drives.step / lag) if lag > 0.0 else 1.0
    velocity[i, 0] += share * (forward - velocity[i, 0])
    velocity[i, 1] += share * (left - velocity[i, 1])
    velocity[i, 2] += share * (turn - velocity[i, 2])


@njit(cache=True)
def _free_part(
    i: int,
    pose: Array,
    twist: Array,
    step: float,
    around: Obstructions,
    near: Neighbours,
    now: Array,
) -> float:
    """Find the largest share of a blocked step, in 64ths, that robot ``i`` may still go."""
    body, there, then = np.empty_like(around.prints.outline[i]), np.empty(3), np.zeros(4)
    part, low, high = 0.0, 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        _fill_moved(pose[i], twist, middle * step, there)
        _fill_hindrance(i, pose, there, around, near, body, then)
        if _is_held(now, then):
            high = middle
        else:
            part = low = middle
    return part


@njit(cache=True)
def _reach_of_step(velocity: Array, set_point: Array, step: float, reach: Array) -> float:
    """Say beyond which distance two robots cannot meet within a sub-step [m].

    A robot's speed stays between what it is and what is asked for.
    """
    fastest, widest = 0.0, 0.0
    for i in range(len(velocity)):
        speed = math.hypot(velocity[i, 0], velocity[i, 1])
        fastest = max(fastest, speed + math.hypot(set_point[i, 0], set_point[i, 1]))
        widest = max(widest, reach[i])
    return 2.0 * (widest + fastest * step) + gaps.ROUNDING


@njit(cache=True)
def _drive(
    pose: Array,
    velocity: Array,
    set_point: Array,
    drives: Drives,
    around: Obstructions,
    contact: BoolArray,
) -> None:
    """Move all robots, one after the other, for one sub-step."""
    prints = around.prints
    body = np.empty_like(prints.outline[0]) if len(pose) else np.empty((0, 2))
    there = np.empty(3)
    now, then = np.zeros(4), np.zeros(4)
    near = neighbours_within(pose, _reach_of_step(velocity, set_point, drives.step, prints.reach))
    for i in range(len(pose)):
        _fill_velocity(i, velocity, set_point, drives)
        _fill_moved(pose[i], velocity[i], drives.step, there)
        hit = _fill_hindrance(i, pose, there, around, near, body, then)
        if min(then[0], then[1], then[2], then[3]) < 0.0:
            for k in range(4):
                contact[i, min(k, 2)] = contact[i, min(k, 2)] or then[k] < 0.0
            if then[0] < 0.0:
                contact[hit, 0] = True
            _fill_hindrance(i, pose, pose[i], around, near, body, now)
            if _is_held(now, then):
                part = _free_part(i, pose, velocity[i], drives.step, around, near, now)
                _fill_moved(pose[i], velocity[i], part * drives.step, there)
                for k in range(3):
                    velocity[i, k] *= part
        for k in range(3):
            pose[i, k] = there[k]
        place_outline(prints.outline[i], prints.corners[i], pose[i], prints.placed[i])


@njit(cache=True)
def _fill_substeps(
    clock: _Clock,
    moving: _Moving,
    command: Array,
    human_velocity: Array,
    around: PackedObstructions,
    measured: Measured,
) -> None:
    """Take sub-steps: walk the people, drive the robots, measure the gaps of the tick."""
    things = gaps.unpacked(around)
    prints, solids, people = things
    pose, drives, motors = moving.pose, moving.drives, moving.motors
    touched = np.zeros(len(pose), dtype=np.bool_)
    if clock.first == 0:
        gaps.forget(measured.gap, measured.nearest, measured.contact)
    for k in range(clock.first, clock.end):
        time = (clock.tick + k / clock.substeps) * clock.dt
        move_set_points(command, time, motors, clock.before + k - clock.first)
        move_people(people, human_velocity, drives.step, pose, prints, solids, touched)
        for i in range(len(pose)):
            measured.contact[i, gaps.HUMAN] = measured.contact[i, gaps.HUMAN] or touched[i]
        _drive(pose, moving.velocity, motors.set_point, drives, things, measured.contact)
        gaps.fill_gaps(pose, prints, solids, people, measured.gap, measured.nearest)
