"""What stands still on a floor, drawn: costmap, walls, furniture, rooms, queues, lanes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.world import Blockage, World
from reports.colours import FURNITURE, FURNITURE_EDGE, INK, ROOM, UNSAFE, WALL, costmap_image
from reports.run_view import extent_of


def draw_floor(
    axes: Axes,
    world: World,
    costmap: Costmap | None = None,
    *,
    label_size: float = 9.0,
    furniture: Sequence[Array] | None = None,
) -> None:
    """Everything that stands still: costmap, walls, furniture, rooms, queues, parking, lanes.

    Args:
        axes: to draw in.
        world: what to draw.
        costmap: under it.
        label_size: of the rooms' names [pt].
        furniture: outlines ``(V, 2)`` [m]; None: all of the world's, at its first places.
    """
    x_min, y_min, x_max, y_max = extent_of(world)
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=8, colors="#555555", length=2)
    axes.set_facecolor("white")
    for spine in axes.spines.values():
        spine.set_color("#bbbbbb")
    if costmap is not None:
        _draw_costmap(axes, costmap)
    _draw_lanes(axes, world)
    if furniture is None:
        furniture = [item.polygon for item in world.furniture]
    axes.add_collection(
        PolyCollection(
            furniture, facecolor=FURNITURE, edgecolor=FURNITURE_EDGE, linewidth=0.5, zorder=3
        )
    )
    walls = [wall.polygon for wall in world.walls]
    axes.add_collection(
        PolyCollection(walls, facecolor=WALL, edgecolor=WALL, linewidth=0.4, zorder=4)
    )
    draw_blockages(axes, world, 0.8, layer=4)
    for event in world.events:
        if isinstance(event, Blockage):
            x, y = event.polygon.mean(axis=0)
            text = f"blocked {event.start:.0f}-{event.end:.0f} s"
            draw_label(axes, (x, y), text, size=7, colour=UNSAFE)
    _draw_queues(axes, world)
    _draw_rooms(axes, world, label_size)
    _draw_scale(axes, world)


def draw_blockages(axes: Axes, world: World, width: float, *, layer: int = 6) -> None:
    """Blockages, whenever they stand; ``width`` of their outline [pt], ``layer`` of the picture."""
    for event in world.events:
        if isinstance(event, Blockage):
            axes.add_patch(
                Polygon(
                    event.polygon,
                    facecolor="#ffd9d9",
                    edgecolor=UNSAFE,
                    hatch="/////",
                    linewidth=width,
                    zorder=layer,
                )
            )


def _draw_costmap(axes: Axes, costmap: Costmap) -> None:
    image = costmap_image(costmap)
    rows, cols = costmap.cost.shape
    x, y = costmap.origin
    extent = (x, x + cols * costmap.resolution, y, y + rows * costmap.resolution)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest", zorder=0)
    axes.set_aspect("equal")


def _draw_lanes(axes: Axes, world: World) -> None:
    legs = [way for lane in world.lanes for way in (lane.to_queue, lane.to_room) if len(way) > 1]
    axes.add_collection(
        LineCollection(legs, colors="#7d8aa5", linewidths=0.5, alpha=0.35, zorder=1)
    )


def _draw_queues(axes: Axes, world: World) -> None:
    for resource in world.resources:
        for place, (x, y) in enumerate(resource.spots):
            axes.plot(
                x,
                y,
                marker="s",
                markersize=8,
                markerfacecolor="#fff6cc",
                markeredgecolor="#8a6d00",
                markeredgewidth=0.8,
                zorder=5,
            )
            write_text(
                axes,
                x,
                y,
                str(place + 1),
                size=6,
                color="#5c4900",
                ha="center",
                va="center",
                zorder=6,
            )
    for x, y in world.parking:
        axes.plot(
            x,
            y,
            marker="o",
            markersize=7,
            markerfacecolor="#e4f0e4",
            markeredgecolor="#4c7a4c",
            markeredgewidth=0.7,
            zorder=5,
        )
        write_text(axes, x, y, "P", size=5.5, color="#2f5a2f", ha="center", va="center", zorder=6)


def _draw_rooms(axes: Axes, world: World, size: float) -> None:
    for number, room in enumerate(world.rooms):
        if len(room.area) >= 3:
            axes.add_patch(
                Polygon(room.area, fill=False, edgecolor="#6a7bb0", linestyle=":", zorder=2)
            )
        if len(room.door) >= 2:
            axes.plot(room.door[:, 0], room.door[:, 1], color="#2aa198", linewidth=2.5, zorder=5)
        x, y = room.point
        axes.plot(x, y, marker="*", markersize=11, color="#ffbf00", markeredgecolor=ROOM, zorder=9)
        text = f"{number}" if room.name in ("", str(number)) else f"{number} {room.name}"
        draw_label(axes, (x, y + 0.42), text, size=size, colour=ROOM, weight="bold", va="bottom")


def _draw_scale(axes: Axes, world: World) -> None:
    x_min, y_min, x_max, _ = extent_of(world)
    length = 5.0 if x_max - x_min > 12.0 else 1.0
    x, y = x_min + 0.4, y_min + 0.4
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2.5, zorder=12, solid_capstyle="butt")
    draw_label(axes, (x + length / 2.0, y + 0.12), f"{length:g} m", size=8, va="bottom")


def write_text(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Text that is never read as a formula: names come from worlds."""
    axes.text(x, y, text, parse_math=False, **style)


def draw_label(
    axes: Axes,
    at: tuple[float, float],
    text: str,
    *,
    size: float,
    colour: str = INK,
    weight: str = "normal",
    va: str = "center",
) -> None:
    """Text with a white rim, to be read on anything."""
    write_text(
        axes,
        *at,
        text,
        size=size,
        color=colour,
        weight=weight,
        ha="center",
        va=va,
        zorder=12,
        path_effects=[withStroke(linewidth=2.2, foreground="white")],
        clip_on=True,
    )
