"""Build the AWS hospital layout from the published sources.

    python -m tools.build_aws_hospital ../shared/data [--picture]

reads the wall mesh, the furniture poses, the occupancy map and the published roadways below
the given folder and writes into ``scenic_worlds/layouts``:

- ``aws_hospital.json``: a whole :class:`~mrta_falsify.core.world.World`, repaired roadways;
- ``aws_hospital_as_published.json``: what differs from it with the published roadways;
- ``aws_hospital_day.json``: what the shipped fixed world adds (robots, humans, tasks);
- ``aws_hospital_map.png``: the occupied cells of the map, one bit each, row 0 at the top.

The sources are facts; what we designed ourselves (room names, the repaired road network,
parking) stands in the tables of this file. Lengths in metres, map frame.
"""

from __future__ import annotations

import itertools
import json
import math
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
import trimesh
import yaml
from PIL import Image
from scipy import ndimage
from scipy.spatial import cKDTree

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array, BoolArray, frozen_array
from mrta_falsify.core.geometry import signed_area, transform
from mrta_falsify.core.world import (
    Furniture,
    HumanSpec,
    Lane,
    Resource,
    RobotSpec,
    Room,
    Task,
    Wall,
    World,
    write_world,
)
from scenic_worlds.layouts import load_layout
from tools.map_overlay import (
    MAP_ORIGIN,
    MAP_RESOLUTION,
    draw_overlay,
    read_shipped_map,
)

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "aws_overlay.png"
OUT = Path(__file__).resolve().parents[1] / "scenic_worlds" / "layouts"
Point = tuple[float, float]
Points = list[Point]

# --- facts about the sources ------------------------------------------------------------

CUT_HEIGHT = 0.5  # m above the floor, between the bump rail (0.33) and the hand rail (0.77)
CENTIMETRE = 0.01  # the wall mesh is in centimetres
CAP_GAP = 0.14  # m, the wall mesh is open at door jambs; jambs are 0.116 m wide
SNAP = 0.012  # m, wall faces that differ by less are one plane (the mesh tilts by millimetres)
HIGHEST_FOOT = 1.2  # m, what hangs higher is no obstacle
RESOLUTION = 0.05  # m, my_map.yaml
OCCUPIED_THRESHOLD = 0.65  # my_map.yaml
ORIGIN = (-12.5, -35.0)  # m, my_map.yaml, lower left corner
EXPLAINED = 0.15  # m, an occupied cell this near to a shape is explained by it
SMALLEST_BLOB = 8  # cells, smaller residues of the map are lidar speckle

#: models that are no obstacle, or hollow and therefore drawn below
SKIPPED = (
    "floor_01",
    "Carpet",
    "Portrait",
    "TV_02",
    "ramp",
    "Shower",
    "elevator",
    "nursesstation",
    "curtain",
    "KitchenCabinet",
    "sun",
    "ground_plane",
)

KINDS = {
    "AdjTable": "desk",
    "AnesthesiaMachine": "machine",
    "BMWCart": "trolley",
    "BPCart": "trolley",
    "BedTable": "table",
    "BedsideTable": "cabinet",
    "BloodPressureMonitor": "machine",
    "CGMClassic": "bed",
    "Chair": "chair",
    "Drawer": "cabinet",
    "ElderLadyPatient": "bed",
    "ElderMalePatient": "bed",
    "FemaleVisitor": "mannequin",
    "FemaleVisitorSit": "mannequin",
    "IVStand": "stand",
    "InstrumentCart1": "trolley",
    "InstrumentCart2": "trolley",
    "KitchenSink": "sink",
    "MalePatientBed": "bed",
    "MaleVisitorOnPhone": "mannequin",
    "MaleVisitorSit": "mannequin",
    "MetalCabinet": "cabinet",
    "MopCart3": "trolley",
    "OfficeChairBlack": "chair",
    "ParkingTrolleyMax": "trolley",
    "ParkingTrolleyMin": "trolley",
    "PatientFSit": "mannequin",
    "PatientWheelChair": "wheelchair",
    "PotatoChipChair": "bench",
    "Scrubs": "mannequin",
    "StorageRack": "rack",
    "StorageRackCoverOpen": "rack",
    "StorageRackCovered": "rack",
    "SurgicalTrolley": "trolley",
    "SurgicalTrolleyMed": "trolley",
    "Toilet": "toilet",
    "TrolleyBed": "bed",
    "TrolleyBedPatient": "bed",
    "VendingMachine": "vending_machine",
    "VisitorKidSit": "mannequin",
    "WhiteChipChair": "bench",
    "XRayMachine": "machine",
    "aws_robomaker_residential_CoffeeTable_01": "table",
    "aws_robomaker_residential_Refrigerator_01": "cabinet",
    "aws_robomaker_residential_SofaB_01": "sofa",
    "aws_robomaker_residential_Sofa_01": "sofa",
    "aws_robomaker_residential_Trash_01": "bin",
    "aws_robomaker_warehouse_ClutteringA_01": "boxes",
    "aws_robomaker_warehouse_ClutteringC_01": "boxes",
}

#: cloth of the curtain models in their own frame, read off the map (all instances overlaid)
CURTAINS: dict[str, Points] = {
    "closed": [(-0.72, 1.4), (-0.74, -1.15), (-0.45, -1.5), (1.25, -1.5), (1.5, -1.2), (1.5, 1.4)],
    "half_open": [(-0.7, -1.0), (-0.7, 0.85), (-0.47, 1.05), (-0.42, 1.4)],
    "open": [(-0.72, 0.85), (-0.62, 1.35)],
}
CURTAIN_WIDTH = 0.16  # m, the folds

