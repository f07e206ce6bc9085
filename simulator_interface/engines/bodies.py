"""The robots of a world as arrays, and whether their footprints are clear at the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.world import Blockage, RobotSpec, World
from simulator_interface import starts
from simulator_interface.engines.robot_models import RobotModel, find_model
from simulator_interface.solids import Solids

OUTSIDE = 50.0  # m; beyond any sensor's reach


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fleet:
    """All robots of a world: models, limits, and footprints padded to the same length."""

    models: tuple[RobotModel, ...]  #: N
    outline: Array  #: (N, V, 2) footprint corners in the robot frame [m]
    corners: IntArray  #: (N,) corners that count
    reach: Array  #: (N,) largest distance of a corner from the robot's origin [m]
    max_speed: Array  #: (N,) the lower limit of robot and model [m/s]
    max_acceleration: Array  #: (N,) [m/s^2]
    max_turn_rate: Array  #: (N,) [rad/s]
    max_turn_acceleration: Array  #: (N,) [rad/s^2]
    holonomic: IntArray  #: (N,) 1: moves in every direction
    joins_at: Array  #: (N,) no command is obeyed before [s]


def gather_fleet(robots: Sequence[RobotSpec]) -> Fleet:
    """Gather the models and limits of ``robots``.

    Raises:
        InputError: as :func:`find_model`.
    """
    models = tuple(
        find_model(robot.model, where=f"robots[{i}].model of {robot.name}")
        for i, robot in enumerate(robots)
    )
    corners = np.array([len(model.footprint) for model in models], dtype=np.int64)
    outline = np.zeros((len(models), int(corners.max(initial=3)), 2))
    for i, model in enumerate(models):
        outline[i, : corners[i]] = model.footprint
    pairs = tuple(zip(robots, models, strict=True))
    return Fleet(
        models=models,
        outline=outline,
        corners=corners,
        reach=np.hypot(outline[..., 0], outline[..., 1]).max(axis=1, initial=0.0),
        max_speed=np.array([min(r.max_speed, m.max_speed) for r, m in pairs]),
        max_acceleration=np.array([min(r.max_acceleration, m.max_acceleration) for r, m in pairs]),
        max_turn_rate=np.array([min(r.max_turn_rate, m.max_turn_rate) for r, m in pairs]),
        max_turn_acceleration=np.array([model.max_turn_acceleration for model in models]),
        holonomic=np.array([model.base == "holonomic" for model in models], dtype=np.int64),
        joins_at=np.array([robot.joins_at for robot in robots]),
    )


def outside(world: World, robot: int) -> Array:
    """Find a pose ``(3,)`` [m, m, rad] far outside the map, where a removed robot stands."""
    x_min, y_min = world.bounds[:2]
    return np.array([x_min - OUTSIDE, y_min - OUTSIDE * (1 + robot), 0.0])


def check_start_footprints(world: World) -> None:
    """Refuse a world in which a robot's body touches something at the start.

    On top of :func:`simulator_interface.starts.check_starts`, which keeps the planning radius
    clear, no footprint may meet a wall, furniture, a blockage that stands at time 0, or
    another footprint: the corners of a Waffle reach beyond its planning radius.

    Raises:
        WorldError: the robot, and what it touches.
        UnknownNameError: unknown robot model.
    """
    starts.check_starts(world)
    fleet = gather_fleet(world.robots)
    solids = [*starts.named_solids(world), *_blockages_at_the_start(world)]
    standing = Solids([outline for _, outline in solids])
    placed = [
        transform(model.footprint, robot.pose)
        for robot, model in zip(world.robots, fleet.models, strict=True)
    ]
    bodies = Solids(placed)
    for i, robot in enumerate(world.robots):
        x, y, yaw = robot.pose
        given = f"robots[{i}].pose of {robot.name} is ({x:g} m, {y:g} m, {yaw:g} rad)"
        touched = [solids[hit][0] for hit in standing.met_by(placed[i])]
        before = (j for j in bodies.met_by(placed[i]) if j < i)
        touched += [f"robots[{j}] ({world.robots[j].name})" for j in before]
        if touched:
            raise WorldError(f"{given}; its body touches {touched[0]}")


def _blockages_at_the_start(world: World) -> list[tuple[str, Array]]:
    return [
        (f"events[{i}] ({event.name})", event.polygon)
        for i, event in enumerate(world.events)
        if isinstance(event, Blockage) and event.start <= 0.0 < event.end
    ]
