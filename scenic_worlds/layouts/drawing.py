"""Pictures of layouts, seen from above: solids, rooms, lanes, waiting and parking places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import World

DPI = 100
LARGEST = 15.0  # inches, longer side
SCALE = 0.34  # inches per metre, where that fits
WALL, FURNITURE, FURNITURE_EDGE = "#5c6370", "#d8ccb4", "#8d8069"
FLOOR, INK = "#ffffff", "#1f2430"
TO_ROOM, TO_QUEUE = "#7b2d8b", "#2e8b57"
SPOT, PARKING, DOOR, RELEASE = "#0050d0", "#006000", "#00a0a0", "#e07000"
KINDS = {"room": INK, "elevator": "#b5651d", "charger": "#b8860b"}


def draw_layout(world: World, path: Path) -> None:
    """Write a picture of a layout; the format follows the suffix (png, svg or pdf).

    Walls are grey, furniture sand. Lanes are purple to the room and green to the last
    waiting spot; spots are numbered circles, parking places squares with a P; doors are
    teal, release areas dashed orange.

    Args:
        world: the layout; robots, people and tasks are not drawn.
        path: file to write.
    """
    x_min, y_min, x_max, y_max = world.bounds
    width, height = x_max - x_min, y_max - y_min
    scale = min(SCALE, LARGEST / max(width, height))
    figure = Figure(figsize=(width * scale, height * scale))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal", facecolor=FLOOR)
    axes.set_xticks([])
    axes.set_yticks([])
    walls = [wall.polygon for wall in world.walls]
    axes.add_collection(PolyCollection(walls, facecolor=WALL, edgecolor=WALL, lw=0.3))
    items = [item.polygon for item in world.furniture]
    axes.add_collection(
        PolyCollection(items, facecolor=FURNITURE, edgecolor=FURNITURE_EDGE, lw=0.5)
    )
    _draw_lanes(axes, world)
    size = 72.0 * scale
    for resource in world.resources:
        ring = np.vstack([resource.release_area, resource.release_area[:1]])
        axes.plot(*ring.T, "--", color=RELEASE, lw=0.8)
        for place, spot in enumerate(resource.spots):
            _mark(axes, spot, "o", SPOT, str(place), size)
    for place in world.parking:
        _mark(axes, place, "s", PARKING, "P", size)
    kinds = {resource.name: resource.kind for resource in world.resources}
    for number, room in enumerate(world.rooms):
        if len(room.door):
            axes.plot(*room.door.T, color=DOOR, lw=2.5)
        colour = KINDS.get(kinds.get(room.name, "room"), INK)
        axes.plot(*room.point, "*", color="#c00000", ms=0.35 * size)
        axes.annotate(
            f"{number} {room.name}",
            (float(room.point[0]), float(room.point[1])),
            xytext=(0.0, 6.0),
            textcoords="offset points",
            ha="center",
            fontsize=max(6.0, min(9.0, 0.36 * size)),
            color=colour,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )
    figure.savefig(path, dpi=DPI, metadata={"Software": None} if path.suffix == ".png" else None)


def _draw_lanes(axes: Axes, world: World) -> None:
    for colour, name in ((TO_QUEUE, "to_queue"), (TO_ROOM, "to_room")):
        ways: list[Array] = [
            np.vstack([world.rooms[lane.start].point, getattr(lane, name)]) for lane in world.lanes
        ]
        axes.add_collection(LineCollection(ways, colors=colour, lw=0.7, alpha=0.55))


def _mark(axes: Axes, place: Array, marker: str, colour: str, text: str, size: float) -> None:
    axes.plot(*place, marker, mfc="white", mec=colour, ms=0.44 * size, mew=0.9)
    axes.text(
        float(place[0]),
        float(place[1]),
        text,
        color=colour,
        fontsize=0.26 * size,
        ha="center",
        va="center_baseline",
    )