STATION_CENTRE = (0.0, 2.8)  # m, from the model's bounds: x -3.5..3.5, y 1.3..4.8 at (0, 1.5)
STATION_RADII = (3.1, 3.5)  # m, the outer one from the bounds, the inner one from the map
STATION_PIECES = 16

#: L-shaped kitchen in its bounding box: depth of both arms, from the map
KITCHEN_DEPTH = 0.68  # m

#: solids that the map only shows by their front edge
FRONTS = (
    ("elevator_lobby_west", "step", (-2.95, 16.95, -0.4, 19.35), 0.19),
    ("elevator_lobby_east", "step", (-0.4, 17.4, 2.93, 19.35), 0.19),
    ("stairs_west", "stairs", (-12.45, 19.05, -5.95, 20.92), 3.0),
    ("stairs_east", "stairs", (6.0, 19.05, 12.42, 20.92), 3.0),
)

# --- our own design: rooms --------------------------------------------------------------

ROOM_NAMES = (
    "nurses_station",
    "ward_northeast",
    "ward_southeast",
    "day_surgery",
    "ward_southwest",
    "ward_northwest",
)


def _station_inside(radius: float, low: float, half: tuple[float, float]) -> Points:
    """Half disc behind the counter, and the strip in front of it where robots stop."""
    x, y = STATION_CENTRE
    arc = [
        (x + radius * math.cos(a), y + radius * math.sin(a)) for a in np.linspace(0.0, math.pi, 13)
    ]
    return [(half[0], low), (half[1], low), (half[1], y - 0.1), *arc, (half[0], y - 0.1)]


def _box(x0: float, y0: float, x1: float, y1: float) -> Points:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


#: door segments between the jambs of the wall cut; the nurses' station is an open counter
DOORS: dict[int, Points] = {
    1: [(6.486, -9.814), (6.486, -8.314)],
    2: [(6.486, -23.814), (6.486, -22.314)],
    3: [(4.686, -26.014), (6.186, -26.014)],
    4: [(-6.514, -23.814), (-6.514, -22.314)],
    5: [(-6.514, -9.814), (-6.514, -8.314)],
}

AREAS: dict[int, Points] = {
    0: _station_inside(3.05, 1.4, (-1.0, 0.9)),
    1: _box(6.544, -9.957, 12.428, 3.928),
    2: _box(6.544, -23.953, 12.428, -10.072),
    3: [
        (-3.456, -31.956),
        (12.428, -31.956),
        (12.428, -24.068),
        (6.544, -24.068),
        (6.544, -26.072),
        (-3.456, -26.072),
    ],
    4: _box(-12.456, -23.953, -6.572, -10.072),
    5: _box(-12.456, -9.957, -6.572, 3.928),
}

#: the room, its doorway and the patch of corridor that entering robots need
RELEASE: dict[int, Points] = {
    0: _station_inside(3.05, 1.05, (-1.0, 0.9)),
    1: [
        (12.428, -9.957),
        (12.428, 3.928),
        (6.486, 3.928),
        (6.486, -8.1),
        (5.1, -8.1),
        (5.1, -9.957),
    ],
    2: [
        (12.428, -23.953),
        (12.428, -10.072),
        (6.486, -10.072),
        (6.486, -22.1),
        (5.1, -22.1),
        (5.1, -23.953),
    ],
    3: [
        (-3.456, -31.956),
        (12.428, -31.956),
        (12.428, -24.068),
        (6.486, -24.068),
        (6.486, -24.55),
        (4.45, -24.55),
        (4.45, -26.014),
        (-3.456, -26.014),
    ],
    4: [
        (-12.456, -23.953),
        (-5.1, -23.953),
        (-5.1, -22.1),
        (-6.514, -22.1),
        (-6.514, -10.072),
        (-12.456, -10.072),
    ],
    5: [
        (-12.456, -9.957),
        (-5.1, -9.957),
        (-5.1, -8.1),
        (-6.514, -8.1),
        (-6.514, 3.928),
        (-12.456, 3.928),
    ],
}

REQUEST_REACH = 5.0  # m, half the side of the published request box
ASK_BEFORE_TAIL = 4.5  # m, robots turn off their lane about 3 m before the tail spot

# --- our own design: the repaired road network ------------------------------------------
# Corridors are 2.88 m wide. Three tracks share the width: 0.65 m to the wall, the waiting
# spots, the lane beside them, the opposite lane, 0.67 m to the other wall.

EAST_SOUTHBOUND, EAST_NORTHBOUND, EAST_SPOTS = 4.22, 5.0, 5.78  # x
WEST_NORTHBOUND, WEST_SOUTHBOUND, WEST_SPOTS = -4.24, -5.02, -5.8  # x
A_WESTBOUND, A_EASTBOUND = -7.72, -9.46  # y, the corridor with the mop cart
B_WESTBOUND, B_EASTBOUND = -13.97, -15.2  # y
C_WESTBOUND, C_EASTBOUND, C_SPOTS = -23.75, -24.54, -25.3  # y
STATION_OUTBOUND, STATION_INBOUND, STATION_SPOTS = 0.7, 1.45, 2.15  # y

SPOTS: dict[int, Points] = {
    0: [(1.25 + 0.92 * k, STATION_SPOTS) for k in range(5)],
    1: [(EAST_SPOTS, -7.5 + k) for k in range(5)],
    2: [(EAST_SPOTS, -21.5 + k) for k in range(5)],
    3: [(4.0 - k, C_SPOTS) for k in range(5)],
    4: [(WEST_SPOTS, -21.5 + k) for k in range(5)],
    5: [(WEST_SPOTS, -7.5 + k) for k in range(5)],
}

