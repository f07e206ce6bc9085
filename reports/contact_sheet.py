"""Pictures of worlds that have not been run: one alone, or many beside each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.world import Blockage, CommsOutage, Furniture, World
from reports.colours import FURNITURE, FURNITURE_EDGE, HUMAN, HUMAN_BLIND, INK, UNSAFE, robot_colour
from reports.figure_floor import draw_blockages, draw_floor
from reports.figures import DPI, MAP_HEIGHT, MAP_WIDTH, MARGIN
from reports.run_view import extent_of
from reports.world_marks import (
    OUTAGE,
    TASK,
    counts_text,
    draw_people,
    draw_robots,
    draw_timeline,
    draw_walls,
    last_time,
    timeline_rows,
)

SAMPLED, SAMPLED_EDGE = "#f2a541", "#8a4b00"
DOOR = "#2aa198"

SHEET_WIDTH = 17.0  # inches at most
PANEL_AREA = 13.0  # square inches that the map of one world gets at least
LARGEST_PANEL_AREA = 30.0  # square inches, where few worlds leave space
ROW = 0.082  # inches, one task or event in a timeline
GAP = 0.22  # inches between panels
HEAD = 0.30  # inches over each panel, for its caption
SURROUNDINGS = 2.5  # m, shown around what a run is about
TITLE = 0.62  # inches over the sheet
FOOT = 0.52  # inches under the sheet, for the legend

Extent = tuple[float, float, float, float]  # x min, y min, x max, y max [m]


# --- many worlds -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Grid:
    """Where the panels of a sheet go; all lengths in inches."""

    columns: int
    rows: int
    map_width: float
    map_height: float
    timeline: float

    @property
    def pitch(self) -> tuple[float, float]:
        """From one panel to the next, to the right and down."""
        return self.map_width + GAP, HEAD + self.map_height + self.timeline + GAP

    @property
    def size(self) -> tuple[float, float]:
        """Of the sheet."""
        across, down = self.pitch
        return 2 * GAP + self.columns * across, TITLE + self.rows * down + FOOT


def write_contact_sheet(
    worlds: Sequence[World], path: Path, *, title: str, captions: Sequence[str]
) -> None:
    """Write a picture of several worlds of one program, all at the same scale.

    Furniture that stands in the same place in all of them is pale, all other in colour.
    Under each map a timeline shows its tasks (arrival to deadline, rooms) and events.

    Args:
        worlds: at least one.
        path: the format follows the suffix (png, svg or pdf).
        title: of the sheet.
        captions: one short text per world.
    """
    fixed = _fixed_furniture(worlds)
    extent = _common_extent(worlds, fixed)
    panel_rows = max(timeline_rows(world) for world in worlds)
    grid = _grid(len(worlds), extent, panel_rows)
    width, height = grid.size
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    _write_title(figure, title, f"{len(worlds)} sampled worlds", height)
    end = max(last_time(world) for world in worlds)
    across, down = grid.pitch
    for i, (world, caption) in enumerate(zip(worlds, captions, strict=True)):
        left = GAP * 1.5 + (i % grid.columns) * across
        top = height - TITLE - (i // grid.columns) * down
        figure.text(left / width, (top - 0.17) / height, caption, size=11, weight="bold", color=INK)
        figure.text(
            (left + grid.map_width) / width,
            (top - 0.17) / height,
            counts_text(world),
            size=7.5,
            color="#555555",
            ha="right",
        )
        bottom = top - HEAD - grid.map_height
        box = (
            left / width,
            bottom / height,
            grid.map_width / width,
            grid.map_height / height,
        )
        _draw_small_map(figure.add_axes(box), world, extent, fixed)
        if grid.timeline:
            box = (
                left / width,
                (bottom - grid.timeline) / height,
                grid.map_width / width,
                (grid.timeline - 0.03) / height,
            )
            draw_timeline(figure.add_axes(box), world, end, rows=panel_rows, size=5.0)
    _draw_legend(figure, worlds, height)
    figure.savefig(path, dpi=DPI, metadata={"Date": None} if path.suffix == ".svg" else {})


def _common_extent(worlds: Sequence[World], fixed: frozenset[bytes]) -> Extent:
    """Rectangle [m] with everything that a run is about, the same for all worlds."""
    points = np.concatenate([part for world in worlds for part in _places(world, fixed)])
    boxes = np.array([extent_of(world) for world in worlds])
    low = np.maximum(points.min(axis=0) - SURROUNDINGS, boxes[:, :2].min(axis=0))
    high = np.minimum(points.max(axis=0) + SURROUNDINGS, boxes[:, 2:].max(axis=0))
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _places(world: World, fixed: frozenset[bytes]) -> list[Array]:
    """Points ``(n, 2)`` [m] of rooms, ways, robots, people and what was sampled."""
    return [
        np.asarray(world.bounds).reshape(2, 2) if not world.rooms else world.rooms[0].point[None],
        *(room.point[None] for room in world.rooms),
        *(room.door for room in world.rooms if len(room.door)),
        *(way for lane in world.lanes for way in (lane.to_queue, lane.to_room) if len(way)),
        *(robot.pose[None, :2] for robot in world.robots),
        *(human.route for human in world.humans),
        *(item.polygon for item in world.furniture if fixed and _key(item) not in fixed),
        *(event.polygon for event in world.events if isinstance(event, Blockage)),
    ]


def _grid(count: int, extent: Extent, panel_rows: int) -> _Grid:
    x_min, y_min, x_max, y_max = extent
    aspect = (x_max - x_min) / (y_max - y_min)
    room = SHEET_WIDTH - 2 * GAP
    width = min(math.sqrt(PANEL_AREA * aspect), room - GAP)
    most = max(1, min(count, int(room / (width + GAP))))
    columns = math.ceil(count / math.ceil(count / most))  # no lone panel in the last row
    width = min(room / columns - GAP, math.sqrt(LARGEST_PANEL_AREA * aspect))
    timeline = 0.10 + ROW * panel_rows if panel_rows else 0.0
    return _Grid(columns, math.ceil(count / columns), width, width / aspect, timeline)


def _fixed_furniture(worlds: Sequence[World]) -> frozenset[bytes]:
    """Keys of the furniture that all worlds have in common."""
    keys = [frozenset(map(_key, world.furniture)) for world in worlds]
    return frozenset.intersection(*keys) if len(keys) > 1 else frozenset()


def _key(item: Furniture) -> bytes:
    return item.name.encode() + item.polygon.tobytes()


def _write_title(figure: Figure, title: str, note: str, height: float) -> None:
    width = figure.get_figwidth()
    figure.text(
        1.5 * GAP / width,
        1.0 - 0.36 / height,
        title,
        size=17,
        weight="bold",
        color=INK,
        parse_math=False,
    )
    figure.text(
        1.0 - 1.5 * GAP / width, 1.0 - 0.36 / height, note, size=10, color="#555555", ha="right"
    )


# --- a small map -------------------------------------------------------------------------------


def _draw_small_map(axes: Axes, world: World, extent: Extent, fixed: frozenset[bytes]) -> None:
    x_min, y_min, x_max, y_max = extent
    axes.set_xlim(x_min, x_max)
    axes.set_ylim(y_min, y_max)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#fbfbf8")
    for spine in axes.spines.values():
        spine.set_color("#cccccc")
    pale = [item.polygon for item in world.furniture if _key(item) in fixed]
    sampled = [item.polygon for item in world.furniture if _key(item) not in fixed]
    for polygons, face, edge, width, order in (
        (pale, FURNITURE, FURNITURE_EDGE, 0.25, 2),
        (sampled, SAMPLED, SAMPLED_EDGE, 0.7, 5),
    ):
        axes.add_collection(
            PolyCollection(polygons, facecolor=face, edgecolor=edge, linewidth=width, zorder=order)
        )
    draw_walls(axes, world)
    for number, room in enumerate(world.rooms):
        if len(room.door) >= 2:
            axes.plot(room.door[:, 0], room.door[:, 1], color=DOOR, linewidth=1.5, zorder=4)
        x, y = room.point
        taken = any(np.hypot(*(robot.pose[:2] - room.point)) < 0.6 for robot in world.robots)
        axes.text(
            float(x),
            float(y) + (1.1 if taken else 0.0),
            str(number),
            size=7,
            color="#7a5c00",
            weight="bold",
            ha="center",
            va="center",
            zorder=4,
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
        )
    draw_blockages(axes, world, 0.8)
    draw_people(axes, world, marker_size=3.6, line=0.7)
    draw_robots(axes, world, scale=1.5, edge=0.4)


# --- legend --------------------------------------------------------------------------------------


def _draw_legend(figure: Figure, worlds: Sequence[World], height: float) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], linestyle="none", marker=">", markersize=9, color="#444444", label="robot")
    ]
    people = [human for world in worlds for human in world.humans]
    if any(human.reacts_to_robots for human in people):
        handles.append(_person(HUMAN, "person and route"))
    if any(not human.reacts_to_robots for human in people):
        handles.append(_person(HUMAN_BLIND, "person who ignores robots"))
    fixed = _fixed_furniture(worlds)
    if any(_key(item) not in fixed for world in worlds for item in world.furniture):
        handles.append(Patch(facecolor=SAMPLED, edgecolor=SAMPLED_EDGE, label="sampled furniture"))
    if fixed:
        handles.append(Patch(facecolor=FURNITURE, edgecolor=FURNITURE_EDGE, label="same in all"))
    events = [event for world in worlds for event in world.events]
    if any(isinstance(event, Blockage) for event in events):
        handles.append(
            Patch(facecolor="#ffd9d9", edgecolor=UNSAFE, hatch="/////", label="blockage")
        )
    if any(isinstance(event, CommsOutage) for event in events):
        handles.append(Patch(facecolor=OUTAGE, alpha=0.3, label="communication outage"))
    if any(world.tasks for world in worlds):
        handles.append(
            Patch(facecolor=TASK, alpha=0.3, label="task, arrival to deadline, room to room")
        )
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(1.0 * GAP / figure.get_figwidth(), 0.06 / height),
        ncols=len(handles),
        fontsize=8.5,
        frameon=False,
        columnspacing=1.4,
        handletextpad=0.5,
        borderaxespad=0.0,
    )


def _person(colour: str, label: str) -> Line2D:
    return Line2D(
        [], [], color=colour, linewidth=0.9, linestyle="--", marker="o", markersize=5, label=label
    )


# --- one world -----------------------------------------------------------------------------------


def write_world_picture(
    world: World, path: Path, *, costmap: Costmap | None = None, title: str = ""
) -> None:
    """Write a picture of one world as it is at time 0: map, people's routes, tasks, events.

    Args:
        world: what to draw.
        path: the format follows the suffix (png, svg or pdf).
        costmap: drawn under the map.
        title: the world's name if empty.
    """
    x_min, y_min, x_max, y_max = extent_of(world)
    scale = min(0.75 * MAP_HEIGHT / (y_max - y_min), 0.75 * MAP_WIDTH / (x_max - x_min))
    map_width, map_height = scale * (x_max - x_min), scale * (y_max - y_min)
    timeline = min(0.25 + 0.19 * timeline_rows(world), map_height - 1.6)
    height, width = map_height + 2.2 * MARGIN, map_width + 4.2 + 3.0 * MARGIN
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes(
        (MARGIN / width, MARGIN / height, map_width / width, map_height / height)
    )
    draw_floor(axes, world, costmap, label_size=7.5)
    draw_people(axes, world, marker_size=7.0, line=1.1)
    draw_robots(axes, world, scale=1.0, edge=0.8)
    for number, robot in enumerate(world.robots):
        axes.text(
            robot.pose[0] + 0.4,
            robot.pose[1] - 0.45,
            robot.name,
            size=7.5,
            weight="bold",
            color=robot_colour(number),
            zorder=12,
            parse_math=False,
            clip_on=True,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )
    left = (map_width + 2.0 * MARGIN) / width
    top = 1.0 - 1.2 * MARGIN / height
    at = top - 0.10 / height
    heading = title or world.name
    figure.text(left, at, heading, size=12, weight="bold", color=INK, parse_math=False)
    for offset, text in ((0.38, counts_text(world)), (0.60, f"digest {world.digest()[:12]}")):
        figure.text(left, top - offset / height, text, size=9, color="#555555")
    if timeline_rows(world):
        figure.text(
            left,
            top - 1.0 / height,
            "Tasks and events (begin to end, room to room)",
            size=10,
            weight="bold",
            color=INK,
        )
        box = (left, top - (1.1 + timeline) / height, 4.2 / width, timeline / height)
        panel = figure.add_axes(box)
        end = last_time(world)
        draw_timeline(panel, world, end, rows=timeline_rows(world), size=8.0)
        panel.spines["bottom"].set_visible(True)
        panel.set_xticks([0, round(end / 2), round(end)])
        panel.set_xticklabels(["0 s", f"{end / 2:.0f} s", f"{end:.0f} s"], fontsize=8)
    figure.savefig(path, dpi=DPI, metadata={"Date": None} if path.suffix == ".svg" else {})
