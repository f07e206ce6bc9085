"""Pictures of layouts, seen from above: solids, rooms, lanes, waiting and parking places.

    python -m tools.draw_layout NAME FILE.png

NAME is a shipped layout.
"""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.axes import Axes

from mrta_falsify.core.world import World
from reports.floor_plot import paint_floor, set_extent
from reports.floor_scene import Extent, floor_scene
from reports.paper import Paper
from scenic_worlds.layouts import load_layout

LARGEST = 15.0  # inches, longer side
SCALE = 0.34  # inches per metre, where that fits
RELEASE = "#e07000"  # areas where a robot frees a resource


def draw_layout(world: World, path: Path) -> None:
    """Write a picture of a layout; the format follows the suffix (png, svg or pdf).

    Args:
        world: the layout; robots, people and tasks are not drawn.
        path: file to write.
    """
    extent = Extent(*map(float, world.bounds))
    scale = min(SCALE, LARGEST / max(extent.width, extent.height))
    paper = Paper.of_size(extent.width * scale, extent.height * scale)
    axes = paper.axes_at(0.0, 0.0, paper.width, paper.height)
    set_extent(axes, extent)
    axes.axis("off")
    paint_floor(axes, floor_scene(world))
    draw_release_areas(axes, world)
    paper.save(path)


def draw_release_areas(axes: Axes, world: World) -> None:
    """Draw where robots free the resources they hold."""
    for resource in world.resources:
        axes.fill(*resource.release_area.T, facecolor="none", edgecolor=RELEASE, ls="--", lw=0.9)


if __name__ == "__main__":
    draw_layout(load_layout(sys.argv[1]), Path(sys.argv[2]))
