"""Where elements of an SDF file stand: poses, and the numbers they are written with."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.codec import FARTHEST
from mrta_falsify.core.errors import FormatError
from simulator_interface.formats.xml_files import Node

NO_OBSTACLE = ("sun", "groundplane")  # letters of names, wherever they come from


def last_part(uri: str) -> str:
    """Name what a URI or path names: its last part, without a version or a ``model.sdf``.

    ``https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground%20Plane/3`` names ``Ground Plane``.
    """
    parts = [part for part in re.split(r"[/\\]", unquote(uri.partition("://")[2] or uri)) if part]
    while len(parts) > 1 and re.fullmatch(r"\d+|tip|model(-[\d_]+)?\.sdf", parts[-1]):
        parts.pop()
    return parts[-1] if parts else ""


@dataclass(frozen=True, slots=True, eq=False)
class SdfPlace:
    """Where an element stands, for poses and messages."""

    file: Path  #: that holds it
    root: Path  #: folder of the world; nothing outside is read
    matrix: Array  #: (4, 4) to the map frame
    name: str  #: models and links on the way, joined by /
    nesting: int = 0
    skip: frozenset[str] = frozenset()  #: names of what is left out

    def inside(self, node: Node, name: str) -> SdfPlace:
        """Find the place of an element that has a pose."""
        matrix = self.matrix @ _pose(node, self, name)
        joined = f"{self.name}/{name}" if self.name else name
        return dataclasses.replace(self, matrix=matrix, name=joined)

    def is_left_out(self, *names: str) -> bool:
        """Whether an element is left out by one of its names or URIs, or by its last part.

        So are sun and ground plane, under all names that Gazebo and Fuel give them.
        """
        for name in names:
            last = last_part(name)
            letters = re.sub(r"[^a-z]", "", last.lower())
            inner = f"{self.name}/{name}" if self.name else name
            if letters in NO_OBSTACLE or not self.skip.isdisjoint((name, last, inner)):
                return True
        return False

    def fail(self, problem: str) -> FormatError:
        """Make an error that names the file and the element."""
        where = f"{self.name}: " if self.name else ""
        return FormatError(f"{self.file}: {where}{problem}")


def read_numbers(node: Node, place: SdfPlace, what: str, counts: tuple[int, ...]) -> list[float]:
    """Read finite numbers of an element, as many as one of ``counts``.

    Raises:
        FormatError: it holds something else.
    """
    text = node.text or ""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) not in counts or not all(abs(value) <= FARTHEST for value in values):
        wanted = " or ".join(map(str, counts))
        raise place.fail(
            f"<{what}> is {text.strip()[:60]!r}; it must be {wanted} numbers from "
            f"-{FARTHEST:g} to {FARTHEST:g}"
        )
    return values


def read_positive(node: Node | None, place: SdfPlace, what: str, count: int = 1) -> list[float]:
    """Read ``count`` positive numbers of an element.

    Raises:
        FormatError: it is missing or holds something else.
    """
    if node is None:
        raise place.fail(f"<{what}> is missing")
    values = read_numbers(node, place, what, (count,))
    if min(values) <= 0.0:
        raise place.fail(f"<{what}> is {(node.text or '').strip()[:60]!r}; it must be positive")
    return values


def _pose(node: Node, place: SdfPlace, name: str) -> Array:
    """Matrix ``(4, 4)`` of an element's <pose>, the identity if it has none."""
    pose = node.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    frame = pose.get("relative_to") or pose.get("frame") or ""
    if frame not in ("", "world", "__model__"):
        raise place.fail(
            f"{name}: <pose> is relative to {frame!r}; only poses in the parent's frame are read "
            "(resolve them first, for example with `gz sdf -p`)"
        )
    matrix: Array = np.eye(4)
    if pose.get("rotation_format") == "quat_xyzw":
        values = read_numbers(pose, place, "pose", (7,))
        matrix[:3, :3] = _quaternion_rotation(values[3:], place)
    else:
        values = read_numbers(pose, place, "pose", (6,))
        scale = math.pi / 180.0 if pose.get("degrees") == "true" else 1.0
        matrix[:3, :3] = _euler_rotation(*(scale * angle for angle in values[3:]))
    matrix[:3, 3] = values[:3]
    return matrix


def _euler_rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation ``(3, 3)``: roll about x, then pitch about y, then yaw about z, fixed axes."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _quaternion_rotation(quaternion: list[float], place: SdfPlace) -> Array:
    x, y, z, w = quaternion
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if norm < 1e-6:
        raise place.fail("<pose> has a quaternion of length 0")
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
