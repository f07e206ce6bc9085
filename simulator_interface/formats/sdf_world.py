"""A world as SDF for Gazebo: every solid an extruded outline, without robots."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.durable import write_atomically
from mrta_falsify.core.world import Blockage, World

SDF_VERSION = "1.6"
COLOURS = {"wall": "0.85 0.85 0.85 1", "furniture": "0.76 0.68 0.55 1", "blockage": "0.8 0.2 0.2 1"}


def write_sdf(world: World, path: Path) -> None:
    """Write walls, furniture and blockages of time 0 as static models.

    Args:
        world: what to write.
        path: the ``.sdf`` or ``.world`` file.

    Raises:
        PlaceError: the file cannot be written.
    """
    write_atomically(path, sdf_text(world).encode())


def sdf_text(world: World) -> str:
    """Make the SDF document of ``world``."""
    root = ET.Element("sdf", version=SDF_VERSION)
    name = _free_name(world.name, {"world"})  # which libsdformat reserves
    tree = ET.SubElement(root, "world", name=name)
    ET.SubElement(tree, "gravity").text = "0 0 -9.8"
    physics = ET.SubElement(tree, "physics", name="default_physics", default="true", type="ode")
    for name, value in (("max_step_size", "0.001"), ("real_time_factor", "1")):
        ET.SubElement(physics, name).text = value
    for name in ("sun", "ground_plane"):
        include = ET.SubElement(tree, "include")
        ET.SubElement(include, "uri").text = f"model://{name}"
    taken: set[str] = set()
    solids = [
        *(("wall", wall.name, wall.polygon, wall.height) for wall in world.walls),
        *(("furniture", item.name, item.polygon, item.height) for item in world.furniture),
        *(
            ("blockage", event.name, event.polygon, event.height)
            for event in world.events
            if isinstance(event, Blockage) and event.start <= 0.0
        ),
    ]
    for kind, name, outline, height in solids:
        _add_model(tree, _free_name(f"{kind}_{name}", taken), outline, height, COLOURS[kind])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _free_name(name: str, taken: set[str]) -> str:
    # SDF allows any name but those in double underscores, and none twice.
    clean = "".join(c if c.isalnum() or c in "_-" else "_" for c in name).strip("_") or "solid"
    number, free = 2, clean
    while free in taken:
        free = f"{clean}_{number}"
        number += 1
    taken.add(free)
    return free


def _add_model(parent: ET.Element, name: str, outline: Array, height: float, colour: str) -> None:
    middle = outline.mean(axis=0)
    model = ET.SubElement(parent, "model", name=name)
    ET.SubElement(model, "static").text = "true"
    ET.SubElement(model, "pose").text = f"{middle[0]:.6f} {middle[1]:.6f} 0 0 0 0"
    link = ET.SubElement(model, "link", name="link")
    for tag in ("collision", "visual"):
        part = ET.SubElement(link, tag, name=tag)
        shape = ET.SubElement(ET.SubElement(part, "geometry"), "polyline")
        for point in outline - middle:
            ET.SubElement(shape, "point").text = f"{point[0]:.6f} {point[1]:.6f}"
        ET.SubElement(shape, "height").text = f"{height:.6f}"
        if tag == "visual":
            material = ET.SubElement(part, "material")
            ET.SubElement(material, "ambient").text = colour
            ET.SubElement(material, "diffuse").text = colour