#: from the head spot to the room point; doors are crossed 0.13 m right of their middle
ENTRY: dict[int, Points] = {
    0: [(0.0, 2.2)],
    1: [(5.7, -9.19), (7.4, -9.19), (8.9, -8.6), (8.9, -7.5), (7.9, -7.5)],
    2: [(5.7, -23.19), (7.4, -23.19), (8.8, -22.8), (8.8, -21.8), (7.85, -21.8)],
    3: [(5.32, -25.2), (5.32, -26.8), (4.25, -27.2)],
    4: [(-5.7, -22.94), (-7.2, -22.94), (-7.75, -22.4), (-7.75, -21.7)],
    5: [(-5.7, -8.94), (-7.2, -8.94), (-7.75, -8.3), (-7.75, -7.5)],
}

#: from the room point to the corridor in front of the door; the station has two ways out
LEAVE: dict[str, Points] = {
    "0 east": [(0.0, 1.2), (0.5, STATION_OUTBOUND), (3.85, STATION_OUTBOUND), (4.22, 0.33)],
    "0 west": [(-0.9, 2.0), (-3.3, 1.85), (-4.55, 0.72), (WEST_SOUTHBOUND, -0.2)],
    "1": [(7.9, -8.4), (7.3, -8.94), (5.7, -8.94)],
    "2": [(7.85, -22.4), (7.3, -22.94), (5.7, -22.94)],
    "3": [(4.25, -27.9), (5.4, -27.9), (5.55, -26.9), (5.55, -25.2)],
    "4": [(-8.6, -21.7), (-8.6, -22.8), (-7.4, -23.19), (-5.7, -23.19)],
    "5": [(-8.5, -7.5), (-8.5, -8.6), (-7.4, -9.19), (-5.7, -9.19)],
}

#: last waypoints before the tail spot, by the side one comes from
TO_TAIL: dict[str, Points] = {
    "0 east": [(EAST_NORTHBOUND, 0.1), (5.8, 1.0), (5.8, 2.0)],
    "0 west": [
        (WEST_NORTHBOUND, -0.4),
        (-3.98, 0.27),
        (-3.65, 0.57),
        (-3.3, STATION_OUTBOUND),
        (4.2, STATION_OUTBOUND),
        (5.8, 1.2),
        (5.8, 2.0),
    ],
    "1 north": [(EAST_SOUTHBOUND, -0.9), (EAST_SPOTS, -2.5)],
    "1 south": [(EAST_NORTHBOUND, -4.3)],
    "2 north": [(EAST_SOUTHBOUND, -15.1), (EAST_SPOTS, -16.4)],
    "2 west": [(3.9, B_EASTBOUND), (EAST_SPOTS, -16.4)],
    "2 south": [(EAST_NORTHBOUND, -18.3)],
    "3 north": [(EAST_SOUTHBOUND, -23.45), (3.92, C_WESTBOUND), (0.6, C_WESTBOUND), (-0.8, -24.9)],
    "3 east": [(4.5, C_WESTBOUND), (0.6, C_WESTBOUND), (-0.8, -24.9)],
    "3 west": [(-1.9, C_EASTBOUND), (-0.9, -25.2)],
    "4 north": [(WEST_SOUTHBOUND, -16.0), (WEST_SPOTS, -16.7)],
    "4 east": [
        (-3.95, C_WESTBOUND),
        (WEST_NORTHBOUND, -23.46),
        (WEST_NORTHBOUND, -16.9),
        (-5.2, -16.4),
    ],
    "5 north": [(WEST_SOUTHBOUND, -2.0), (WEST_SPOTS, -2.7)],
    "5 south": [(WEST_NORTHBOUND, -2.9), (-5.2, -2.4)],
    "5 east": [
        (-3.95, A_WESTBOUND),
        (WEST_NORTHBOUND, -7.43),
        (WEST_NORTHBOUND, -2.9),
        (-5.2, -2.4),
    ],
}

#: last waypoints before the entry of the room, by the side one comes from
TO_DOOR: dict[str, Points] = {
    "0 east": [(EAST_NORTHBOUND, 0.3), (4.4, STATION_INBOUND), (0.9, STATION_INBOUND)],
    "0 west": [
        (WEST_NORTHBOUND, -0.4),
        (-3.98, 0.27),
        (-3.65, 0.57),
        (-3.3, STATION_OUTBOUND),
        (-0.7, STATION_OUTBOUND),
    ],
    "1 north": [(EAST_SOUTHBOUND, -8.2)],
    "1 south": [(EAST_NORTHBOUND, -9.9)],
    "1 west": [(4.4, A_EASTBOUND)],
    "2 north": [(EAST_SOUTHBOUND, -22.2)],
    "2 west": [(3.9, B_EASTBOUND), (EAST_SOUTHBOUND, -15.52), (EAST_SOUTHBOUND, -22.2)],
    "2 south": [],
    "3 north": [(EAST_SOUTHBOUND, -23.6)],
    "3 east": [(4.7, -23.55), (4.75, -24.4)],
    "3 west": [(4.4, C_EASTBOUND)],
    "4 north": [(WEST_SOUTHBOUND, -22.3)],
    "4 east": [(-4.4, C_WESTBOUND)],
    "5 north": [(WEST_SOUTHBOUND, -8.3)],
    "5 south": [(WEST_NORTHBOUND, -9.9)],
    "5 east": [(-4.0, A_WESTBOUND)],
}


