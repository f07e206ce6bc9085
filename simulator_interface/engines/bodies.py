"""Robot models, their footprints, and whether the robots of a world can begin.

A model is data: a URDF and a few numbers (``robots/models.yaml``, or a file of the user's).
Both engines read it; the footprint is taken from the URDF's collision shapes.
"""

from __future__ import annotations

import functools
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from shapely.geometry import MultiPoint

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, IntArray, frozen_array
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.errors import ConfigError, FormatError, UnknownNameError, WorldError
from mrta_falsify.core.geometry import transform
from mrta_falsify.core.world import Blockage, RobotSpec, World
from simulator_interface import starts
from simulator_interface.engines import gaps, rays

ROBOTS = Path(__file__).parent.parent / "robots"
OUTSIDE = 50.0  # m; beyond any sensor's reach
CIRCLE_CORNERS = 24  # a round collision shape in a footprint; 0.9 % of its radius inside it
JOINT_COUNT = {"differential": 2, "holonomic": 3}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotModel:
    """A kind of robot.

    ``differential``: ``joints`` are the left and the right wheel; the URDF's root frame lies
    on the floor between the wheels, x forward. ``holonomic``: ``joints`` are the sliders along
    the map's x and y and the turntable that carry the base, whose frame they end in.
    """

    urdf: str  #: file, relative to the model file
    base: Literal["differential", "holonomic"] = "differential"
    joints: tuple[str, ...]  #: joint names in the order that ``base`` asks for
    wheel_separation: float = quantity(above=0.0, unit="m", default=0.287)
    wheel_radius: float = quantity(above=0.0, unit="m", default=0.033)
    wheels_touch: Literal["floor", "everything"] = "everything"  #: what wheels collide with
    max_torque: float = quantity(above=0.0, unit="N m", default=2.0)  #: of each wheel motor
    max_force: float = quantity(above=0.0, unit="N", default=100.0)  #: of each slider
    max_speed: float = quantity(above=0.0, unit="m/s", default=1.5)
    max_acceleration: float = quantity(above=0.0, unit="m/s^2", default=1.0)
    max_turn_rate: float = quantity(above=0.0, unit="rad/s", default=2.0)
    max_turn_acceleration: float = quantity(
        above=0.0, unit="rad/s^2", default=7.0
    )  #: 1 m/s^2 at both wheels of a Waffle, as MRTA-Sim's wheel limit of 30 rad/s^2
    response_time: float = quantity(
        low=0.0, unit="s", default=0.0
    )  #: first-order lag of the kinematic engine behind its set point; see docs/engine.md
    footprint: Array = quantity(
        shape=("V", 2), unit="m", default=[]
    )  #: convex outline, counter-clockwise; empty: from the URDF

    def __post_init__(self) -> None:
        wanted = JOINT_COUNT[self.base]
        if len(self.joints) != wanted:
            raise ConfigError(
                f"joints names {len(self.joints)} joints; a {self.base} base has {wanted}"
            )


@functools.cache
def shipped_models() -> dict[str, RobotModel]:
    """Models of ``robots/models.yaml`` by name, footprints filled in."""
    path = ROBOTS / "models.yaml"
    data = codec.read_yaml(path)
    return {name: _decode_model(entry, path, name) for name, entry in data.items()}


def find_model(name: str, *, where: str = "robots.model") -> RobotModel:
    """Model by its shipped name, or by the path of a model file.

    Args:
        name: a key of ``robots/models.yaml``, or a path that ends in .yaml or .yml.
        where: what error messages begin with.

    Returns:
        The model, ``urdf`` as an absolute path and ``footprint`` filled in.

    Raises:
        UnknownNameError: neither.
        InputError: the file or its URDF cannot be read or says something not allowed.
    """
    if name.endswith((".yaml", ".yml")):
        return _read_model(Path(name))
    models = shipped_models()
    if name not in models:
        raise UnknownNameError("robot model", name, models, where=where)
    return models[name]


def _read_model(path: Path) -> RobotModel:
    return _decode_model(codec.read_yaml(path), path, "")


