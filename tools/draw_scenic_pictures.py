"""Pictures of docs/scenic-library.md and docs/write-a-scenario.md.

    python tools/draw_scenic_pictures.py

They are drawn from the library itself: run it again after the library has changed.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from mrta_falsify.core.world import Blockage, World
from reports.colours import robot_colour
from reports.contact_sheet import write_contact_sheet
from reports.floor_plot import draw_floor
from scenic_worlds.places import places_of
from scenic_worlds.program import compile_program
from scenic_worlds.shipped import scenario_names, scenario_path
from simulator_interface.furniture_shapes import Mesh, build_mesh

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs" / "pictures" / "scenic"
PAGE = ROOT / "docs" / "write-a-scenario.md"
SEED = 3  # of the pictured worlds
DPI = 100

CLASSES = (
    "Bed", "Stretcher", "BedsideCabinet", "Cabinet", "Locker", "Bookshelf", "Desk", "Table",
    "Bench", "Sofa", "VendingMachine", "Curtain", "Chair", "Stool", "Trolley", "Wheelchair",
    "IVStand", "TrashBin", "Pallet", "Crate",
)  # fmt: skip


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    draw_places(FOLDER / "places.png")
    draw_furniture(FOLDER / "furniture.png")
    draw_scenarios(FOLDER / "scenarios.png")
    draw_night_shift(FOLDER / "night_shift.png")


def new_figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def fill(axes: Axes, shape: BaseGeometry, colour: str, label: str, alpha: float = 0.5) -> Patch:
    """Polygons of ``shape`` with their holes; returns the legend's entry."""
    for part in getattr(shape, "geoms", [shape]):
        rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
        path = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
        axes.add_patch(
            PathPatch(
                path, facecolor=colour, edgecolor=colour, alpha=alpha, linewidth=1.5, zorder=6
            )
        )
    return Patch(facecolor=colour, alpha=alpha, label=label)


def draw_places(path: Path) -> None:
    """Every kind of place on the AWS hospital."""
    places = places_of("aws_hospital")
    figure = new_figure(9.0, 9.4)
    axes = figure.add_axes((0.05, 0.03, 0.6, 0.94))
    draw_floor(axes, places.layout, label_size=8.0)
    axes.set_xlim(-12.8, 12.8)
    axes.set_ylim(-32.5, 6.5)
    lane = np.array(places.route(0, 2).points)
    (line,) = axes.plot(
        lane[:, 0], lane[:, 1], color="#c2410c", linewidth=2.5, zorder=7, label="route(0, 2)"
    )
    axes.annotate(
        "", lane[-1][:2], lane[-2][:2], arrowprops={"color": "#c2410c", "width": 1.5}, zorder=7
    )
    beds = "along_wall('ward_northwest', fits=(1, 2.2))"
    entries = [
        fill(axes, places.corridors.polygons, "#86c5a4", "corridors", 0.35),
        fill(axes, places.room("ward_southeast").polygons, "#7aa6d8", "room('ward_southeast')"),
        fill(axes, places.inside_rooms.intersect(places.room(4)).polygons, "#b39ddb",
             "inside_rooms (in room 4)"),
        fill(axes, places.near("day_surgery", 1.5).polygons, "#f2b84b", "near('day_surgery', 1.5)"),
        fill(axes, places.doorway("ward_northeast").polygons, "#d64550",
             "doorway('ward_northeast')", 0.7),
        fill(axes, places.queue_area(5).polygons, "#6d597a", "queue_area(5)"),
        fill(axes, places.along_wall(1, (0.02, 0.3)).polygons, "#008080", "along_wall(1)", 0.9),
        fill(axes, places.along_wall(5, (0.02, 0.3), (1.0, 2.2)).polygons, "#b5179e", beds, 0.9),
        line,
    ]  # fmt: skip
    figure.legend(handles=entries, loc="center left", bbox_to_anchor=(0.655, 0.5), fontsize=8.5,
                  frameon=False, labelspacing=1.2)  # fmt: skip
    figure.savefig(path)


def sampled(text: str, seed: int = SEED) -> World:
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "picture.scenic"
        program.write_text(text)
        return compile_program(program).sample(seed)