@dataclass(frozen=True)
class Route:
    """How one lane is put together from the tables above."""

    leave: str  #: key of LEAVE
    tail: str  #: key of TO_TAIL
    door: str  #: key of TO_DOOR
    way: Points  #: waypoints between them, shared by both
    way_to_tail: Points | None = None  #: in their place on the way to the queue


_NORTH_TO_B_WEST: Points = [(EAST_NORTHBOUND, -14.8), (4.2, B_WESTBOUND), (-3.95, B_WESTBOUND)]

ROUTES: dict[tuple[int, int], Route] = {
    (0, 1): Route("0 east", "1 north", "1 north", []),
    (0, 2): Route("0 east", "2 north", "2 north", []),
    (0, 3): Route("0 east", "3 north", "3 north", []),
    (0, 4): Route("0 west", "4 north", "4 north", []),
    (0, 5): Route("0 west", "5 north", "5 north", []),
    (1, 0): Route("1", "0 east", "0 east", [(EAST_NORTHBOUND, -8.2)]),
    (1, 2): Route("1", "2 north", "2 north", [(EAST_SOUTHBOUND, -9.7)]),
    (1, 3): Route("1", "3 north", "3 north", [(EAST_SOUTHBOUND, -9.7)]),
    (1, 4): Route(
        "1",
        "4 north",
        "4 north",
        [
            (EAST_SOUTHBOUND, -9.7),
            (EAST_SOUTHBOUND, -13.68),
            (3.93, B_WESTBOUND),
            (-4.2, B_WESTBOUND),
            (WEST_SOUTHBOUND, -14.8),
        ],
    ),
    (1, 5): Route("1", "5 east", "5 east", [(4.4, A_WESTBOUND)]),
    (2, 0): Route("2", "0 east", "0 east", [(EAST_NORTHBOUND, -22.2)]),
    (2, 1): Route("2", "1 south", "1 south", [(EAST_NORTHBOUND, -22.2)]),
    (2, 3): Route("2", "3 east", "3 east", []),
    (2, 4): Route("2", "4 east", "4 east", [(4.5, C_WESTBOUND)]),
    (2, 5): Route(
        "2",
        "5 south",
        "5 south",
        [(EAST_NORTHBOUND, -22.2), *_NORTH_TO_B_WEST, (WEST_NORTHBOUND, -13.68)],
    ),
    (3, 0): Route("3", "0 east", "0 east", [(EAST_NORTHBOUND, -24.1)]),
    (3, 1): Route("3", "1 south", "1 south", [(EAST_NORTHBOUND, -24.1)]),
    (3, 2): Route("3", "2 south", "2 south", [(5.55, -23.7)], [(EAST_NORTHBOUND, -24.1)]),
    (3, 4): Route("3", "4 east", "4 east", [(4.3, C_WESTBOUND)]),
    (3, 5): Route(
        "3",
        "5 south",
        "5 south",
        [(EAST_NORTHBOUND, -24.1), *_NORTH_TO_B_WEST, (WEST_NORTHBOUND, -13.68)],
    ),
    (4, 0): Route("4", "0 west", "0 west", [(WEST_NORTHBOUND, -22.5)]),
    (4, 1): Route(
        "4",
        "1 south",
        "1 south",
        [
            (WEST_NORTHBOUND, -22.5),
            (WEST_NORTHBOUND, -15.52),
            (-3.92, B_EASTBOUND),
            (4.3, B_EASTBOUND),
            (EAST_NORTHBOUND, -14.4),
        ],
    ),
    (4, 2): Route(
        "4",
        "2 south",
        "2 south",
        [(-4.5, C_EASTBOUND), (4.6, C_EASTBOUND)],
        [(-4.5, C_EASTBOUND), (4.4, C_EASTBOUND), (EAST_NORTHBOUND, -23.9)],
    ),
    (4, 3): Route("4", "3 west", "3 west", [(-4.5, C_EASTBOUND)]),
    (4, 5): Route("4", "5 south", "5 south", [(WEST_NORTHBOUND, -22.5)]),
    (5, 0): Route("5", "0 west", "0 west", [(WEST_NORTHBOUND, -8.5)]),
    (5, 1): Route(
        "5",
        "1 south",
        "1 west",
        [(-4.5, A_EASTBOUND)],
        [(-4.5, A_EASTBOUND), (4.3, A_EASTBOUND), (EAST_NORTHBOUND, -8.7)],
    ),
    (5, 2): Route(
        "5",
        "2 west",
        "2 west",
        [(WEST_SOUTHBOUND, -9.9), (WEST_SOUTHBOUND, -14.4), (-4.3, B_EASTBOUND)],
    ),
    (5, 3): Route(
        "5",
        "3 west",
        "3 west",
        [(WEST_SOUTHBOUND, -9.9), (WEST_SOUTHBOUND, -23.8), (-4.4, C_EASTBOUND)],
    ),
    (5, 4): Route("5", "4 north", "4 north", [(WEST_SOUTHBOUND, -9.9)]),
}

#: places for idle robots, outside every room so that reaching them frees the room
PARKING: Points = [
    (3.2, -4.25),
    (3.2, -2.75),
    (-3.22, -4.25),
    (-3.22, -2.75),
    (6.01, -11.2),
    (6.01, -12.7),
    (6.01, -14.2),
    (-6.03, -11.2),
    (-6.03, -12.7),
    (-6.03, -14.2),
    (-2.7, -25.55),
    (-5.0, -27.3),
    (-5.0, -28.8),
    (-5.0, -30.3),
    (5.75, 4.4),
    (-4.7, 3.4),
]

