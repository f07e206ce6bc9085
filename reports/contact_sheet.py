"""Pictures of worlds that have not been run: one alone, or many beside each other."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
import shapely.geometry.polygon
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as MplPath

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.world import Blockage, CommsOutage, Furniture, World
from reports.colours import PAINTS, SOFT, UNSAFE, robot_colour
from reports.floor_plot import (
    AreaStyle,
    BodyStyle,
    draw_floor,
    draw_label,
    paint_areas,
    paint_bodies,
    set_extent,
)
from reports.floor_scene import Extent, Role, Shape, extent_of, floor_scene, starting_scene
from reports.paper import MARGIN, Paper
from reports.run_picture import MAP_HEIGHT, MAP_WIDTH, area_entry, person_entry
from reports.schedule_plot import OUTAGE, TASK, counts_text, draw_schedule, last_time, schedule_rows

SHEET_WIDTH = 17.0  # inches at most
PANEL_AREA = 13.0  # square inches that the map of one world gets at least
LARGEST_PANEL_AREA = 30.0  # square inches, where few worlds leave space
ROW = 0.082  # inches, one task or event in a schedule
GAP = 0.22  # inches between panels
HEAD = 0.30  # inches over each panel, for its caption
TITLE = 0.62  # inches over the sheet
FOOT = 0.52  # inches under the sheet, for the legend
SHRUNK = 0.75  # a world alone is drawn so much smaller than a run
SCHEDULE_WIDTH = 4.2  # inches, beside a world alone
NO_DOOR = "no door found"
SCHEDULE_ROW = 0.19  # inches, one task or event beside a world alone


# --- many worlds -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SheetGrid:
    """Where the panels of a sheet go; all lengths in inches."""

    columns: int
    rows: int
    map_width: float
    map_height: float
    schedule: float

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance from one panel to the next, to the right and down."""
        return self.map_width + GAP, HEAD + self.map_height + self.schedule + GAP

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the sheet."""
        across, down = self.pitch
        return 2 * GAP + self.columns * across, TITLE + self.rows * down + FOOT

    def corner(self, number: int) -> tuple[float, float]:
        """Upper left corner of a panel, from the lower left corner of the sheet."""
        across, down = self.pitch
        row, column = divmod(number, self.columns)
        return GAP * 1.5 + column * across, self.size[1] - TITLE - row * down


def plan_grid(count: int, extent: Extent, rows: int) -> SheetGrid:
    """Find columns and sizes for ``count`` maps of an extent, each over a schedule of ``rows``."""
    aspect = extent.width / extent.height
    room = SHEET_WIDTH - 2 * GAP
    width = min(math.sqrt(PANEL_AREA * aspect), room - GAP)
    most = max(1, min(count, int(room / (width + GAP))))
    columns = math.ceil(count / math.ceil(count / most))  # no lone panel in the last row
    width = min(room / columns - GAP, math.sqrt(LARGEST_PANEL_AREA * aspect))
    schedule = 0.10 + ROW * rows if rows else 0.0
    return SheetGrid(columns, math.ceil(count / columns), width, width / aspect, schedule)


def write_contact_sheet(
    worlds: Sequence[World], path: Path, *, title: str, captions: Sequence[str]
) -> None:
    """Write a picture of several worlds of one program, all at the same scale.

    Furniture that stands in the same place in all of them is pale, all other in colour.
    Under each map a schedule shows its tasks (arrival to deadline, rooms) and events.

    Args:
        worlds: at least one.
        path: the format follows the suffix (png, svg or pdf).
        title: of the sheet.
        captions: one short text per world.
    """
    fixed = fixed_furniture(worlds)
    extent = common_extent(worlds, fixed)
    rows = max(schedule_rows(world) for world in worlds)
    grid = plan_grid(len(worlds), extent, rows)
    paper = Paper.of_size(*grid.size)
    head = paper.height - 0.36
    paper.write(1.5 * GAP, head, title, size=17, weight="bold")
    note = f"{len(worlds)} sampled worlds"
    paper.write(paper.width - 1.5 * GAP, head, note, size=10, colour=SOFT, ha="right")
    end = max(last_time(world) for world in worlds)
    for i, (world, caption) in enumerate(zip(worlds, captions, strict=True)):
        left, top = grid.corner(i)
        paper.write(left, top - 0.17, caption, size=11, weight="bold")
        right = left + grid.map_width
        paper.write(right, top - 0.17, counts_text(world), size=7.5, colour=SOFT, ha="right")
        bottom = top - HEAD - grid.map_height
        axes = paper.axes_at(left, bottom, grid.map_width, grid.map_height)
        draw_small_map(axes, world, extent, fixed)
        if grid.schedule:
            axes = paper.axes_at(left, bottom - grid.schedule, grid.map_width, grid.schedule - 0.03)
            draw_schedule(axes, world, end, rows=rows, size=5.0)
    _draw_legend(paper, worlds, fixed)
    paper.save(path)


def _draw_legend(paper: Paper, worlds: Sequence[World], fixed: frozenset[bytes]) -> None:
    handles = [
        Line2D([], [], linestyle="none", marker=">", markersize=9, color="#444444", label="robot"),
        *_people_entries(worlds),
        *_furniture_entries(worlds, fixed),
        *_schedule_entries(worlds),
    ]
    paper.figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(GAP / paper.width, 0.06 / paper.height),
        ncols=len(handles),
        fontsize=8.5,
        frameon=False,
        columnspacing=1.4,
        handletextpad=0.5,
        borderaxespad=0.0,
    )


def _people_entries(worlds: Sequence[World]) -> Iterator[Line2D]:
    blind = {not human.reacts_to_robots for world in worlds for human in world.humans}
    if False in blind:
        yield person_entry("person and route", blind=False)
    if True in blind:
        yield person_entry("person who ignores robots", blind=True)


def _furniture_entries(worlds: Sequence[World], fixed: frozenset[bytes]) -> Iterator[Patch]:
    if any(furniture_key(item) not in fixed for world in worlds for item in world.furniture):
        yield area_entry(Role.SAMPLED_FURNITURE, "sampled furniture")
    if fixed:
        yield area_entry(Role.FURNITURE, "same in all")


def _schedule_entries(worlds: Sequence[World]) -> Iterator[Patch]:
    kinds = {type(event) for world in worlds for event in world.events}
    if Blockage in kinds:
        yield area_entry(Role.BLOCKAGE, "blockage", hatch="/////")
    if CommsOutage in kinds:
        yield Patch(facecolor=OUTAGE, alpha=0.3, label="communication outage")
    if any(world.tasks for world in worlds):
        yield Patch(facecolor=TASK, alpha=0.3, label="task, arrival to deadline, room to room")


# --- one world -------------------------------------------------------------------------------


def write_floor_picture(floor: World, path: Path, *, without_door: Collection[str] = ()) -> None:
    """Write a picture of a floor alone.

    Args:
        floor: what to draw.
        path: the format follows the suffix (png, svg or pdf).
        without_door: names of rooms to mark, because no door of theirs was found.
    """
    extent = extent_of(floor)
    scale = SHRUNK * min(MAP_HEIGHT / extent.height, MAP_WIDTH / extent.width)
    width, height = scale * extent.width, scale * extent.height
    paper = Paper.of_size(width + 2.0 * MARGIN, height + 2.0 * MARGIN)
    axes = paper.axes_at(MARGIN, MARGIN, width, height)
    draw_floor(axes, floor, label_size=7.5)
    for room in floor.rooms:
        if room.name in without_door:
            axes.fill(*room.area.T, facecolor="none", edgecolor=UNSAFE, lw=1.6, ls="--", zorder=6)
            at = room.point - np.array([0.0, 0.35])
            draw_label(axes, at, NO_DOOR, size=7.5, colour=UNSAFE, weight="bold", va="top")
    paper.save(path)


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
    extent = extent_of(world)
    scale = SHRUNK * min(MAP_HEIGHT / extent.height, MAP_WIDTH / extent.width)
    map_width, map_height = scale * extent.width, scale * extent.height
    paper = Paper.of_size(map_width + SCHEDULE_WIDTH + 3.0 * MARGIN, map_height + 2.2 * MARGIN)
    axes = paper.axes_at(MARGIN, MARGIN, map_width, map_height)
    draw_floor(axes, world, costmap, label_size=7.5)
    paint_bodies(axes, starting_scene(world))
    for number, robot in enumerate(world.robots):
        at, colour = robot.pose[:2] + np.array([0.4, -0.45]), robot_colour(number)
        draw_label(axes, at, robot.name, size=7.5, colour=colour, weight="bold", ha="left")
    left, top = map_width + 2.0 * MARGIN, paper.height - 1.2 * MARGIN
    paper.write(left, top - 0.10, title or world.name, size=12, weight="bold")
    paper.write(left, top - 0.38, counts_text(world), size=9, colour=SOFT)
    paper.write(left, top - 0.60, f"digest {world.digest()[:12]}", size=9, colour=SOFT)
    if schedule_rows(world):
        _draw_schedule_beside(paper, world, left, top, map_height)
    paper.save(path)


def _draw_schedule_beside(
    paper: Paper, world: World, left: float, top: float, map_height: float
) -> None:
    """Draw the schedule with a time axis, below ``top`` [inches]."""
    heading = "Tasks and events (begin to end, room to room)"
    paper.write(left, top - 1.0, heading, size=10, weight="bold")
    rows = schedule_rows(world)
    height = min(0.25 + SCHEDULE_ROW * rows, map_height - 1.6)
    axes = paper.axes_at(left, top - (1.1 + height), SCHEDULE_WIDTH, height)
    end = last_time(world)
    draw_schedule(axes, world, end, rows=rows, size=8.0)
    axes.spines["bottom"].set_visible(True)
    axes.set_xticks([0, round(end / 2), round(end)])
    axes.set_xticklabels(["0 s", f"{end / 2:.0f} s", f"{end:.0f} s"], fontsize=8)


# --- a small map, on which sampled furniture stands out -------------------------------------

SURROUNDINGS = 2.5  # m, shown around what a run is about
SOLID = "#d5d9e2"  # inside of walls: those that fill a space stay light
NUMBER = "#7a5c00"  # of a room
TAKEN = 0.6  # m; a robot this near to a room's point hides its number
SMALL_AREAS = {
    Role.FURNITURE: AreaStyle(0.25, 2),
    Role.SAMPLED_FURNITURE: AreaStyle(0.7, 5),
    Role.BLOCKAGE: AreaStyle(0.8, 6, hatch="/////"),
}
SMALL_BODIES = BodyStyle(person=3.6, route=0.7, scale=1.5, edge=0.4)


def fixed_furniture(worlds: Sequence[World]) -> frozenset[bytes]:
    """Keys of the furniture that all worlds have in common; none of a single world."""
    keys = [frozenset(map(furniture_key, world.furniture)) for world in worlds]
    return frozenset.intersection(*keys) if len(keys) > 1 else frozenset()


def furniture_key(item: Furniture) -> bytes:
    """Tell two pieces apart by name and place."""
    return item.name.encode() + item.polygon.tobytes()


def common_extent(worlds: Sequence[World], fixed: frozenset[bytes]) -> Extent:
    """Rectangle with everything that a run is about, the same for all worlds."""
    points = np.concatenate([part for world in worlds for part in _places(world, fixed)])
    boxes = np.array([extent_of(world) for world in worlds])
    low = np.maximum(points.min(axis=0) - SURROUNDINGS, boxes[:, :2].min(axis=0))
    high = np.minimum(points.max(axis=0) + SURROUNDINGS, boxes[:, 2:].max(axis=0))
    return Extent(*map(float, (*low, *high)))


def _places(world: World, fixed: frozenset[bytes]) -> list[Array]:
    """List points ``(n, 2)`` [m] of rooms, lanes, robots, people and what was sampled."""
    return [
        np.asarray(world.bounds).reshape(2, 2) if not world.rooms else world.rooms[0].point[None],
        *(room.point[None] for room in world.rooms),
        *(room.door for room in world.rooms if len(room.door)),
        *(way for lane in world.lanes for way in (lane.to_queue, lane.to_room) if len(way)),
        *(robot.pose[None, :2] for robot in world.robots),
        *(human.route for human in world.humans),
        *(item.polygon for item in world.furniture if fixed and furniture_key(item) not in fixed),
        *(event.polygon for event in world.events if isinstance(event, Blockage)),
    ]


def draw_small_map(axes: Axes, world: World, extent: Extent, fixed: frozenset[bytes]) -> None:
    """Draw a world as it begins; furniture that is not ``fixed`` is in colour."""
    set_extent(axes, extent)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#fbfbf8")
    for spine in axes.spines.values():
        spine.set_color("#cccccc")
    sampled = [item.polygon for item in world.furniture if furniture_key(item) not in fixed]
    known = [item.polygon for item in world.furniture if furniture_key(item) in fixed]
    scene = floor_scene(world, known)
    coloured = [Shape(role=Role.SAMPLED_FURNITURE, points=outline) for outline in sampled]
    paint_areas(axes, (*scene, *coloured), SMALL_AREAS)
    _paint_walls(axes, [shape.points for shape in scene if shape.role is Role.WALL])
    for shape in scene:
        if shape.role is Role.DOOR:
            axes.plot(*shape.points.T, color=PAINTS[Role.DOOR].edge, linewidth=1.5, zorder=4)
        elif shape.role is Role.ROOM:
            _write_number(axes, shape, world)
    paint_bodies(axes, starting_scene(world), SMALL_BODIES)


def _write_number(axes: Axes, room: Shape, world: World) -> None:
    """Write the number of a room at its point, or above the robot that stands there."""
    (point,) = room.points
    taken = any(np.hypot(*(robot.pose[:2] - point)) < TAKEN for robot in world.robots)
    at = point + np.array([0.0, 1.1 if taken else 0.0])
    draw_label(axes, at, str(room.number), size=7, colour=NUMBER, weight="bold")


def _paint_walls(axes: Axes, outlines: Sequence[Array]) -> None:
    """Paint walls as one shape: thin ones look dark, those that fill a space stay light."""
    if not outlines:
        return
    solid = shapely.unary_union([shapely.Polygon(outline) for outline in outlines])
    paths = [
        MplPath.make_compound_path(
            *(MplPath(np.asarray(ring.coords), closed=True) for ring in _rings(part))
        )
        for part in shapely.get_parts(solid)
    ]
    edge = PAINTS[Role.WALL].edge
    axes.add_collection(
        PathCollection(paths, facecolor=SOLID, edgecolor=edge, linewidth=0.8, zorder=3)
    )


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    upright = shapely.geometry.polygon.orient(polygon)  # holes run the other way, so stay open
    return [upright.exterior, *upright.interiors]
