"""An Open-RMF building that tests draw themselves: three places, a door, a single-file passage.

Level ``ground`` is drawn at 0.05 m a pixel, y down; ``upper`` is the same floor, drawn turned by
90 degrees, shifted, at another scale. The building is 16 x 8 m::

    x 0 ........ 8 ....... 16
      store  | passage |  ward
             +- closet -+
"""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml

PIXEL = 0.05  # m
#: name, place [m] (y up), parameters
POINTS: list[tuple[str, tuple[float, float], dict[str, Any]]] = [
    ("", (0.0, 0.0), {}),
    ("", (16.0, 0.0), {}),
    ("", (16.0, -8.0), {}),
    ("", (0.0, -8.0), {}),
    ("", (6.0, 0.0), {}),  # 4: wall with the door
    ("", (6.0, -2.4), {}),
    ("", (6.0, -3.6), {}),
    ("", (6.0, -8.0), {}),
    ("", (10.0, 0.0), {}),  # 8: wall with an opening
    ("", (10.0, -2.2), {}),
    ("", (10.0, -3.8), {}),
    ("", (10.0, -8.0), {}),
    ("", (6.0, -5.0), {}),  # 12: wall of the closet, with a door that no lane passes
    ("", (7.0, -5.0), {}),
    ("", (8.2, -5.0), {}),
    ("", (10.0, -5.0), {}),
    ("store", (3.0, -3.0), {"is_holding_point": [4, True]}),  # 16
    ("ward", (13.0, -3.0), {}),
    ("desk", (13.0, -6.5), {}),
    ("", (5.0, -3.0), {}),  # 19
    ("", (11.0, -3.0), {}),
    ("dock_1", (3.0, -6.0), {"is_charger": [4, True], "spawn_robot_name": [1, "ada"]}),  # 21
    ("dock_2", (1.5, -1.5), {"is_charger": [4, True], "spawn_robot_name": [1, "bob"]}),
    ("", (11.5, -1.0), {"is_holding_point": [4, True]}),  # 23
]
WALLS = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (6, 7), (8, 9), (10, 11), (12, 13), (14, 15)]
DOORS = [(5, 6, "store_door"), (13, 14, "closet_door")]
#: from, to, both ways, parameters
LANES: list[tuple[int, int, bool, dict[str, Any]]] = [
    (16, 19, True, {}),
    (19, 20, True, {"mutex": [1, "passage"], "speed_limit": [3, 0.5]}),
    (20, 17, True, {}),
    (17, 18, False, {}),
    (18, 20, False, {}),
    (16, 21, True, {}),
    (16, 22, True, {}),
    (20, 23, True, {}),
]


def building(levels: tuple[str, ...] = ("ground",)) -> dict[str, Any]:
    """Write the building as YAML-shaped data."""
    return {
        "coordinate_system": "reference_image",
        "name": "clinic",
        "levels": {name: _level(name) for name in levels},
        "lifts": {},
    }


def text(levels: tuple[str, ...] = ("ground",)) -> str:
    """Write the building as a file."""
    return yaml.safe_dump(building(levels), sort_keys=False)


def _level(name: str) -> dict[str, Any]:
    def pixel(point: tuple[float, float]) -> list[float]:
        x, y = np.array(point) / PIXEL
        if name == "upper":  # turned by 90 degrees, half the scale
            x, y = 0.5 * y + 300.0, -0.5 * x + 40.0
        return [float(x), float(-y)]

    return {
        "vertices": [[*pixel(point), 0, label, given] for label, point, given in POINTS],
        "walls": [[a, b, {"texture_height": [3, 2.5]}] for a, b in WALLS],
        "doors": [[a, b, {"name": [1, label]}] for a, b, label in DOORS],
        "lanes": [
            [a, b, {"bidirectional": [4, both], "graph_idx": [2, 0], **given}]
            for a, b, both, given in LANES
        ],
        "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}],
        "measurements": [
            [0, 1, {"distance": [3, 16.0]}],
            [1, 2, {"distance": [3, 8.0]}],
        ],
        "fiducials": [
            [*pixel((0.0, 0.0)), "a"],
            [*pixel((16.0, 0.0)), "b"],
            [*pixel((4.0, -8.0)), "c"],
        ],
        "models": [{"model_name": "OpenRobotics/Desk", "name": "desk", "x": 1, "y": 2, "z": 0}],
    }
