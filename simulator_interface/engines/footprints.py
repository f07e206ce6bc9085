"""Footprints: the outlines of URDFs' collision shapes, seen from above."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from shapely.geometry import MultiPoint

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.errors import FormatError, UnknownNameError
from mrta_falsify.core.parsing import read_text

CIRCLE_CORNERS = 24  # a round collision shape in a footprint; 0.9 % of its radius inside it


def read_footprint(urdf: Path, *, without: Sequence[str] = ()) -> Array:
    """Outline a URDF's collision shapes, seen from above with all joints at zero.

    Args:
        urdf: file; boxes, cylinders, spheres and Wavefront meshes are understood.
        without: joints whose child links are left out.

    Returns:
        Corners ``(V, 2)`` [m], counter-clockwise, in the frame of the root link.

    Raises:
        FormatError: not a URDF, a joint is missing, or there is no shape to outline.
    """
    robot = parse_urdf(urdf)
    joints = robot.findall("joint")
    known = {joint.get("name", "") for joint in joints}
    for name in without:
        if name not in known:
            raise UnknownNameError("joint", name, known, where=str(urdf))
    frames = link_frames(robot, urdf)
    left_out = {_child(joint) for joint in joints if joint.get("name") in without}
    points = [
        _moved(_shape_points(collision, urdf), frames[name] @ origin_frame(collision))
        for link in robot.findall("link")
        if (name := link.get("name", "")) not in left_out
        for collision in link.findall("collision")
    ]
    if not points:
        raise FormatError(f"{urdf}: has no collision shape, so no footprint; give `footprint`")
    return convex_outline(np.concatenate(points)[:, :2], str(urdf))


def convex_outline(points: Array, where: str) -> Array:
    """Find the convex hull ``(V, 2)`` [m] of ``points`` ``(K, 2)``, counter-clockwise.

    Raises:
        FormatError: the hull has no area; the message begins with ``where``.
    """
    outline = MultiPoint(points).convex_hull
    if outline.geom_type != "Polygon":
        raise FormatError(f"{where}: the footprint has no area")
    ring = np.asarray(outline.exterior.coords)[:-1]
    if not outline.exterior.is_ccw:
        ring = ring[::-1]
    return frozen_array(ring)


def parse_urdf(urdf: Path) -> ET.Element:
    """Read a URDF's root element.

    Raises:
        FormatError: not a URDF.
    """
    try:
        return ET.parse(urdf).getroot()
    except (OSError, ET.ParseError) as error:
        raise FormatError(f"{urdf}: is not a readable URDF: {error}") from None


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def link_frames(robot: ET.Element, urdf: Path) -> dict[str, Array]:
    """Find the frame ``(4, 4)`` of each link in the frame of the root link."""
    parents: dict[str, tuple[str, Array]] = {}
    for joint in robot.findall("joint"):
        parent = joint.find("parent")
        parents[_child(joint)] = (
            "" if parent is None else parent.get("link", ""),
            origin_frame(joint),
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


def origin_frame(element: ET.Element) -> Array:
    """Read the transform ``(4, 4)`` of the ``origin`` of a joint, collision or inertial."""
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
    geometry = collision.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
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
    lines = read_text(path).splitlines()
    return np.array([_numbers(line[2:], "")[:3] for line in lines if line.startswith("v ")])


def _moved(points: Array, frame: Array) -> Array:
    return np.asarray(points @ frame[:3, :3].T + frame[:3, 3])
