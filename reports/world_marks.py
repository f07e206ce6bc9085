"""What a world is drawn with before anything has moved: walls, people, robots, timelines."""

from __future__ import annotations

import numpy as np
import shapely
import shapely.geometry.polygon
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.patches import Polygon
from matplotlib.path import Path as MplPath

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.world import Blockage, World
from reports.colours import HUMAN, HUMAN_BLIND, INK, UNSAFE, WALL, robot_colour
from reports.figure_motion import robot_outline

OUTAGE = "#7a3fc0"
TASK = "#4a6fa5"
SOLID = "#d5d9e2"  # inside of walls


def counts_text(world: World) -> str:
    """How many robots, people, tasks and events a world has, as text."""
    parts = [(len(world.robots), "robot"), (len(world.humans), "person")]
    parts += [(len(world.tasks), "task"), (len(world.events), "event")]
    plural = {"person": "people"}
    return ", ".join(
        f"{n} {name if n == 1 else plural.get(name, name + 's')}" for n, name in parts if n
    )


def draw_walls(axes: Axes, world: World) -> None:
    """All walls as one shape: thin ones look dark, those that fill a space stay light."""
    if not world.walls:
        return
    solid = shapely.unary_union([shapely.Polygon(wall.polygon) for wall in world.walls])
    outlines = [
        MplPath.make_compound_path(
            *(MplPath(np.asarray(ring.coords), closed=True) for ring in _rings(part))
        )
        for part in shapely.get_parts(solid)
    ]
    axes.add_collection(
        PathCollection(outlines, facecolor=SOLID, edgecolor=WALL, linewidth=0.8, zorder=3)
    )


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    upright = shapely.geometry.polygon.orient(polygon)  # holes run the other way, so stay open
    return [upright.exterior, *upright.interiors]


def draw_people(axes: Axes, world: World, *, marker_size: float, line: float) -> None:
    """People where they begin, with the points of their routes joined by straight lines."""
    for human in world.humans:
        colour = HUMAN if human.reacts_to_robots else HUMAN_BLIND
        route = human.route
        if human.repeat and len(route) > 1:
            route = np.concatenate([route, route[:1]])
        axes.plot(
            route[:, 0],
            route[:, 1],
            color=colour,
            linewidth=line,
            linestyle=(0, (3, 2)),
            alpha=0.55,
            zorder=7,
        )
        x, y = start_of(human.route, human.start, repeat=human.repeat)
        axes.plot(
            x,
            y,
            marker="o",
            markersize=marker_size,
            color=colour,
            markeredgecolor="white",
            markeredgewidth=0.4,
            zorder=8,
        )


def start_of(route: Array, share: float, *, repeat: bool) -> Array:
    """Point ``(2,)`` at ``share`` of the length of a route of straight legs."""
    points = np.concatenate([route, route[:1]]) if repeat else route
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(lengths)])
    if walked[-1] == 0.0:
        return np.asarray(route[0])
    at = share * walked[-1]
    return np.array([np.interp(at, walked, points[:, axis]) for axis in (0, 1)])


def draw_robots(axes: Axes, world: World, *, scale: float, edge: float) -> None:
    """Robots at their starts, ``scale`` times as large as they are."""
    for number, robot in enumerate(world.robots):
        axes.add_patch(
            Polygon(
                robot_outline(robot.pose, scale * robot.radius),
                facecolor=robot_colour(number),
                edgecolor="white",
                linewidth=edge,
                zorder=9,
            )
        )


# --- timelines -----------------------------------------------------------------------------------


def timeline_rows(world: World) -> int:
    """Rows that the timeline of a world takes."""
    return len(world.tasks) + len(world.events)


def last_time(world: World) -> float:
    """End of what a timeline shows [s]; events that never end do not count."""
    times = [task.deadline for task in world.tasks]
    times += [t for event in world.events for t in (event.start, event.end) if t <= world.horizon]
    return max(times, default=world.horizon)


def draw_timeline(axes: Axes, world: World, end: float, *, rows: int, size: float) -> None:
    """Tasks from arrival to deadline, events from start to end, one a row, in order of time."""
    axes.set_xlim(0.0, end * 1.02)
    axes.set_ylim(rows - 0.3, -0.8)
    axes.set_yticks([])
    axes.set_xticks([])
    axes.patch.set_alpha(0.0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    row = 0
    for event in sorted(world.events, key=lambda event: (event.start, event.name)):
        stop = min(event.end, end * 1.02)
        colour = UNSAFE if isinstance(event, Blockage) else OUTAGE
        _draw_bar(axes, row, (event.start, stop), colour, event.name, size)
        row += 1
    for task in sorted(world.tasks, key=lambda task: (task.arrival, task.deadline)):
        text = f"{task.start} to {task.end}"
        _draw_bar(axes, row, (task.arrival, task.deadline), TASK, text, size)
        row += 1


def _draw_bar(
    axes: Axes, row: int, times: tuple[float, float], colour: str, text: str, size: float
) -> None:
    start, stop = times
    axes.barh(row, stop - start, left=start, height=0.62, color=colour, alpha=0.30, linewidth=0)
    axes.plot([start, start], [row - 0.36, row + 0.36], color=colour, linewidth=1.1)
    axes.text(
        start,
        row + 0.03,
        f"  {text}",
        size=size,
        color=INK,
        va="center_baseline",
        parse_math=False,
        clip_on=True,
    )