UNREACTIVE = ("human3", "human6", "human8")
EPISODE = 900.0  # s


# --- walls ------------------------------------------------------------------------------

_COLLADA = {"c": "http://www.collada.org/2005/11/COLLADASchema"}


def read_wall_mesh(path: Path) -> trimesh.Trimesh:
    """All parts of the COLLADA wall mesh as one mesh in metres, z up.

    Every node of the file turns its part by Rz(-270 deg), then Ry(90 deg): (a, b, c) becomes
    (c, a, b). The parts lie in the model's frame; the model's pose is not applied.
    """
    root = ET.parse(path).getroot()
    parts = []
    for geometry in root.findall(".//c:geometry", _COLLADA):
        positions = geometry.find(".//c:vertices/c:input", _COLLADA)
        assert positions is not None
        source = geometry.find(f".//c:source[@id='{positions.attrib['source'][1:]}']", _COLLADA)
        assert source is not None
        numbers = source.findtext("c:float_array", "", _COLLADA).split()
        vertices = np.array(numbers, dtype=float).reshape(-1, 3)[:, [2, 0, 1]] * CENTIMETRE
        faces: list[tuple[int, int, int]] = []
        for polylist in geometry.findall(".//c:polylist", _COLLADA):
            faces.extend(_triangles(polylist))
        parts.append(trimesh.Trimesh(vertices, faces, process=False))
    return trimesh.util.concatenate(parts)


def _triangles(polylist: ET.Element) -> list[tuple[int, int, int]]:
    inputs = polylist.findall("c:input", _COLLADA)
    stride = max(int(item.attrib["offset"]) for item in inputs) + 1
    offset = next(int(i.attrib["offset"]) for i in inputs if i.attrib["semantic"] == "VERTEX")
    indices = np.array(polylist.findtext("c:p", "", _COLLADA).split(), dtype=int)
    corners = indices.reshape(-1, stride)[:, offset]
    triangles: list[tuple[int, int, int]] = []
    start = 0
    for size in map(int, polylist.findtext("c:vcount", "", _COLLADA).split()):
        fan = corners[start : start + size]
        triangles += [(fan[0], fan[j], fan[j + 1]) for j in range(1, size - 1)]
        start += size
    return triangles


def cut_walls(mesh: trimesh.Trimesh, height: float, offset: Point) -> shapely.Geometry:
    """Area [map frame] that the walls cover ``height`` [m] above the floor.

    The mesh is a surface without end caps, so the cut is a set of polylines that end in pairs
    at the door jambs; each pair is joined before the faces are collected.
    """
    segments = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, height])[:, :, :2]
    segments = np.round(segments, 4) + np.asarray(offset)
    segments = segments[np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 1e-6]
    ends = segments.reshape(-1, 2)
    degree = np.array([len(n) for n in cKDTree(ends).query_ball_point(ends, 1e-3)])
    loose = ends[degree == 1]
    caps = [loose[[i, j]] for i, j in sorted(cKDTree(loose).query_pairs(CAP_GAP))]
    lines = shapely.linestrings(np.concatenate([segments, np.array(caps)]))
    network = shapely.unary_union(shapely.multilinestrings(list(lines)), grid_size=1e-3)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(network)))
    thin = 2.0 * shapely.area(faces) / shapely.length(faces) < 0.25  # rooms are no walls
    return shapely.union_all(faces[thin])


def _planes(values: Array) -> Array:
    """Sorted coordinates with those closer than SNAP merged."""
    groups: list[list[float]] = []
    for value in np.sort(values):
        if groups and value - groups[-1][-1] <= SNAP and value - groups[-1][0] <= 2 * SNAP:
            groups[-1].append(float(value))
        else:
            groups.append([float(value)])
    return np.round([(group[0] + group[-1]) / 2 for group in groups], 3)


def split_into_rectangles(area: shapely.Geometry) -> list[tuple[float, float, float, float]]:
    """Disjoint rectangles that cover an axis-parallel ``area``, the longest first taken."""
    corners = shapely.get_coordinates(shapely.simplify(area, SNAP))
    xs, ys = _planes(corners[:, 0]), _planes(corners[:, 1])
    mid_x, mid_y = (xs[1:] + xs[:-1]) / 2, (ys[1:] + ys[:-1]) / 2
    open_cells = shapely.contains_xy(area, *np.meshgrid(mid_x, mid_y, indexing="ij"))
    rectangles = []
    while open_cells.any():
        along_x = _run_lengths(open_cells, np.diff(xs))
        along_y = _run_lengths(open_cells.T, np.diff(ys)).T
        if along_x.max() >= along_y.max():
            i, j = np.unravel_index(int(along_x.argmax()), along_x.shape)
            a, b, c, d = _grow(open_cells, int(i), int(j))
        else:
            i, j = np.unravel_index(int(along_y.argmax()), along_y.shape)
            c, d, a, b = _grow(open_cells.T, int(j), int(i))
        open_cells[a : b + 1, c : d + 1] = False
        rectangles.append((float(xs[a]), float(ys[c]), float(xs[b + 1]), float(ys[d + 1])))
    slivers = [r for r in rectangles if min(r[2] - r[0], r[3] - r[1]) < 2 * SNAP]
    return sorted(r for r in rectangles if r not in slivers)


def _run_lengths(cells: BoolArray, widths: Array) -> Array:
    lengths = np.zeros(cells.shape)
    for column in range(cells.shape[1]):
        labels, count = ndimage.label(cells[:, column])
        if count:
            totals = np.concatenate([[0.0], ndimage.sum(widths, labels, range(1, count + 1))])
            lengths[:, column] = totals[labels]
    return lengths