def _decode_model(data: Any, path: Path, name: str) -> RobotModel:
    where = f"{path}: {name}" if name else str(path)
    model = codec.decode(RobotModel, data, where=where)
    urdf = (path.parent / model.urdf).resolve()
    wheels = model.joints if model.wheels_touch == "floor" else ()
    footprint = model.footprint
    if not len(footprint):
        footprint = read_footprint(urdf, without=wheels)
    elif len(footprint) < 3:
        raise ConfigError(f"{where}: footprint has {len(footprint)} corners; it needs at least 3")
    outline = MultiPoint(footprint).convex_hull
    return replace(model, urdf=str(urdf), footprint=_corners(outline, where))


# --- footprint from URDF -----------------------------------------------------------------


def read_footprint(urdf: Path, *, without: Sequence[str] = ()) -> Array:
    """Convex outline of a URDF's collision shapes, seen from above with all joints at zero.

    Args:
        urdf: file; boxes, cylinders, spheres and Wavefront meshes are understood.
        without: joints whose child links are left out.

    Returns:
        Corners ``(V, 2)`` [m], counter-clockwise, in the frame of the root link.

    Raises:
        FormatError: not a URDF, a joint is missing, or there is no shape to outline.
    """
    try:
        robot = ET.parse(urdf).getroot()
    except (OSError, ET.ParseError) as error:
        raise FormatError(f"{urdf}: is not a readable URDF: {error}") from None
    joints = robot.findall("joint")
    known = {joint.get("name", "") for joint in joints}
    for name in without:
        if name not in known:
            raise UnknownNameError("joint", name, known, where=str(urdf))
    frames = _link_frames(robot, urdf)
    left_out = {_child(joint) for joint in joints if joint.get("name") in without}
    points = [
        _moved(_shape_points(collision, urdf), frames[name] @ _origin(collision))
        for link in robot.findall("link")
        if (name := link.get("name", "")) not in left_out
        for collision in link.findall("collision")
    ]
    if not points:
        raise FormatError(f"{urdf}: has no collision shape, so no footprint; give `footprint`")
    return _corners(MultiPoint(np.concatenate(points)[:, :2]).convex_hull, str(urdf))


def _corners(outline: Any, where: str) -> Array:
    if outline.geom_type != "Polygon":
        raise FormatError(f"{where}: the footprint has no area")
    ring = np.asarray(outline.exterior.coords)[:-1]
    if not outline.exterior.is_ccw:
        ring = ring[::-1]
    return frozen_array(ring)


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def _link_frames(robot: ET.Element, urdf: Path) -> dict[str, Array]:
    """Frame ``(4, 4)`` of each link in the frame of the root link."""
    parents: dict[str, tuple[str, Array]] = {}
    for joint in robot.findall("joint"):
        parent = joint.find("parent")
        parents[_child(joint)] = (
            "" if parent is None else parent.get("link", ""),
            _origin(joint),
        )
    frames: dict[str, Array] = {}
    for link in robot.findall("link"):
        name = link.get("name", "")
        frame, at = np.eye(4), name
        for _ in range(len(parents) + 1):
            if at not in parents:
                break
            at, offset = parents[at]
            frame = offset @ frame
        else:
            raise FormatError(f"{urdf}: link {name!r} is its own ancestor")
        frames[name] = frame
    return frames


def _numbers(text: str | None, default: str) -> Array:
    return np.array([float(word) for word in (text or default).split()])


