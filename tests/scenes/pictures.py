"""Draws every scene as a strip of four moments: ``python -m tests.scenes.pictures [NAME ...]``.

The PNG files go to ``docs/pictures/scenes``.
"""

from __future__ import annotations

import dataclasses
import sys
import textwrap
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke

from mrta_falsify.core.arrays import frozen_array
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.polyline import look_along
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.testing.watching import path_at, tick_of, watch
from reports.colours import INK, robot_colour
from reports.floor_plot import draw_floor
from reports.floor_scene import robot_outline
from tests.scenes.moments import SCENES, Moment, Scene

FOLDER = Path(__file__).parents[2] / "docs" / "pictures" / "scenes"
TRAIL = 6.0  # s
PANEL = 6.3  # inches, width
CAPTION = 0.62  # inches
DPI = 80
KEY = (
    "Robot: arrow in its colour; line: where it was in the last 6 s; dashed: its path; cross: its"
    " goal. A ring in another robot's colour: that robot computes its commands. Squares: waiting"
    " spots, 1 = head; P: parking; star: room."
)


def main(names: list[str]) -> None:
    """Draw the scenes named, or all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for scene in SCENES:
        if not names or scene.name in names:
            path = FOLDER / f"{scene.name}.png"
            draw_strip(scene).savefig(path, dpi=DPI)
            print(path)


def draw_strip(scene: Scene) -> Figure:
    """Figure of a scene: its moments, two by two or in a column, in reading order."""
    world = scene.world()
    trace = watch(world, *scene.settings).trace
    moments = scene.moments(world, trace)
    x1, y1, x2, y2 = scene.window
    world = dataclasses.replace(world, bounds=frozen_array(scene.window))
    columns = 4 if (y2 - y1) > 1.5 * (x2 - x1) else 2
    panel = PANEL * (0.62 if columns == 4 else 1.0)
    rows = -(-len(moments) // columns)
    height = panel * (y2 - y1) / (x2 - x1)
    key = textwrap.wrap(KEY, int(columns * panel * 13.0))
    below = 0.2 + 0.18 * len(key)
    total = 0.65 + rows * (height + CAPTION) + below
    width = columns * (panel + 0.35) + 0.1
    figure = Figure(figsize=(width, total), facecolor="white")
    FigureCanvasAgg(figure)
    figure.text(0.3 / width, 1.0 - 0.35 / total, scene.title, size=17, weight="bold", color=INK)
    figure.text(0.3 / width, 0.12 / total, "\n".join(key), size=9.5, color="#555555")
    for number, moment in enumerate(moments):
        row, column = divmod(number, columns)
        left = 0.3 + column * (panel + 0.35)
        bottom = below + 0.05 + (rows - 1 - row) * (height + CAPTION)
        box = (left / width, bottom / total, panel / width, height / total)
        axes = figure.add_axes(box)
        _draw_moment(axes, world, trace, moment, body=1.9 if columns == 4 else 1.0)
        for text in axes.texts:
            text.set_clip_on(True)
        axes.set_xlim(x1, x2)
        axes.set_ylim(y1, y2)
        axes.set_xticks([])
        axes.set_yticks([])
        lines = textwrap.wrap(f"{moment.time:.1f} s: {moment.caption}", int(panel * 11.0))
        axes.set_title("\n".join(lines), size=12, loc="left", color=INK, pad=5)
    return figure


def _draw_moment(axes: Axes, world: World, trace: Trace, moment: Moment, *, body: float) -> None:
    """One panel; robots are drawn ``body`` times as large as they are."""
    tick = tick_of(trace, moment.time)
    now = tuple(
        event
        for event in world.events
        if isinstance(event, Blockage) and event.start <= moment.time < event.end
    )
    draw_floor(axes, dataclasses.replace(world, events=now, lanes=()), label_size=8.0)
    pose, leader = trace.columns["pose"], trace.columns["leader"]
    trail = slice(tick_of(trace, moment.time - TRAIL), tick + 1)
    for robot, spec in enumerate(world.robots):
        colour = robot_colour(robot)
        place = pose[tick, robot]
        path = path_at(trace, robot, tick)
        if len(path):
            ahead, *_ = look_along(path, place[0], place[1], 0.5)
            axes.plot(*ahead.T, color=colour, linewidth=1.6, linestyle=(0, (3, 2)), zorder=7)
        axes.plot(*pose[trail, robot, :2].T, color=colour, linewidth=2.4, alpha=0.45, zorder=6)
        goal = trace.columns["goal"][tick, robot]
        axes.plot(*goal, marker="x", markersize=9, color=colour, markeredgewidth=2.4, zorder=10)
        outline = robot_outline(place, body * spec.radius)
        axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="white", zorder=11))
        first = int(leader[tick, robot])
        if first != robot:
            ring = Circle(
                tuple(place[:2]),
                0.48 * body,
                fill=False,
                edgecolor=robot_colour(first),
                linewidth=2.6,
            )
            ring.set_zorder(10)
            axes.add_patch(ring)
            axes.plot(
                *pose[tick, [robot, first], :2].T,
                color=robot_colour(first),
                linewidth=1.0,
                linestyle=":",
                zorder=5,
            )
        phase = Phase(int(trace.columns["phase"][tick, robot])).name.lower().replace("_", " ")
        above = robot % 2 == 1  # neighbours' names on different sides
        axes.text(
            place[0],
            place[1] + (0.55 if above else -0.55) * body,
            f"{spec.name}: {phase}",
            size=9,
            weight="bold",
            color=colour,
            ha="center",
            va="bottom" if above else "top",
            zorder=13,
            clip_on=True,
            path_effects=[withStroke(linewidth=2.4, foreground="white")],
        )


if __name__ == "__main__":
    main(sys.argv[1:])
