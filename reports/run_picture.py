"""The picture of a run: its floor from above, what moved on it, and how it was judged."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from reports.floor_plot import draw_floor
from reports.floor_scene import extent_of
from reports.furnishing import fixed_outlines, movable_outlines
from reports.paper import MARGIN, Paper
from reports.run_panel import draw_panel
from reports.run_plot import draw_contacts, draw_people_tracks, draw_robot_tracks
from reports.run_view import RunView

MAP_HEIGHT = 16.0  # inches at most
MAP_WIDTH = 14.0  # inches at most
PANEL_WIDTH = 4.9  # inches
LEAST_HEIGHT = 8.0  # inches of the panel


def write_picture(view: RunView, path: Path) -> None:
    """Write the picture of a run; the format follows the suffix (png, svg or pdf)."""
    _draw(view).save(path)


def draw_run(view: RunView) -> Figure:
    """Draw a run: the map at the left, what the run was and how it went at the right."""
    return _draw(view).figure


def _draw(view: RunView) -> Paper:
    world, trace = view.world, view.trace
    extent = extent_of(world)
    scale = min(MAP_HEIGHT / extent.height, MAP_WIDTH / extent.width)
    map_width, map_height = scale * extent.width, scale * extent.height
    panel_height = max(map_height, LEAST_HEIGHT)
    paper = Paper.of_size(map_width + PANEL_WIDTH + 3.0 * MARGIN, panel_height + 2.0 * MARGIN)
    axes = paper.axes_at(MARGIN, (paper.height - map_height) / 2.0, map_width, map_height)
    furniture = fixed_outlines(world) + movable_outlines(world, trace, -1)
    draw_floor(axes, world, view.costmap, furniture=furniture)
    draw_people_tracks(axes, view)
    draw_robot_tracks(axes, view)
    draw_contacts(axes, trace)
    panel = paper.axes_at(map_width + 2.0 * MARGIN, MARGIN, PANEL_WIDTH, panel_height)
    draw_panel(panel, view, panel_height)
    return paper