def _grow(cells: BoolArray, i: int, j: int) -> tuple[int, int, int, int]:
    """Longest run through ``(i, j)`` along the first axis, widened along the second."""
    a = b = i
    while a > 0 and cells[a - 1, j]:
        a -= 1
    while b + 1 < cells.shape[0] and cells[b + 1, j]:
        b += 1
    c = d = j
    while c > 0 and cells[a : b + 1, c - 1].all():
        c -= 1
    while d + 1 < cells.shape[1] and cells[a : b + 1, d + 1].all():
        d += 1
    return a, b, c, d


def _outline(points: Sequence[Point] | Array) -> Array:
    """Counter-clockwise outline ``(V, 2)`` [m], rounded to the millimetre."""
    outline = np.round(np.asarray(points, dtype=float), 3)
    return frozen_array(outline if signed_area(outline) > 0 else outline[::-1])


def build_walls(data: Path, models: list[Model]) -> tuple[Wall, ...]:
    """The wall cut as rectangles."""
    pose = next(m.pose for m in models if "walls" in m.model)
    mesh = read_wall_mesh(data / "aws_robomaker_hospital_floor_01_walls_collision.dae")
    area = cut_walls(mesh, CUT_HEIGHT, (pose[0], pose[1]))
    return tuple(
        Wall(name=f"wall_{k:03d}", polygon=_outline(_box(*rectangle)), height=3.0)
        for k, rectangle in enumerate(split_into_rectangles(area))
    )


# --- furniture --------------------------------------------------------------------------


@dataclass(frozen=True)
class Model:
    """One entry of hospital.world."""

    name: str
    model: str
    pose: tuple[float, ...]  #: x, y, z [m], roll, pitch, yaw [rad]


def read_models(path: Path) -> list[Model]:
    """The included models of the SDF world."""
    models = []
    for element in ET.parse(path).getroot().iter("model"):
        uri = element.findtext("include/uri")
        if uri is None:
            continue
        numbers = element.findtext("include/pose", "0 0 0 0 0 0").split()
        pose = tuple(map(float, numbers))
        models.append(Model(element.attrib["name"], uri.removeprefix("model://"), pose))
    return models


def _short(name: str) -> str:
    """Name without the makers' prefix, ``aws_robomaker_residential_`` and the like."""
    return re.sub(r"^aws_robomaker_[a-z]+_", "", name)


def build_furniture(models: list[Model], bounds: dict[str, Any]) -> list[Furniture]:
    """Oriented boxes of the solid models, and the drawn shapes of the hollow ones."""
    items: list[Furniture] = []
    seen: set[tuple[float, ...]] = set()
    for item in models:
        low, high = bounds[item.model]["min_m"], bounds[item.model]["max_m"]
        x, y, z, _, _, yaw = item.pose
        fallen = z < -1.0  # three models fell through the floor when the world was saved
        if any(word in item.model for word in SKIPPED) or fallen or z + low[2] > HIGHEST_FOOT:
            continue
        box = np.array(_box(low[0], low[1], high[0], high[1]))
        outline = _outline(transform(box, (x, y, yaw)))
        key = tuple(outline.ravel())
        if key in seen:  # InstrumentCart1 stands twice at one pose
            continue
        seen.add(key)
        items.append(
            Furniture(
                name=_short(item.name),
                kind=KINDS[item.model],
                polygon=outline,
                height=round(z + high[2], 3),
                mesh=item.model,
            )
        )
    return items + _kitchen(models, bounds) + _nurses_station() + _curtains(models)


def _kitchen(models: list[Model], bounds: dict[str, Any]) -> list[Furniture]:
    kitchen = next(m for m in models if "KitchenCabinet" in m.model)
    low, high = bounds[kitchen.model]["min_m"], bounds[kitchen.model]["max_m"]
    arms = (
        _box(low[0], low[1], low[0] + KITCHEN_DEPTH, high[1] - KITCHEN_DEPTH),
        _box(low[0], high[1] - KITCHEN_DEPTH, high[0], high[1]),
    )
    x, y, _, _, _, yaw = kitchen.pose
    return [
        Furniture(
            name=f"KitchenCabinet_01_1_{side}",
            kind="cabinet",
            polygon=_outline(transform(np.array(arm), (x, y, yaw))),
            height=round(high[2], 3),
            mesh=kitchen.model,
        )
        for side, arm in zip("ab", arms, strict=True)
    ]


def _nurses_station() -> list[Furniture]:
    """The half-ring counter, as convex sectors; its middle stays free."""
    inner, outer = STATION_RADII
    angles = np.linspace(0.0, math.pi, STATION_PIECES + 1)
    ring = np.array([[math.cos(a), math.sin(a)] for a in angles])
    centre = np.array(STATION_CENTRE)
    return [
        Furniture(
            name=f"nurses_station_{k:02d}",
            kind="counter",
            polygon=_outline(
                centre + np.stack([inner * near, outer * near, outer * far, inner * far])
            ),
            height=1.143,
            mesh="aws_robomaker_hospital_nursesstation_01",
        )
        for k, (near, far) in enumerate(itertools.pairwise(ring))
    ]