def draw_furniture(path: Path) -> None:
    """Every class of furniture, to scale, seen from its front right, with its size."""
    lines = [
        f"new {kind} at ({4.0 * (i % 5)}, {-4.0 * (i // 5)}), facing -90 deg, with name '{kind}',"
        " with regionContainedIn everywhere, with allowCollisions True"
        for i, kind in enumerate(CLASSES)
    ]
    world = sampled(
        "model scenic_worlds.model\nnew Robot with start_room 0\nparam tasks = [(0, 1, 2, 300)]\n"
        + "\n".join(lines)
    )
    items = {item.name: item for item in world.furniture}
    figure = new_figure(10.0, 9.2)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-1.5, 13.3)
    axes.set_ylim(-11.7, 1.9)
    for i, kind in enumerate(CLASSES):
        item = items[kind]
        length, width = np.ptp(np.asarray(item.polygon), axis=0)  # it faces east
        mesh = build_mesh(item.mesh, length=length, width=width, height=item.height)
        at = np.array([3.0 * (i % 5), -3.35 * (i // 5)])
        draw_mesh(axes, mesh, at)
        text = f"{kind}\n{width:.2f} x {length:.2f} x {item.height:.2f} m"
        axes.text(at[0], at[1] - 0.85, text, ha="center", va="top", size=8.5)
    figure.savefig(path)


def draw_mesh(axes: Axes, mesh: Mesh, at: np.ndarray) -> None:
    """Triangles seen from the front right and above (axonometric), lit from the left."""
    turn, tilt = np.deg2rad(-145.0), np.deg2rad(28.0)
    c, s = np.cos(turn), np.sin(turn)
    turned = mesh.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    right, away, up = turned.T
    seen = np.stack([right, up * np.cos(tilt) + away * np.sin(tilt)], axis=1) + at
    depth = away * np.cos(tilt) - up * np.sin(tilt)
    corners = turned[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    facing = normal @ np.array([0.0, -np.cos(tilt), np.sin(tilt)]) > 1e-6
    light = 0.62 + 0.38 * np.clip(normal @ np.array([-0.5, -0.3, 0.8]), 0.0, 1.0)
    order = np.argsort(-depth[mesh.faces].mean(axis=1), kind="stable")
    order = order[facing[order]]
    colours = light[order, None] * np.array([[0.93, 0.80, 0.58]])
    axes.add_collection(
        PolyCollection(
            list(seen[mesh.faces[order]]), facecolors=colours, edgecolors=colours, lw=0.4
        )
    )


def draw_scenarios(path: Path) -> None:
    """One world of each shipped program."""
    names = scenario_names()
    columns = 7
    rows = -(-len(names) // columns)
    figure = new_figure(2.4 * columns, 5.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
        axes.set_aspect("equal")
    for axes, name in zip(grid.flat, names, strict=False):
        program = compile_program(scenario_path(name))
        draw_world(axes, program.sample(SEED), program.sample(SEED + 1))
        axes.set_title(name, fontsize=10, fontweight="bold")
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.96, 0.04, 0.08)
    figure.savefig(path)


def draw_world(axes: Axes, world: World, other: World) -> None:
    """Small map: what stands elsewhere in the other world of the program is in colour."""
    fixed = {item.polygon.tobytes() for item in other.furniture}
    for wall in world.walls:
        axes.fill(*wall.polygon.T, facecolor="#30343f", edgecolor="#30343f", linewidth=0.6)
    for item in world.furniture:
        if item.polygon.tobytes() in fixed:
            axes.fill(*item.polygon.T, facecolor="#ddd3c0", edgecolor="#b8a888", linewidth=0.3)
        else:
            axes.fill(*item.polygon.T, facecolor="#f2a33a", edgecolor="#7a3e00", lw=0.8, zorder=6)
    for event in world.events:
        if isinstance(event, Blockage):
            axes.fill(*event.polygon.T, facecolor="#ffd9d9", edgecolor="#c1121f", hatch="/////",
                      linewidth=1.0, zorder=6)  # fmt: skip
    for human in world.humans:
        axes.plot(*human.route.T, color="#6d597a", linewidth=0.9, linestyle=":", zorder=7)
        axes.plot(*human.route[0], "o", color="#6d597a", markersize=4, zorder=8)
    for number, robot in enumerate(world.robots):
        axes.plot(*robot.pose[:2], "o", color=robot_colour(number), markersize=7,
                  markeredgecolor="black", markeredgewidth=0.6, zorder=9)  # fmt: skip
    for number, room in enumerate(world.rooms):
        axes.text(room.point[0], room.point[1] + 0.5, str(number), fontsize=7, ha="center",
                  va="bottom", zorder=8)  # fmt: skip
    if world.bounds[3] - world.bounds[1] > 50.0:  # the AWS floor, without its entrance
        axes.set_ylim(-32.5, 14.0)


def draw_night_shift(path: Path) -> None:
    """Six worlds of the program of step 2 of the page."""
    programs = re.findall(r"```scenic\n(.*?)```", PAGE.read_text(), re.DOTALL)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "night_shift.scenic"
        file.write_text(programs[1])
        program = compile_program(file)
        worlds = [program.realise(program.candidate(0, i)).world for i in range(6)]
    captions = [f"{i:03d}" for i in range(len(worlds))]
    write_contact_sheet(worlds, path, title="night_shift", captions=captions)


if __name__ == "__main__":
    main()
