"""The wait-for graph of a failure as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.wait_account import PUSHED, Arrow, WaitAccount
from mrta_falsify.core.world import World
from reports.colours import robot_colour
from reports.svg import Drawing

WIDTH, FLAT_HEIGHT, HEIGHT = 360.0, 130.0, 320.0  # px; flat with two nodes
RING = 105.0  # px, radius of the ring of nodes
NODE = 30.0  # px, radius
RIM = 34.0  # px between the middle of a node and the end of an arrow
APART = 14.0  # px that an arrow lies beside the line between its nodes
FITS = 8  # letters of a name inside its node
NO_ROBOT = "#6b6b80"  # nodes of people, rooms and solids; white text reads on it
SHARES = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)  # of its arrow, where a label may be, the best first
BESIDE = (2.2, 1.0)  # times APART: beside its arrow, or on it
LETTER, LINE = 6.0, 13.0  # px, width of a label's letter and height of its line
ROOT_RIM = 3.0  # px, width of the line around the root of a deadlock


def draw_wait_graph(account: WaitAccount, world: World) -> Markup:
    """Draw who waits for whom: a node per robot, person or thing, an arrow per wait.

    The root of a deadlock has a rim.
    """
    names = account.nodes
    height = FLAT_HEIGHT if len(names) == 2 else HEIGHT
    label = "wait-for graph: " + ", ".join(map(_arrow_text, account.arrows))
    drawing = Drawing(WIDTH, height, label=label)
    places = _places(names, np.array([WIDTH / 2.0, height / 2.0]))
    for arrow in account.arrows:
        _draw_arrow(drawing, arrow, places[arrow.start], places[arrow.end])
    numbers = {robot.name: i for i, robot in enumerate(world.robots)}
    for name, (x, y) in places.items():
        colour = robot_colour(numbers[name]) if name in numbers else NO_ROBOT
        rim = {"stroke": "var(--bad)", "stroke_width": ROOT_RIM} if name == account.root else {}
        drawing.add("circle", cx=x, cy=y, r=NODE, fill=colour, **rim)
        fits = len(name) <= FITS
        below = 4 if fits else NODE + 12
        kind = "node" if fits else "label"
        drawing.add("text", name, x=x, y=y + below, text_anchor="middle", class_=kind)
    written: list[tuple[float, float, str]] = []
    for arrow in account.arrows:
        x, y = _label_place(arrow, places, written)
        written.append((x, y, arrow.text))
        drawing.add("text", arrow.text, x=x, y=y + 4, class_="label", text_anchor="middle")
    return drawing.markup()


def _places(names: Sequence[str], middle: Array) -> dict[str, Array]:
    """Place nodes in a ring, two beside each other [px]."""
    angles = np.pi / 2.0 + 2.0 * np.pi * np.arange(len(names)) / max(len(names), 1)
    if len(names) == 2:
        angles = np.array([np.pi, 0.0])
    around = np.stack([np.cos(angles), -np.sin(angles)], axis=-1)
    return dict(zip(names, middle + RING * around, strict=True))


def _draw_arrow(drawing: Drawing, arrow: Arrow, start: Array, end: Array) -> None:
    along, side = _directions(start, end)
    begin, tip = start + RIM * along + side, end - RIM * along + side
    drawing.arrow(begin, tip, stroke="var(--bad)", stroke_width=2)


def _directions(start: Array, end: Array) -> tuple[Array, Array]:
    """Unit vector along an arrow, and the way [px] to its side; zero for one onto itself."""
    way = end - start
    unit = way / max(float(np.hypot(*way)), 1.0)
    return unit, APART * np.array([-unit[1], unit[0]])  # two arrows between two nodes lie apart


def _label_place(
    arrow: Arrow, places: dict[str, Array], written: Sequence[tuple[float, float, str]]
) -> Array:
    """Find the middle ``(2,)`` [px] of an arrow's label, off nodes and labels."""
    start, end = places[arrow.start], places[arrow.end]
    side = _directions(start, end)[1]
    choices = [
        start + share * (end - start) + beside * side for beside in BESIDE for share in SHARES
    ]
    free = (place for place in choices if _is_free(place, arrow.text, places, written))
    return next(free, choices[0])


def _is_free(
    place: Array,
    text: str,
    places: dict[str, Array],
    written: Sequence[tuple[float, float, str]],
) -> bool:
    """Whether a label hides no other one and is on no node."""
    x, y = place
    half = 0.5 * LETTER * len(text)
    others = [(u, v, 0.5 * LETTER * len(name), LINE) for u, v, name in written]
    others += [(u, v, NODE, 0.5 * LINE + NODE) for u, v in places.values()]
    return all(abs(x - u) >= half + wide or abs(y - v) >= high for u, v, wide, high in others)


def _arrow_text(arrow: Arrow) -> str:
    if arrow.cause == PUSHED:
        return f"{arrow.start} is pushed by {arrow.end}"
    return f"{arrow.start} waits for {arrow.end} ({arrow.text})"
