"""The engine without contact physics, for screening: same interface, same limits.

Robots follow their set points with a first-order lag; a step that would end inside a solid,
a robot or a person is shortened until it does not, and counts as contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.world import World
from simulator_interface.engines import gaps
from simulator_interface.engines.actuation import Actuation, slipping
from simulator_interface.engines.bodies import check_start_footprints, gather_fleet, outside
from simulator_interface.engines.gaps import (
    blocks_gap,
    place_outline,
    polygon_gap,
    polygon_point_gap,
    static_gap,
)
from simulator_interface.engines.rays import EdgeGrid
from simulator_interface.engines.sensing import Observer, RayOptions, Surroundings
from simulator_interface.engines.substeps import count_substeps
from simulator_interface.staging import Stage

TRAPPED = 0.005  # m; deeper overlap means that something appeared here, and holds nobody
HALVINGS = 6  # a step that is blocked is shortened to a multiple of 1/64


class KinematicEngine:
    """Moves robots and people by geometry alone."""

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
        self._response = np.array([model.response_time for model in fleet.models])
        self._separation = np.array([model.wheel_separation for model in fleet.models])
        n = len(world.robots)
        self._pose = np.array([robot.pose for robot in world.robots]).reshape(n, 3)
        self._velocity = np.zeros((n, 3))
        self._human = np.array(human_position, dtype=np.float64).reshape(len(world.humans), 2)
        self._tick = 0
        self._around.update(0.0, self._is_taken)
        self._observer.begin_tick()
        self._observer.observe(self._pose, self._human)
        return self._sense(np.zeros_like(self._human))

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """See :class:`mrta_falsify.core.protocols.Engine`."""
        fleet, around, observer = self._fleet, self._around, self._observer
        self._actuation.begin_tick(self._dt)
        observer.begin_tick()
        walked_from = self._human.copy()
        for k in range(self._substeps):
            time = (self._tick + k / self._substeps) * self._dt
            around.update(time, self._is_taken)
            set_point = self._actuation.advance(command.twist, time)
            _fill_substep(
                self._pose,
                self._velocity,
                set_point,
                self._actuation.loss,
                self._response,
                self._separation,
                fleet.holonomic,
                self._step,
                fleet.outline,
                fleet.corners,
                fleet.reach,
                observer.placed,
                around.grid,
                around.edges,
                self._human,
                human_velocity,
                around.human_radius,
                around.present,
                observer.contact,
                observer.gap,
                observer.nearest,
            )
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

    def _is_taken(self, polygon: Array) -> bool:
        return self._observer.is_taken(polygon, self._pose, self._velocity, self._human)

    def _sense(self, human_velocity: Array) -> Sensed:
        time = self._tick * self._dt
        parked = self._observer.parked(self._pose, time)
        return self._observer.sensed(
            tick=self._tick,
            time=time,
            pose=self._pose.copy(),
            velocity=self._velocity.copy(),
            human_position=self._human.copy(),
            human_velocity=human_velocity,
            distances=self._observer.exact_distances(self._pose, parked),
        )

    def close(self) -> None:
        """Nothing to free."""


@njit(cache=True)
def _fill_hindrance(
    i: int,
    pose: Array,
    outline: Array,
    corners: IntArray,
    reach: Array,
    placed: Array,
    body: Array,
    grid: EdgeGrid,
    extra: Array,
    human: Array,
    human_radius: Array,
    present: BoolArray,
    where: Array,
    depth: Array,
) -> int:
    """Write gaps below 0 of robot ``i`` at pose ``where`` to ``depth``.

    Its entries are robot, human, permanent static, blockage.

    Returns:
        The robot it overlaps most, -1: none.
    """
    depth[:] = 0.0
    hit = -1
    x, y = where[0], where[1]
    place_outline(outline[i], corners[i], where, body)
    for j in range(len(pose)):
        apart = math.hypot(pose[j, 0] - x, pose[j, 1] - y)
        if j == i or apart >= reach[i] + reach[j]:
            continue
        gap = polygon_gap(body, corners[i], placed[j], corners[j], 0.0)
        if gap < depth[0]:
            depth[0] = gap
            hit = j
    for h in range(len(human)):
        apart = math.hypot(human[h, 0] - x, human[h, 1] - y)
        if present[h] and apart < reach[i] + human_radius[h]:
            gap = polygon_point_gap(body, corners[i], human[h, 0], human[h, 1]) - human_radius[h]
            depth[1] = min(depth[1], gap)
    depth[2] = static_gap(grid, extra[:0], body, corners[i], x, y, reach[i], 0.0)
    if len(extra):
        depth[3] = blocks_gap(extra, body, corners[i], x, y)
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
def _drive(
    pose: Array,
    velocity: Array,
    set_point: Array,
    loss: Array,
    response: Array,
    separation: Array,
    holonomic: IntArray,
    step: float,
    outline: Array,
    corners: IntArray,
    reach: Array,
    placed: Array,
    grid: EdgeGrid,
    extra: Array,
    human: Array,
    human_radius: Array,
    present: BoolArray,
    contact: BoolArray,
) -> None:
    """Move all robots, one after the other, for one sub-step."""
    body = np.empty_like(outline[0]) if len(outline) else np.empty((0, 2))
    there = np.empty(3)
    now, then = np.zeros(4), np.zeros(4)
    for i in range(len(pose)):
        wanted = set_point[i].copy()
        if holonomic[i] == 1:
            wanted[:2] *= 1.0 - loss[i, 0]
            wanted[2] *= 1.0 - loss[i, 1]
        else:
            wanted[0], wanted[2] = slipping(wanted[0], wanted[2], separation[i], loss[i])
        share = 1.0 - math.exp(-step / response[i]) if response[i] > 0.0 else 1.0
        for k in range(3):
            velocity[i, k] += share * (wanted[k] - velocity[i, k])
        _fill_moved(pose[i], velocity[i], step, there)
        hit = _fill_hindrance(
            i, pose, outline, corners, reach, placed, body, grid, extra,
            human, human_radius, present, there, then,
        )  # fmt: skip
        held = False
        if then.min() < 0.0:
            _fill_hindrance(
                i, pose, outline, corners, reach, placed, body, grid, extra,
                human, human_radius, present, pose[i], now,
            )  # fmt: skip
            held = _is_held(now, then)
            for k in range(4):
                contact[i, min(k, 2)] = contact[i, min(k, 2)] or then[k] < 0.0
            if then[0] < 0.0:
                contact[hit, 0] = True
        if held:
            part, low, high = 0.0, 0.0, 1.0
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                _fill_moved(pose[i], velocity[i], middle * step, there)
                _fill_hindrance(
                    i, pose, outline, corners, reach, placed, body, grid, extra,
                    human, human_radius, present, there, then,
                )  # fmt: skip
                if _is_held(now, then):
                    high = middle
                else:
                    part = low = middle
            _fill_moved(pose[i], velocity[i], part * step, there)
            velocity[i] *= part
        pose[i] = there
        place_outline(outline[i], corners[i], pose[i], placed[i])


@njit(cache=True)
def _fill_substep(
    pose: Array,
    velocity: Array,
    set_point: Array,
    loss: Array,
    response: Array,
    separation: Array,
    holonomic: IntArray,
    step: float,
    outline: Array,
    corners: IntArray,
    reach: Array,
    placed: Array,
    grid: EdgeGrid,
    extra: Array,
    human: Array,
    human_velocity: Array,
    human_radius: Array,
    present: BoolArray,
    contact: BoolArray,
    gap: Array,
    nearest: IntArray,
) -> None:
    """People walk, robots drive, and the gaps of the tick are lowered: one call a sub-step."""
    touched = np.zeros(len(pose), dtype=np.bool_)
    gaps.move_people(
        human, human_velocity, human_radius, present, step, pose, placed, corners, reach, grid,
        extra, touched,
    )  # fmt: skip
    for i in range(len(pose)):
        contact[i, gaps.HUMAN] = contact[i, gaps.HUMAN] or touched[i]
    _drive(
        pose, velocity, set_point, loss, response, separation, holonomic, step, outline, corners,
        reach, placed, grid, extra, human, human_radius, present, contact,
    )  # fmt: skip
    gaps.fill_gaps(
        pose, outline, corners, reach, placed, grid, extra, human, human_radius, present, gap,
        nearest,
    )  # fmt: skip
