"""Whether the robots of a world can begin: discs on free floor, none inside another.

The engines check the footprints as well (:func:`.engines.bodies.check_start_footprints`).
"""

from __future__ import annotations

import itertools

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.world import Blockage, World
from simulator_interface.solids import Solids


def check_starts(world: World) -> None:
    """Refuse a world in which the disc of a robot's start is not free.

    It is not free if a disc of the robot's radius there leaves the bounds, meets a
    wall, furniture or a blockage that stands when the robot joins, or meets the disc of
    another robot.

    Raises:
        WorldError: the first such robot, with the place and what is in the way.
    """
    solids = named_solids(world)
    standing = Solids([outline for _, outline in solids])
    blockages = _blockages(world)
    blocking = Solids([event.polygon for _, event in blockages])
    for i, robot in enumerate(world.robots):
        x, y = float(robot.pose[0]), float(robot.pose[1])
        given = f"robots[{i}].pose of {robot.name} is ({x:g}, {y:g}) m"
        _check_within_bounds(world, x, y, given)
        blocked = [solids[hit][0] for hit in standing.met_by_disc(x, y, robot.radius)]
        blocked += [
            blockages[hit][0]
            for hit in blocking.met_by_disc(x, y, robot.radius)
            if blockages[hit][1].start <= robot.joins_at < blockages[hit][1].end
        ]
        if blocked:
            raise WorldError(
                f"{given}; it must keep its radius of {robot.radius:g} m clear of {blocked[0]}"
            )
    _check_apart(world)


def named_solids(world: World) -> list[tuple[str, Array]]:
    """List walls and furniture: the name in messages and the outline ``(V, 2)`` [m]."""
    return [
        *((f"walls[{i}] ({wall.name})", wall.polygon) for i, wall in enumerate(world.walls)),
        *(
            (f"furniture[{i}] ({item.name})", item.polygon)
            for i, item in enumerate(world.furniture)
        ),
    ]


def _check_within_bounds(world: World, x: float, y: float, given: str) -> None:
    x_min, y_min, x_max, y_max = world.bounds
    if not (x_min <= x <= x_max and y_min <= y <= y_max):
        raise WorldError(
            f"{given}; it must lie within bounds, x {x_min:g} to {x_max:g} m and "
            f"y {y_min:g} to {y_max:g} m"
        )


def _blockages(world: World) -> list[tuple[str, Blockage]]:
    """List the blockages with their names in messages."""
    return [
        (f"events[{j}] ({event.name})", event)
        for j, event in enumerate(world.events)
        if isinstance(event, Blockage)
    ]


def _check_apart(world: World) -> None:
    for (i, one), (j, other) in itertools.combinations(enumerate(world.robots), 2):
        gap = float(np.hypot(*(one.pose[:2] - other.pose[:2])))
        if gap < one.radius + other.radius:
            raise WorldError(
                f"robots[{j}].pose of {other.name} is {gap:.2f} m from robots[{i}] ({one.name}); "
                f"starts must be at least {one.radius + other.radius:g} m apart"
            )