def _curtains(models: list[Model]) -> list[Furniture]:
    items = []
    for item in models:
        if "curtain" not in item.model:
            continue
        kind = item.model.split("curtain_")[1].removesuffix("_01")
        path = np.array(CURTAINS[kind])
        for k, (start, end) in enumerate(itertools.pairwise(path)):
            along = (end - start) / np.linalg.norm(end - start)
            side = np.array([-along[1], along[0]]) * CURTAIN_WIDTH / 2
            reach = along * CURTAIN_WIDTH / 4  # so that neighbours overlap at the bend
            piece = np.array(
                [start - reach - side, end + reach - side, end + reach + side, start - reach + side]
            )
            x, y, _, _, _, yaw = item.pose
            items.append(
                Furniture(
                    name=f"{_short(item.name)}_{k}",
                    kind="curtain",
                    polygon=_outline(transform(piece, (x, y, yaw))),
                    height=3.0,
                    mesh=item.model,
                    traced=True,
                )
            )
    return items


def _fronts() -> list[Furniture]:
    return [
        Furniture(name=name, kind=kind, polygon=_outline(_box(*box)), height=height, traced=True)
        for name, kind, box, height in FRONTS
    ]


# --- residues of the map ----------------------------------------------------------------


def read_occupied(path: Path) -> BoolArray:
    """Occupied cells ``(rows, columns)`` of the PGM map, row 0 at the bottom (y = -35 m)."""
    pixels = np.asarray(Image.open(path))
    return (255 - pixels[::-1].astype(int)) / 255 > OCCUPIED_THRESHOLD


def trace_residues(occupied: BoolArray, shapes: list[Array]) -> list[Furniture]:
    """Thin convex hulls around occupied cells that no shape explains.

    Args:
        occupied: ``(rows, columns)``, row 0 at the bottom.
        shapes: outlines ``(V, 2)`` [m] of everything known.
    """
    solid = shapely.union_all([shapely.Polygon(s) for s in shapes])
    rows, columns = np.nonzero(occupied)
    centres = np.stack([columns + 0.5, rows + 0.5], axis=1) * RESOLUTION + ORIGIN
    far = shapely.distance(shapely.points(centres), solid) > EXPLAINED
    residue = np.zeros(occupied.shape, dtype=np.uint8)
    residue[rows[far], columns[far]] = 1
    joined = cv2.dilate(residue, np.ones((3, 3), np.uint8))
    labels, count = ndimage.label(joined, np.ones((3, 3)))
    items: list[Furniture] = []
    for label in range(1, count + 1):
        rows, columns = np.nonzero((labels == label) & (residue == 1))
        if len(rows) < SMALLEST_BLOB:
            continue
        blob = np.stack([columns, rows], axis=1).astype(float)
        for piece in _convex_pieces(blob):
            squares = np.concatenate(
                [piece + np.array(corner) for corner in ((0, 0), (1, 0), (0, 1), (1, 1))]
            )
            hull = shapely.convex_hull(shapely.multipoints(squares * RESOLUTION + ORIGIN))
            outline = np.array(shapely.simplify(hull, 0.02).exterior.coords)[:-1]
            items.append(
                Furniture(
                    name=f"traced_{len(items):02d}",
                    kind="unknown",
                    polygon=_outline(outline),
                    height=1.0,
                    traced=True,
                )
            )
    return items


def _convex_pieces(cells: Array) -> list[Array]:
    """Cells split along their longer side until each hull is small or well filled."""
    size = np.ptp(cells, axis=0) + 1
    if size.max() <= 8 or size.min() <= 4:
        return [cells]
    axis = int(size.argmax())
    cut = cells[:, axis].min() + size[axis] / 2
    halves = (cells[cells[:, axis] < cut], cells[cells[:, axis] >= cut])
    return [piece for half in halves if len(half) for piece in _convex_pieces(half)]


# --- rooms, lanes, resources ------------------------------------------------------------


def _polyline(points: Sequence[Sequence[float]]) -> Array:
    return frozen_array(np.round(np.asarray(points, dtype=float), 3))


def build_rooms(locations: dict[str, list[float]]) -> tuple[Room, ...]:
    """The six rooms at the published locations."""
    return tuple(
        Room(
            name=name,
            point=frozen_array(locations[str(k)]),
            door=_polyline(DOORS[k]) if k in DOORS else frozen_array(np.zeros((0, 2))),
            area=_outline(AREAS[k]),
        )
        for k, name in enumerate(ROOM_NAMES)
    )


def build_lanes() -> tuple[Lane, ...]:
    """The repaired lanes of all ordered pairs of rooms."""
    lanes = []
    for (start, end), route in sorted(ROUTES.items()):
        leave = LEAVE[route.leave]
        way_to_tail = route.way if route.way_to_tail is None else route.way_to_tail
        to_queue = [*leave, *way_to_tail, *TO_TAIL[route.tail], SPOTS[end][-1]]
        to_room = [*leave, *route.way, *TO_DOOR[route.door], *ENTRY[end]]
        lanes.append(
            Lane(start=start, end=end, to_queue=_polyline(to_queue), to_room=_polyline(to_room))
        )
    return tuple(lanes)


def _request_box(point: Array) -> Array:
    x, y = map(float, point)
    reach = REQUEST_REACH
    return _outline(_box(x - reach, y - reach, x + reach, y + reach))


def _request_area(point: Array, spots: Array) -> Array:
    """The published box, grown so that a robot asks before its lane turns off to the tail."""
    box = shapely.Polygon(_request_box(point))
    queue = shapely.LineString(spots).buffer(ASK_BEFORE_TAIL, quad_segs=2)
    return _outline(shapely.get_coordinates(box.union(queue).convex_hull)[:-1])


