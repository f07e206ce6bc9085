"""What moves on a floor, as shapes: people, robots, trails, paths, pushed furniture."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import HumanSpec, World
from reports.floor_scene import Role, Shape
from reports.furnishing import movable_outlines


def starting_scene(world: World) -> tuple[Shape, ...]:
    """Describe people with their routes, and robots, before anything has moved."""
    routes = [
        Shape(role=Role.ROUTE, points=_closed_route(human), blind=not human.reacts_to_robots)
        for human in world.humans
    ]
    people = [
        _person(human, number, start_of(human.route, human.start, repeat=human.repeat))
        for number, human in enumerate(world.humans)
    ]
    robots = [
        _robot(robot.name, robot.radius, number, robot.pose)
        for number, robot in enumerate(world.robots)
    ]
    return (*routes, *people, *robots)


def moving_scene(world: World, trace: Trace, tick: int, *, trail: float) -> tuple[Shape, ...]:
    """Describe pushed furniture, trails, people and robots at a tick.

    Args:
        world: of the run.
        trace: of the run, kept.
        tick: when.
        trail: how much of a robot's way is shown [s].
    """
    poses = trace.columns["pose"]
    past = slice(max(0, tick - round(trail / trace.dt)), tick + 1, 4)
    robots = range(len(world.robots))
    places = trace.columns["human_position"][tick]
    return (
        *(
            Shape(role=Role.FURNITURE, points=outline)
            for outline in movable_outlines(world, trace, tick)
        ),
        *(Shape(role=Role.TRAIL, points=poses[past, i, :2], number=i) for i in robots),
        *(
            _person(human, number, place)
            for number, (human, place) in enumerate(zip(world.humans, places, strict=True))
            if np.isfinite(place).all()  # NaN: not in the building
        ),
        *(
            _robot(robot.name, robot.radius, number, poses[tick, number])
            for number, robot in enumerate(world.robots)
        ),
    )


def path_scene(trace: Trace, tick: int) -> tuple[Shape, ...]:
    """Describe the paths that robots follow at a tick."""
    latest: dict[int, Array] = {}
    for change in trace.paths:
        if change.tick > tick:
            break
        latest[change.robot] = change.points
    return tuple(
        Shape(role=Role.PATH, points=points, number=robot)
        for robot, points in sorted(latest.items())
        if len(points)
    )


def _person(human: HumanSpec, number: int, place: Array) -> Shape:
    role = Role.PERSON if human.reacts_to_robots else Role.BLIND_PERSON
    return Shape(role=role, points=place[None], text=human.name, number=number, radius=human.radius)


def _robot(name: str, radius: float, number: int, pose: Array) -> Shape:
    return Shape(
        role=Role.ROBOT,
        points=pose[None, :2],
        text=name,
        number=number,
        radius=radius,
        yaw=float(pose[2]),
    )


def _closed_route(human: HumanSpec) -> Array:
    route = human.route
    return np.concatenate([route, route[:1]]) if human.repeat and len(route) > 1 else route


def start_of(route: Array, share: float, *, repeat: bool) -> Array:
    """Point ``(2,)`` at ``share`` of the length of a route of straight legs."""
    points = np.concatenate([route, route[:1]]) if repeat else route
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(lengths)])
    if walked[-1] == 0.0:
        return np.asarray(route[0])
    at = share * walked[-1]
    return np.array([np.interp(at, walked, points[:, axis]) for axis in (0, 1)])


def robot_outline(pose: Array, radius: float) -> Array:
    """Arrow-shaped outline ``(5, 2)`` [m] at ``pose`` (x, y, yaw), pointing forward."""
    shape = (
        1.45 * radius * np.array([[1.2, 0.0], [0.1, 0.95], [-1.0, 0.8], [-1.0, -0.8], [0.1, -0.95]])
    )
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(shape @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def outline_of(robot: Shape, *, scale: float = 1.0) -> Array:
    """Arrow-shaped outline ``(5, 2)`` [m] of a robot, ``scale`` times as large as it is."""
    pose = np.array([*robot.points[0], robot.yaw])
    return robot_outline(pose, scale * robot.radius)
