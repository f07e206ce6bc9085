"""Top-down pictures of a run: the floor, what moved on it, and how it was judged."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from reports.figure_floor import draw_floor
from reports.figure_motion import draw_contacts, draw_humans, draw_robots
from reports.figure_panel import draw_panel
from reports.furnishing import fixed_outlines, movable_outlines
from reports.run_view import RunView, extent_of

__all__ = ["RunView", "draw_floor", "draw_run", "write_picture"]

MAP_HEIGHT = 16.0  # inches at most
MAP_WIDTH = 14.0  # inches at most
PANEL_WIDTH = 4.9  # inches
MARGIN = 0.55  # inches
DPI = 100


def write_picture(view: RunView, path: Path) -> None:
    """Write the picture of a run; the format follows the suffix (png, svg or pdf)."""
    figure = draw_run(view)
    figure.savefig(path, dpi=DPI, metadata=_no_date(path))


def _no_date(path: Path) -> dict[str, None]:
    # A date in the file would make two equal runs differ.
    return {"Date": None} if path.suffix == ".svg" else {}


def draw_run(view: RunView) -> Figure:
    """Figure of a run: map at the left, what the run was and how it went at the right."""
    x_min, y_min, x_max, y_max = extent_of(view.world)
    scale = min(MAP_HEIGHT / (y_max - y_min), MAP_WIDTH / (x_max - x_min))
    map_width, map_height = scale * (x_max - x_min), scale * (y_max - y_min)
    height = max(map_height, 8.0) + 2.0 * MARGIN
    width = map_width + PANEL_WIDTH + 3.0 * MARGIN
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    bottom = (height - map_height) / 2.0
    axes = figure.add_axes(
        (MARGIN / width, bottom / height, map_width / width, map_height / height)
    )
    furniture = fixed_outlines(view.world) + movable_outlines(view.world, view.trace, -1)
    draw_floor(axes, view.world, view.costmap, furniture=furniture)
    draw_humans(axes, view)
    draw_robots(axes, view)
    draw_contacts(axes, view.trace)
    left = (map_width + 2.0 * MARGIN) / width
    panel = figure.add_axes(
        (left, MARGIN / height, PANEL_WIDTH / width, 1.0 - 2.0 * MARGIN / height)
    )
    draw_panel(panel, view, height - 2.0 * MARGIN)
    return figure
