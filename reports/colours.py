"""Colours of pictures and pages: one table for all painters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.fleet import Phase
from reports.floor_scene import Role

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
SOFT = "#555555"  # text that matters less
SAFE, UNSAFE = "#1a7f37", "#c1121f"

#: cells of a costmap: the highest inflated cost, inscribed, lethal and unknown ones
INFLATED, TOUCHING, OCCUPIED, UNSEEN = "#96bee8", "#f6c6d0", "#e2788a", "#e8e8e8"


class Paint(NamedTuple):
    """Colours of a role, on paper and in a page with dark colours."""

    fill: str
    edge: str
    dark_fill: str
    dark_edge: str


PAINTS = {
    Role.LANE: Paint("#d6dae3", "#7d8aa5", "#363c48", "#55617a"),
    Role.ROOM_AREA: Paint("#ffffff", "#6a7bb0", "#1c2027", "#6a7bb0"),
    Role.FURNITURE: Paint("#c9bda6", "#8d8069", "#6b6453", "#8d8069"),
    Role.SAMPLED_FURNITURE: Paint("#f2a541", "#8a4b00", "#c47d1f", "#f2c98a"),
    Role.WALL: Paint("#30343f", "#30343f", "#b9c0cc", "#b9c0cc"),
    Role.BLOCKAGE: Paint("#ffd9d9", UNSAFE, "#5c2a2a", "#ff6b6b"),
    Role.DOOR: Paint("#2aa198", "#2aa198", "#2aa198", "#2aa198"),
    Role.QUEUE_SPOT: Paint("#fff6cc", "#8a6d00", "#4a4326", "#c9a94a"),
    Role.PARKING: Paint("#e4f0e4", "#4c7a4c", "#2c3d2c", "#7fb07f"),
    Role.ROOM: Paint("#ffbf00", INK, "#ffbf00", "#e6e9ef"),
    Role.PERSON: Paint("#5b5b6b", "#ffffff", "#9a9ab0", "#1c2027"),
    Role.BLIND_PERSON: Paint("#a3238e", "#ffffff", "#d27bc4", "#1c2027"),
}


class PhasePaint(NamedTuple):
    """Colour of what a robot is doing, on paper and in a page with dark colours."""

    name: str  #: in style sheets; none of the roles' names
    light: str
    dark: str


PHASES = {
    Phase.IDLE: PhasePaint("idle", "#c9ced8", "#4a5160"),
    Phase.DRIVING: PhasePaint("driving", "#2a78b8", "#5aa7e6"),
    Phase.QUEUEING: PhasePaint("queueing", "#e0a100", "#e6b93c"),
    Phase.PLANNING: PhasePaint("planning", "#8e5bd0", "#b48cf0"),
    Phase.SERVING: PhasePaint("serving", "#2e9e5b", "#5cc98a"),
    Phase.PARKING: PhasePaint("making-room", "#6fb7c9", "#7fc6d6"),
}


class Shade(NamedTuple):
    """One colour of a page, in light and in dark."""

    light: str
    dark: str


#: text, lines, grounds; at least 4.5 to 1 between text and ground
PAGE = {
    "ink": Shade(INK, "#e6e9ef"),
    "soft": Shade("#5d6675", "#a2abba"),
    "line": Shade("#dde1e8", "#363c48"),
    "paper": Shade("#ffffff", "#1c2027"),
    "back": Shade("#f4f5f8", "#12151a"),
    "bad": Shade(UNSAFE, "#ff6b6b"),
    "good": Shade(SAFE, "#5cd68a"),
    "link": Shade("#1f5f99", "#7cb8ee"),
}


def robot_colour(number: int) -> str:
    """Colour (#rrggbb) of a robot, the same in every picture."""
    return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]


def person_colour(*, blind: bool) -> str:
    """Colour (#rrggbb) of a person, by whether the person ignores robots."""
    return PAINTS[Role.BLIND_PERSON if blind else Role.PERSON].fill


def css_variables() -> str:
    """Declare ``--ROLE``, ``--ROLE-edge``, ``--PHASE`` and the page's own colours.

    Dark ones hold on screens that ask for them, unless the page says ``data-theme``.
    """
    light, dark = (_declared(which) for which in (0, 1))
    return (
        f":root {{ color-scheme: light; {light} }}\n"
        "@media screen and (prefers-color-scheme: dark) "
        f"{{ :root:not([data-theme=light]) {{ color-scheme: dark; {dark} }} }}\n"
        f"@media screen {{ :root[data-theme=dark] {{ color-scheme: dark; {dark} }} }}"
    )


def _declared(which: int) -> str:
    """Declare all colours for light (0) or dark (1) pages."""
    shown = [(name, shade[which]) for name, shade in PAGE.items()]
    for role, paint in PAINTS.items():
        shown += [(str(role), paint[2 * which]), (f"{role}-edge", paint[2 * which + 1])]
    shown += [(paint.name, paint[1 + which]) for paint in PHASES.values()]
    return " ".join(f"--{name}: {colour};" for name, colour in shown)


def costmap_image(costmap: Costmap) -> np.ndarray:
    """RGB ``(rows, cols, 3)`` uint8 of Nav2 bytes, coloured as :func:`costmap_colours`."""
    return np.asarray(costmap_colours()[costmap.cost])


def costmap_colours() -> np.ndarray:
    """RGB ``(256, 3)`` uint8 of Nav2 bytes: white free, blue inflated, rose occupied, grey."""
    free, high = np.array([255, 255, 255]), np.array(_rgb(INFLATED))
    share = np.linspace(0.0, 1.0, INSCRIBED)[:, None]
    table = np.zeros((256, 3), dtype=np.uint8)
    table[:INSCRIBED] = (free + (high - free) * share).astype(np.uint8)
    for value, colour in ((INSCRIBED, TOUCHING), (LETHAL, OCCUPIED), (UNKNOWN, UNSEEN)):
        table[value] = _rgb(colour)
    return table


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(colour.removeprefix("#")))
