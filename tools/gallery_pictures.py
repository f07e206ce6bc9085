"""Pictures of the gallery: a failure as found and at its smallest, and who waits for whom."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon
from PIL import Image

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.task_history import robots_of, tasks_of
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.wait_account import Arrow, WaitAccount, tick_of, wait_account
from mrta_falsify.core.world import World
from reports.colours import INK, UNSAFE, person_colour, robot_colour
from reports.floor_drawings import place_of
from reports.floor_plot import draw_floor, draw_label
from reports.floor_scene import extent_of, fixed_outlines, movable_outlines, robot_outline

DPI = 100
COLOURS = 128  # of the palette: keeps the files small
PAD = 2.0  # m around the ways of the robots
CLOSE_UP = 3.2  # m at least around the robots concerned
TRAIL = 20.0  # s of the way behind robots and people in the close-up
NEEDED = "#f2a33a"  # furniture that the smallest world has, too
CLOSE_WIDTH = 4.6  # inches
LEAST_CLOSE = 3.2  # inches of height
GRAPH_HEIGHT = 2.2  # inches
MAP_HEIGHT = 7.4  # inches, of maps side by side
LEAST_WIDE = 0.46  # times as wide as high
STACKED = 0.9  # times as wide as high: from there one map stands above the other
GAP = 0.42  # inches
LETTERS = 14  # of a title on an inch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """A failing run."""

    world: World
    trace: Trace
    verdict: Verdict  #: the one that explains it

    @property
    def tick(self) -> int:
        """When the violation was found, the end of the run if at no certain time."""
        return tick_of(self.verdict, self.trace)

    @property
    def account(self) -> WaitAccount:
        """Who waits for whom at that time."""
        return wait_account(self.verdict, self.trace)

    @property
    def concerned(self) -> list[str]:
        """Robots of the verdict, or those that had its tasks."""
        named = {*self.account.robots, *self.verdict.who}
        named |= set(robots_of(tasks_of(self.verdict), self.trace))
        robots = [name for name in self.trace.robots if name in named]
        return robots or list(self.trace.robots)

    def place_of(self, name: str) -> Array | None:
        """Where a robot, a person or a thing is at the moment, ``(2,)`` [m]."""
        return place_of(self.world, self.trace, self.tick, name)


def write_picture(original: Seen, smallest: Seen, path: Path) -> None:
    """Both runs on their floors, the moment close up, and the wait-for graph, as a PNG."""
    figure = draw_case(original, smallest)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DPI, format="png")
    image = Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(path, optimize=True)


def draw_case(original: Seen, smallest: Seen) -> Figure:
    """Figure of a case: two maps of one scale; beside them close-ups and the graph."""
    extent = _used(original, smallest)
    wide = (extent[2] - extent[0]) / (extent[3] - extent[1])
    account = smallest.account
    graph = GRAPH_HEIGHT if account.arrows else 0.0
    if wide > STACKED:
        map_width, map_height = 7.2, 7.2 / wide
        low = max(map_height, LEAST_CLOSE + graph)  # of the lower row
        high = max(map_height, LEAST_CLOSE)
        height = low + high + 3 * GAP
        corners = [(GAP, height - GAP - map_height), (GAP, GAP + low - map_height)]
        left = map_width + 2 * GAP
        closes = [(original, height - GAP, high), (smallest, GAP + low, low - graph)]
    else:
        map_width, map_height = MAP_HEIGHT * wide, MAP_HEIGHT
        height = map_height + 2 * GAP
        corners = [(GAP, GAP), (map_width + 2 * GAP, GAP)]
        left = 2 * map_width + 3 * GAP
        closes = [(smallest, height - GAP, min(map_height - graph, CLOSE_WIDTH))]
    width = left + CLOSE_WIDTH + GAP
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)

    def axes_at(x: float, y: float, wide: float, high: float) -> Axes:
        return figure.add_axes((x / width, y / height, wide / width, high / height))

    colours = {name: robot_colour(i) for i, name in enumerate(original.trace.robots)}
    needed = {item.name for item in smallest.world.furniture}
    titles = {original: "as found", smallest: "smallest"}
    for seen, (x, y) in zip((original, smallest), corners, strict=True):
        axes = axes_at(x, y, map_width, map_height)
        _draw_map(axes, seen, extent, colours, needed, trail=np.inf)
        _write_title(axes, f"{titles[seen]}: {_contents(seen.world)}", map_width)
        _ring(axes, seen)
    for seen, top, high in closes:
        axes = axes_at(left, top - high, CLOSE_WIDTH, high)
        _draw_map(axes, seen, _around(seen, CLOSE_WIDTH / high), colours, needed, TRAIL)
        time = seen.trace.columns["time"][seen.tick]
        _write_title(axes, f"{titles[seen]}, at {time:.1f} s", CLOSE_WIDTH)
        _draw_waits(axes, seen, seen.account.arrows)
    if account.arrows:
        _, top, high = closes[-1]
        axes = axes_at(left, top - high - graph, CLOSE_WIDTH, graph - GAP)
        _draw_graph(axes, account, colours, CLOSE_WIDTH / (graph - GAP))
    return figure


def _write_title(axes: Axes, text: str, wide: float) -> None:
    """Title over axes that are ``wide`` [inches], on two lines if need be."""
    text = textwrap.fill(text, round(LETTERS * wide))
    axes.set_title(text, fontsize=9.0, color=INK, loc="left", parse_math=False)


def _contents(world: World) -> str:
    counts = (
        (len(world.robots), "robot", "robots"),
        (len(world.tasks), "task", "tasks"),
        (len(world.humans), "person", "people"),
        (len(world.furniture), "piece of furniture", "pieces of furniture"),
        (len(world.events), "event", "events"),
    )
    return ", ".join(f"{n} {one if n == 1 else many}" for n, one, many in counts if n)


def _used(original: Seen, smallest: Seen) -> Array:
    """Rectangle ``(4,)`` [m] around all ways of both runs, within the floor."""
    points = [seen.trace.columns["pose"][:, :, :2].reshape(-1, 2) for seen in (original, smallest)]
    both = np.concatenate(points)
    floor = np.asarray(extent_of(original.world))
    low = np.maximum(both.min(axis=0) - PAD, floor[:2])
    high = np.minimum(both.max(axis=0) + PAD, floor[2:])
    lacking = max(0.0, LEAST_WIDE * (high[1] - low[1]) - (high[0] - low[0]))
    low[0], high[0] = low[0] - lacking / 2.0, high[0] + lacking / 2.0
    return np.concatenate([low, high])


def _around(seen: Seen, wide: float) -> Array:
    """Rectangle of the close-up, ``wide`` times as wide as high."""
    names = {*seen.account.nodes, *seen.concerned}
    places = [place for name in sorted(names) if (place := seen.place_of(name)) is not None]
    points = np.array([place for place in places if np.all(np.isfinite(place))])
    low, high = points.min(axis=0) - CLOSE_UP, points.max(axis=0) + CLOSE_UP
    middle, size = (low + high) / 2.0, high - low
    size = np.array([max(size[0], size[1] * wide), max(size[1], size[0] / wide)])
    return np.concatenate([middle - size / 2.0, middle + size / 2.0])


def _draw_map(
    axes: Axes,
    seen: Seen,
    extent: Array,
    colours: dict[str, str],
    needed: set[str],
    trail: float,
) -> None:
    """The floor with the ways of the last ``trail`` seconds [s] before the moment."""
    world, trace, tick = seen.world, seen.trace, seen.tick
    furniture = fixed_outlines(world) + movable_outlines(world, trace, tick)
    draw_floor(axes, world, label_size=7.0, furniture=furniture)
    for item in world.furniture:
        if item.name in needed and not item.movable:
            axes.add_patch(Polygon(item.polygon, facecolor=NEEDED, edgecolor="#7a3e00", zorder=3.5))
    first = max(0, tick - round(min(trail, trace.duration) / trace.dt))
    for number, human in enumerate(world.humans):
        way = trace.columns["human_position"][first : tick + 1, number]
        colour = person_colour(blind=not human.reacts_to_robots)
        axes.plot(*way.T, color=colour, linewidth=0.9, linestyle=(0, (3, 2)), zorder=6)
        if np.all(np.isfinite(way[-1])):
            axes.add_patch(Circle(way[-1], human.radius, facecolor=colour, zorder=10))
            draw_label(axes, (way[-1][0], way[-1][1] + 0.4), human.name, size=6.5, colour=colour)
    for number, robot in enumerate(world.robots):
        colour = colours.get(robot.name, INK)
        poses = trace.columns["pose"][first : tick + 1, number]
        alpha = 0.45 if np.isfinite(trail) else 0.8
        axes.plot(*poses[:, :2].T, color=colour, linewidth=1.7, alpha=alpha, zorder=7)
        x, y, yaw = poses[-1]
        if np.isfinite(trail):  # close up: as large as it is
            axes.add_patch(Circle((x, y), robot.radius, facecolor=colour, zorder=11))
            nose = robot.radius * np.array([np.cos(yaw), np.sin(yaw)])
            axes.plot((x, x + nose[0]), (y, y + nose[1]), color="white", linewidth=1.5, zorder=12)
            path = trace.path_at(number, tick)
            axes.plot(*path.T, color=colour, linewidth=1.3, linestyle=(0, (2, 1.5)), zorder=8)
        else:
            body = robot_outline(poses[-1], robot.radius)
            axes.add_patch(Polygon(body, facecolor=colour, edgecolor="white", zorder=11))
        draw_label(axes, (x, y - 0.5), robot.name, size=7.5, colour=colour, weight="bold")
    axes.set_xlim(extent[0], extent[2])
    axes.set_ylim(extent[1], extent[3])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xticks([])
    axes.set_yticks([])
    for text in axes.texts:
        text.set_clip_on(True)


def _ring(axes: Axes, seen: Seen) -> None:
    """Where it happened."""
    places = [seen.place_of(name) for name in seen.concerned]
    points = np.array([place for place in places if place is not None])
    middle = points.mean(axis=0)
    radius = min(float(np.linalg.norm(points - middle, axis=1).max()) + 1.0, 4.0)
    axes.add_patch(Circle(middle, radius, fill=False, edgecolor=UNSAFE, linewidth=1.6, zorder=13))


def _draw_waits(axes: Axes, seen: Seen, arrows: Sequence[Arrow]) -> None:
    for arrow in arrows:
        start, end = seen.place_of(arrow.start), seen.place_of(arrow.end)
        if start is not None and end is not None and np.hypot(*(end - start)) > 0.1:
            _arrow(axes, start, end, shrink=6.0, scale=14.0)


def _arrow(axes: Axes, start: Array, end: Array, *, shrink: float, scale: float) -> None:
    axes.add_patch(
        FancyArrowPatch(
            tuple(start), tuple(end), arrowstyle="-|>", mutation_scale=scale, color=UNSAFE,
            linewidth=1.8, connectionstyle="arc3,rad=0.18", shrinkA=shrink, shrinkB=shrink,
            zorder=14,
        )
    )  # fmt: skip


def _draw_graph(axes: Axes, account: WaitAccount, colours: dict[str, str], wide: float) -> None:
    """A node for each robot, person and thing; an arrow for each wait, with its cause."""
    axes.set_xlim(0.0, wide)
    axes.set_ylim(0.0, 1.0)
    axes.set_axis_off()
    axes.set_title("who waits for whom", fontsize=9.5, color=INK, loc="left", pad=2)
    names = account.nodes
    turn = np.pi + 2.0 * np.pi * np.arange(len(names)) / max(len(names), 1)
    reach = np.array([0.33 * wide, 0.32])
    place = {
        name: np.array([wide / 2.0, 0.5]) + reach * np.array([np.cos(angle), np.sin(angle)])
        for name, angle in zip(names, turn, strict=True)
    }
    for arrow in account.arrows:
        start, end = place[arrow.start], place[arrow.end]
        if np.allclose(start, end):
            continue
        _arrow(axes, start, end, shrink=22.0, scale=13.0)
        way = end - start
        side = np.array([way[1], -way[0]]) / np.hypot(*way)
        at = (start + end) / 2.0 + (0.5 * 0.18 * np.hypot(*way) + 0.13) * side
        draw_label(axes, (at[0], at[1]), arrow.cause, size=8.5, colour=UNSAFE)
    for name, (x, y) in place.items():
        box = {
            "boxstyle": "round,pad=0.35",
            "facecolor": colours.get(name, "#6b6b80"),
            "edgecolor": UNSAFE if name == account.root else "white",
        }
        axes.text(
            x, y, name, color="white", fontsize=8.5, ha="center", va="center", bbox=box,
            zorder=15, parse_math=False,
        )  # fmt: skip