def _origin(element: ET.Element) -> Array:
    """Transform ``(4, 4)`` of the ``origin`` of a joint or collision."""
    origin = element.find("origin")
    frame = np.eye(4)
    if origin is None:
        return frame
    roll, pitch, yaw = _numbers(origin.get("rpy"), "0 0 0")
    turn_x = [[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]
    turn_y = [
        [math.cos(pitch), 0, math.sin(pitch)],
        [0, 1, 0],
        [-math.sin(pitch), 0, math.cos(pitch)],
    ]
    turn_z = [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    frame[:3, :3] = np.array(turn_z) @ np.array(turn_y) @ np.array(turn_x)
    frame[:3, 3] = _numbers(origin.get("xyz"), "0 0 0")
    return frame


def _shape_points(collision: ET.Element, urdf: Path) -> Array:
    """Points ``(K, 3)`` whose convex hull is the shape (nearly, if it is round)."""
    shape = next(iter(collision.find("geometry") or ()), None)
    kind = "" if shape is None else shape.tag
    angles = np.arange(CIRCLE_CORNERS) * (2.0 * math.pi / CIRCLE_CORNERS)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if shape is not None and kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(signs * _numbers(shape.get("size"), "") / 2.0)
    if shape is not None and kind == "cylinder":
        radius, half = float(shape.get("radius", "0")), float(shape.get("length", "0")) / 2.0
        return np.concatenate(
            [np.column_stack([radius * circle, np.full(len(circle), z)]) for z in (-half, half)]
        )
    if shape is not None and kind == "sphere":
        radius = float(shape.get("radius", "0"))
        flat = np.column_stack([radius * circle, np.zeros(len(circle))])
        return np.concatenate([np.roll(flat, turn, axis=1) for turn in range(3)])
    if shape is not None and kind == "mesh" and shape.get("filename", "").endswith(".obj"):
        scale = _numbers(shape.get("scale"), "1 1 1")
        return _obj_points(urdf.parent / shape.get("filename", "")) * scale
    raise FormatError(
        f"{urdf}: collision shape {kind!r} is not box, cylinder, sphere or an .obj mesh; "
        "give `footprint` in the model file"
    )


def _obj_points(path: Path) -> Array:
    lines = codec.read_text(path).splitlines()
    return np.array([_numbers(line[2:], "")[:3] for line in lines if line.startswith("v ")])


def _moved(points: Array, frame: Array) -> Array:
    return np.asarray(points @ frame[:3, :3].T + frame[:3, 3])


# --- the fleet as arrays -----------------------------------------------------------------


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
    """Models and limits of ``robots``.

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
    """Pose ``(3,)`` far outside the map, where a robot that is taken away stands [m, m, rad]."""
    x_min, y_min = world.bounds[:2]
    return np.array([x_min - OUTSIDE, y_min - OUTSIDE * (1 + robot), 0.0])


def check_starts(world: World) -> None:
    """Refuse a world in which a robot's start is taken.

    On top of :func:`simulator_interface.starts.check_starts`, which keeps the planning radius
    clear, no footprint may meet a wall, furniture, a blockage that stands at time 0, or
    another footprint: the corners of a Waffle reach beyond its planning radius.

    Raises:
        WorldError: the robot, and what it touches.
        UnknownNameError: unknown robot model.
    """
    starts.check_starts(world)
    fleet = gather_fleet(world.robots)
    solids = [
        *((f"walls[{i}] ({wall.name})", wall.polygon) for i, wall in enumerate(world.walls)),
        *((f"furniture[{i}] ({f.name})", f.polygon) for i, f in enumerate(world.furniture)),
        *(
            (f"events[{i}] ({event.name})", event.polygon)
            for i, event in enumerate(world.events)
            if isinstance(event, Blockage) and event.start <= 0.0 < event.end
        ),
    ]
    names = [name for name, polygon in solids for _ in polygon]
    edges = rays.polygon_edges([polygon for _, polygon in solids])
    placed = [
        transform(model.footprint, robot.pose)
        for robot, model in zip(world.robots, fleet.models, strict=True)
    ]
    for i, robot in enumerate(world.robots):
        x, y, yaw = robot.pose
        given = f"robots[{i}].pose of {robot.name} is ({x:g} m, {y:g} m, {yaw:g} rad)"
        hit = gaps.first_edge_met(edges, placed[i], x, y, fleet.reach[i])
        if hit >= 0:
            raise WorldError(f"{given}; its body touches {names[hit]}")
        for j in range(i):
            if gaps.polygon_gap(placed[i], len(placed[i]), placed[j], len(placed[j]), 1.0) <= 0.0:
                raise WorldError(f"{given}; its body touches robots[{j}] ({world.robots[j].name})")
