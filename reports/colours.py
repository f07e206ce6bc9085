"""Colours of pictures and pages, the same in all of them."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap

#: one colour per robot, told apart by colour-blind readers too (Okabe and Ito, extended)
ROBOT_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc3f9b",
    "#b58900",
    "#56b4e9",
    "#7a3fc0",
    "#8c564b",
    "#3d8b37",
    "#e6194b",
    "#00798c",
    "#5c5c8a",
)
INK = "#1f2430"
WALL = "#30343f"
FURNITURE = "#c9bda6"
FURNITURE_EDGE = "#8d8069"
HUMAN = "#5b5b6b"
HUMAN_BLIND = "#a3238e"
ROOM = "#1f2430"
SAFE, UNSAFE = "#1a7f37", "#c1121f"


def robot_colour(number: int) -> str:
    """Colour (#rrggbb) of a robot, the same in every picture."""
    return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]


def costmap_image(costmap: Costmap) -> np.ndarray:
    """RGB ``(rows, cols, 3)`` uint8 of Nav2 bytes: white free, blue inflated, rose, grey."""
    return np.asarray(costmap_colours()[costmap.cost])


def costmap_colours() -> np.ndarray:
    """RGB ``(256, 3)`` uint8 of the values of a Nav2 costmap."""
    free, high = np.array([255, 255, 255]), np.array([150, 190, 232])
    share = np.linspace(0.0, 1.0, 253)[:, None]
    table = np.zeros((256, 3), dtype=np.uint8)
    table[:253] = (free + (high - free) * share).astype(np.uint8)
    table[INSCRIBED] = (246, 198, 208)
    table[LETHAL] = (226, 120, 138)
    table[UNKNOWN] = (232, 232, 232)
    return table