def build_resources(rooms: tuple[Room, ...]) -> tuple[Resource, ...]:
    """One exclusive resource per room, with our waiting spots."""
    return tuple(
        Resource(
            name=room.name,
            kind="room",
            room=k,
            spots=_polyline(SPOTS[k]),
            entry=_polyline(ENTRY[k]),
            request_area=_request_area(room.point, np.array(SPOTS[k])),
            release_area=_outline(RELEASE[k]),
        )
        for k, room in enumerate(rooms)
    )


def published_lanes(source: dict[str, Any]) -> tuple[Lane, ...]:
    """The lanes exactly as published."""
    pairs = sorted(tuple(map(int, key.split("->"))) for key in source["roadways_to_queue"])
    return tuple(
        Lane(
            start=a,
            end=b,
            to_queue=frozen_array(source["roadways_to_queue"][f"{a}->{b}"]),
            to_room=frozen_array(source["roadways_to_room"][f"{a}->{b}"]),
        )
        for a, b in pairs
    )


def published_resources(source: dict[str, Any], rooms: tuple[Room, ...]) -> tuple[Resource, ...]:
    """The queues exactly as published; a room is released by leaving its request box."""
    return tuple(
        Resource(
            name=room.name,
            kind="room",
            room=k,
            spots=frozen_array(source["queue_positions"][str(k)]),
            entry=frozen_array(source["queue_to_room"][str(k)]),
            request_area=_request_box(room.point),
            release_area=_request_box(room.point),
        )
        for k, room in enumerate(rooms)
    )


# --- actors -----------------------------------------------------------------------------


def build_robots(setup: dict[str, Any], lanes: tuple[Lane, ...]) -> tuple[RobotSpec, ...]:
    """The six robots at their published starts, facing the way out."""
    robots = []
    for k, (name, item) in enumerate(setup["agents"].items()):
        x, y = item["start"]
        ahead = next(lane for lane in lanes if lane.start == k).to_room[0]
        yaw = math.atan2(float(ahead[1]) - y, float(ahead[0]) - x)
        robots.append(RobotSpec(name=name, pose=frozen_array([x, y, yaw])))
    return tuple(robots)


def build_humans(routes: dict[str, list[list[float]]]) -> tuple[HumanSpec, ...]:
    """The eight published walkers; three of them do not give way to robots."""
    names = {actor: actor.replace("actor", "human") for actor in sorted(routes)}
    return tuple(
        HumanSpec(
            name=name, route=frozen_array(routes[actor]), reacts_to_robots=name not in UNREACTIVE
        )
        for actor, name in names.items()
    )


def build_tasks(stream: dict[str, Any]) -> tuple[Task, ...]:
    """The task stream; deadlines in the file are absolute."""
    return tuple(
        Task(
            arrival=float(batch["arrival"]),
            start=task["start"],
            end=task["end"],
            deadline=float(task["deadline"]),
        )
        for batch in stream["tasks_stream"]
        for task in batch["tasks"]
    )


# --- writing ----------------------------------------------------------------------------


def _write_change(file: str, layout: str, **fields: Any) -> None:
    data = {"layout": layout, "replace": codec.encode(fields)}
    (OUT / f"{file}.json").write_text(codec.canonical_json(data) + "\n", encoding="utf-8")


def main(data: Path) -> None:
    """Write all layout files from the sources below ``data``."""
    source_dir = data / "aws_hospital"
    source = json.loads((source_dir / "locations_roadways_queues.json").read_text())
    models = read_models(source_dir / "hospital.world")
    bounds = json.loads((source_dir / "furniture_bounds.json").read_text())
    occupied = read_occupied(source_dir / "my_map.pgm")
    walls = build_walls(source_dir, models)
    furniture = build_furniture(models, bounds) + _fronts()
    solids: list[Wall | Furniture] = [*walls, *furniture]
    furniture += trace_residues(occupied, [item.polygon for item in solids])
    rooms = build_rooms(source["locations"])
    layout = World(
        name="aws_hospital",
        bounds=frozen_array([-12.6, -35.1, 12.6, 21.1]),
        walls=walls,
        furniture=tuple(furniture),
        rooms=rooms,
        lanes=build_lanes(),
        resources=build_resources(rooms),
        parking=_polyline(PARKING),
        travel_times=frozen_array(source["travel_time_s"]),
        horizon=EPISODE,
    )
    OUT.mkdir(parents=True, exist_ok=True)
    write_world(layout, OUT / "aws_hospital.json")
    _write_change(
        "aws_hospital_as_published",
        "aws_hospital",
        name="aws_hospital_as_published",
        lanes=published_lanes(source),
        resources=published_resources(source, rooms),
    )
    setup = json.loads((source_dir / "robot_setup_6.json").read_text())
    stream_file = data / "smrta" / "simulation" / "testcase_6agents_3_3.json"
    robots = build_robots(setup, layout.lanes)
    humans = build_humans(yaml.safe_load((source_dir / "humans_waypoint_config3.yaml").read_text()))
    _write_change(
        "aws_hospital_day",
        "aws_hospital",
        name="aws_hospital_day",
        robots=robots,
        humans=humans,
        tasks=build_tasks(json.loads(stream_file.read_text())),
    )
    image = Image.fromarray(np.where(occupied[::-1], 0, 255).astype(np.uint8)).convert("1")
    image.save(OUT / "aws_hospital_map.png", optimize=True)
    traced = sum(item.traced for item in furniture)
    print(f"{len(walls)} walls, {len(furniture)} pieces of furniture, {traced} of them traced")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
    if "--picture" in sys.argv[2:]:
        draw_overlay(
            load_layout("aws_hospital"), read_shipped_map(), MAP_RESOLUTION, MAP_ORIGIN, PICTURE
        )
