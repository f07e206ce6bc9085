"""Top-down pictures of a run: the floor, what moved on it, and how it was judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Blockage, World
from reports.furnishing import fixed_outlines, movable_outlines

#: one colour per robot, told apart by colour-blind readers too (Okabe and Ito, extended)
ROBOT_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc3f9b",
    "#b58900",
    "#56b4e9",
    "#7a3fc0",
    "#8c564b",
    "#3d8b37",
    "#e6194b",
    "#00798c",
    "#5c5c8a",
)
INK = "#1f2430"
WALL = "#30343f"
FURNITURE = "#c9bda6"
FURNITURE_EDGE = "#8d8069"
HUMAN = "#5b5b6b"
HUMAN_BLIND = "#a3238e"
ROOM = "#1f2430"
SAFE, UNSAFE = "#1a7f37", "#c1121f"

MAP_HEIGHT = 16.0  # inches at most
MAP_WIDTH = 14.0  # inches at most
PANEL_WIDTH = 4.9  # inches
MARGIN = 0.55  # inches
DPI = 100


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunView:
    """What pictures and pages of one run are made from."""

    world: World
    trace: Trace
    verdicts: tuple[Verdict, ...] = ()
    costmap: Costmap | None = None  #: at time 0
    facts: tuple[tuple[str, str], ...] = ()  #: label and text, shown in this order


def robot_colour(number: int) -> str:
    """Colour (#rrggbb) of a robot, the same in every picture."""
    return ROBOT_COLOURS[number % len(ROBOT_COLOURS)]


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
    _draw_humans(axes, view)
    _draw_robots(axes, view)
    _draw_contacts(axes, view.trace)
    left = (map_width + 2.0 * MARGIN) / width
    panel = figure.add_axes(
        (left, MARGIN / height, PANEL_WIDTH / width, 1.0 - 2.0 * MARGIN / height)
    )
    _draw_panel(panel, view, height - 2.0 * MARGIN)
    return figure


def extent_of(world: World) -> tuple[float, float, float, float]:
    """Rectangle (x min, y min, x max, y max) [m] that holds everything drawn, plus 0.6 m."""
    parts = [
        *(wall.polygon for wall in world.walls),
        *(item.polygon for item in world.furniture),
        *(room.point[None] for room in world.rooms),
        *(robot.pose[None, :2] for robot in world.robots),
    ]
    if not parts:
        x_min, y_min, x_max, y_max = world.bounds
        return float(x_min), float(y_min), float(x_max), float(y_max)
    points = np.concatenate(parts)
    low = np.maximum(points.min(axis=0) - 0.6, world.bounds[:2])
    high = np.minimum(points.max(axis=0) + 0.6, world.bounds[2:])
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


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
    for event in world.events:
        if isinstance(event, Blockage):
            axes.add_patch(
                Polygon(
                    event.polygon,
                    facecolor="#ffd9d9",
                    edgecolor=UNSAFE,
                    hatch="////",
                    linewidth=0.8,
                    zorder=4,
                )
            )
            x, y = event.polygon.mean(axis=0)
            _label(
                axes, (x, y), f"blocked {event.start:.0f}-{event.end:.0f} s", size=7, colour=UNSAFE
            )
    _draw_queues(axes, world)
    _draw_rooms(axes, world, label_size)
    _draw_scale(axes, world)


def _draw_costmap(axes: Axes, costmap: Costmap) -> None:
    image = costmap_image(costmap)
    rows, cols = costmap.cost.shape
    x, y = costmap.origin
    extent = (x, x + cols * costmap.resolution, y, y + rows * costmap.resolution)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest", zorder=0)
    axes.set_aspect("equal")


def costmap_image(costmap: Costmap) -> np.ndarray:
    """RGB ``(rows, cols, 3)`` uint8 of Nav2 bytes: white free, blue inflated, rose, grey."""
    free, high = np.array([255, 255, 255]), np.array([150, 190, 232])
    share = np.linspace(0.0, 1.0, 253)[:, None]
    table = np.zeros((256, 3), dtype=np.uint8)
    table[:253] = (free + (high - free) * share).astype(np.uint8)
    table[INSCRIBED] = (246, 198, 208)
    table[LETHAL] = (226, 120, 138)
    table[UNKNOWN] = (232, 232, 232)
    return np.asarray(table[costmap.cost])


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
            _write(
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
        _write(axes, x, y, "P", size=5.5, color="#2f5a2f", ha="center", va="center", zorder=6)


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
        _label(axes, (x, y + 0.42), text, size=size, colour=ROOM, weight="bold", va="bottom")


def _draw_scale(axes: Axes, world: World) -> None:
    x_min, y_min, x_max, _ = extent_of(world)
    length = 5.0 if x_max - x_min > 12.0 else 1.0
    x, y = x_min + 0.4, y_min + 0.4
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2.5, zorder=12, solid_capstyle="butt")
    _label(axes, (x + length / 2.0, y + 0.12), f"{length:g} m", size=8, va="bottom")


def _write(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Text that is never read as a formula: names come from worlds."""
    axes.text(x, y, text, parse_math=False, **style)


def _label(
    axes: Axes,
    at: tuple[float, float],
    text: str,
    *,
    size: float,
    colour: str = INK,
    weight: str = "normal",
    va: str = "center",
) -> None:
    _write(
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


# --- what moved ----------------------------------------------------------------------------


def _column(trace: Trace, name: str) -> np.ndarray | None:
    column = trace.columns.get(name)
    return column if column is not None and len(column) else None


def _draw_humans(axes: Axes, view: RunView) -> None:
    track = _column(view.trace, "human_position")
    for number, human in enumerate(view.world.humans):
        colour = HUMAN if human.reacts_to_robots else HUMAN_BLIND
        if track is None:
            last = human.route[0]
        else:
            line = track[:, number]
            axes.plot(
                line[:, 0],
                line[:, 1],
                color=colour,
                linewidth=0.9,
                alpha=0.45,
                linestyle=(0, (3, 2)),
                zorder=6,
            )
            last = line[-1]
        x, y = last
        axes.plot(x, y, marker="o", markersize=8, color=colour, markeredgecolor="white", zorder=9)
        _write(
            axes,
            x,
            y,
            "h",
            size=6,
            color="white",
            ha="center",
            va="center_baseline",
            zorder=10,
            clip_on=True,
        )


def _draw_robots(axes: Axes, view: RunView) -> None:
    poses = _column(view.trace, "pose")
    for number, robot in enumerate(view.world.robots):
        colour = robot_colour(number)
        track = poses[:, number] if poses is not None else robot.pose[None]
        axes.plot(
            track[:, 0],
            track[:, 1],
            color=colour,
            linewidth=1.9,
            alpha=0.85,
            zorder=7,
            solid_joinstyle="round",
        )
        axes.plot(
            *track[0, :2],
            marker="o",
            markersize=9,
            markerfacecolor="white",
            markeredgecolor=colour,
            markeredgewidth=1.8,
            zorder=8,
        )
        body = robot_outline(track[-1], robot.radius)
        axes.add_patch(Polygon(body, facecolor=colour, edgecolor="white", linewidth=0.9, zorder=11))
        _label(
            axes,
            (track[-1, 0] + 0.42, track[-1, 1] - 0.34),
            robot.name,
            size=8,
            colour=colour,
            weight="bold",
        )
    if poses is not None:
        _draw_waits(axes, view.trace, poses)
        _draw_stops(axes, view.trace, poses)


def robot_outline(pose: Array, radius: float) -> Array:
    """Arrow-shaped outline ``(5, 2)`` [m] at ``pose`` (x, y, yaw), pointing forward."""
    shape = (
        1.45 * radius * np.array([[1.2, 0.0], [0.1, 0.95], [-1.0, 0.8], [-1.0, -0.8], [0.1, -0.95]])
    )
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(shape @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def _draw_waits(axes: Axes, trace: Trace, poses: Array) -> None:
    """Rings where robots stood waiting; the ring's area grows with the time."""
    phase = _column(trace, "phase")
    if phase is None:
        return
    for number in range(poses.shape[1]):
        speed = np.linalg.norm(
            np.diff(poses[:, number, :2], axis=0, prepend=poses[:1, number, :2]), axis=1
        )
        waits = (speed < 0.02 * trace.dt) & np.isin(
            phase[:, number], (Phase.QUEUEING, Phase.DRIVING, Phase.PLANNING)
        )
        for first, last in runs_of(waits):
            seconds = (last - first + 1) * trace.dt
            if seconds < 2.0:
                continue
            x, y = poses[first, number, :2]
            axes.scatter(
                x,
                y,
                s=60.0 + 12.0 * min(seconds, 120.0),
                facecolor="none",
                edgecolor=robot_colour(number),
                linewidth=1.1,
                alpha=0.8,
                zorder=8,
            )
            if seconds >= 10.0:
                _label(
                    axes, (x, y - 0.55), f"{seconds:.0f} s", size=6.5, colour=robot_colour(number)
                )


def runs_of(flags: ArrayLike) -> list[tuple[int, int]]:
    """First and last index of every run of true values in ``flags`` ``(K,)``."""
    padded = np.concatenate([[False], np.asarray(flags, dtype=bool), [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _draw_stops(axes: Axes, trace: Trace, poses: Array) -> None:
    """Pick-ups and drop-offs, in a row above the place where they happened, in their order."""
    markers = {"picked-up": "^", "dropped-off": "v"}
    places: list[Array] = []
    counts: list[int] = []
    for event in trace.events:
        marker = markers.get(event.kind)
        if marker is None or event.robot < 0:
            continue
        where = poses[_tick_of(trace, event), event.robot, :2]
        near = [i for i, place in enumerate(places) if np.hypot(*(place - where)) < 1.5]
        if not near:
            places.append(where)
            counts.append(0)
            near = [len(places) - 1]
        x, y = places[near[0]] + (0.55 * counts[near[0]] - 0.55, 1.15)
        counts[near[0]] += 1
        axes.plot(
            x,
            y,
            marker=marker,
            markersize=9,
            color=robot_colour(event.robot),
            markeredgecolor=INK,
            markeredgewidth=0.7,
            zorder=12,
        )


def _tick_of(trace: Trace, event: StackEvent) -> int:
    return int(np.clip(np.searchsorted(trace.columns["time"], event.time), 0, len(trace) - 1))


def _draw_contacts(axes: Axes, trace: Trace) -> None:
    contact, poses = _column(trace, "contact"), _column(trace, "pose")
    if contact is None or poses is None:
        return
    for number in range(contact.shape[1]):
        for first, _ in runs_of(np.any(contact[:, number], axis=1)):
            axes.plot(
                *poses[first, number, :2],
                marker="X",
                markersize=13,
                color=UNSAFE,
                markeredgecolor="white",
                markeredgewidth=1.0,
                zorder=13,
            )


# --- the panel -------------------------------------------------------------------------------


def _draw_panel(axes: Axes, view: RunView, height: float) -> None:
    """Text column; ``height`` [in] sets the line pitch so that text never overlaps."""
    axes.axis("off")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-height, 0.0)
    y = -0.25
    _write(axes, 0.0, y, view.world.name, size=17, weight="bold", color=INK, va="center")
    y -= 0.42
    for label, text in view.facts:
        _write(axes, 0.0, y, label, size=9.5, color="#666666", va="center")
        _write(axes, 0.36, y, text, size=9.5, color=INK, va="center")
        y -= 0.235
    y = _draw_verdicts(axes, view.verdicts, y - 0.22)
    y = _draw_fleet(axes, view, y - 0.22)
    _draw_legend(axes, view, y - 0.1, height)


def _heading(axes: Axes, y: float, text: str) -> float:
    _write(axes, 0.0, y, text, size=11.5, weight="bold", color=INK, va="center")
    return y - 0.29


def _draw_verdicts(axes: Axes, verdicts: Sequence[Verdict], y: float) -> float:
    if not verdicts:
        return y
    y = _heading(axes, y, "Verdicts")
    for verdict in verdicts:
        colour = UNSAFE if verdict.violated else SAFE
        mark = "violated" if verdict.violated else "holds"
        _write(axes, 0.0, y, verdict.spec, size=9.5, color=INK, va="center")
        _write(axes, 0.60, y, mark, size=9.5, color=colour, weight="bold", va="center")
        _write(
            axes,
            1.0,
            y,
            robustness_text(verdict.robustness),
            size=9.5,
            color=INK,
            va="center",
            ha="right",
        )
        y -= 0.225
        if verdict.violated:
            y = _draw_blame(axes, verdict, y)
    return y


def _draw_blame(axes: Axes, verdict: Verdict, y: float) -> float:
    when = f"at {verdict.violated_at:.1f} s" if verdict.violated_at is not None else ""
    who = ", ".join(verdict.who[:4]) + (", ..." if len(verdict.who) > 4 else "")
    text = "  ".join(part for part in (when, who) if part)
    if not text:
        return y
    _write(axes, 0.04, y, text, size=8.5, color=UNSAFE, va="center")
    return y - 0.225


def robustness_text(value: float) -> str:
    """Robustness as a reader wants it: three digits, a sign, a word for infinity."""
    if np.isinf(value):
        return "unbounded" if value > 0 else "-unbounded"
    return f"{value:+.3g}"


def _draw_fleet(axes: Axes, view: RunView, y: float) -> float:
    if not view.world.robots:
        return y
    y = _heading(axes, y, "Robots at the end")
    phase, left = _column(view.trace, "phase"), _column(view.trace, "tasks_left")
    poses = _column(view.trace, "pose")
    for number, robot in enumerate(view.world.robots[:24]):
        axes.plot(0.025, y, marker="s", markersize=9, color=robot_colour(number), clip_on=False)
        _write(axes, 0.07, y, robot.name, size=9.5, color=INK, va="center")
        if phase is not None and left is not None and poses is not None:
            state = Phase(int(phase[-1, number])).name.lower().replace("_", " ")
            stops = int(left[-1, number])
            rest = f"{state}, {stops} stop{'s' * (stops != 1)} left" if stops else state
            length = np.linalg.norm(np.diff(poses[:, number, :2], axis=0), axis=1).sum()
            _write(axes, 0.33, y, rest, size=9.5, color=INK, va="center")
            _write(axes, 1.0, y, f"{length:.0f} m", size=9.5, color=INK, va="center", ha="right")
        y -= 0.225
    return y


def _draw_legend(axes: Axes, view: RunView, y: float, height: float) -> None:
    def dot(marker: str, face: str, edge: str, size: float, label: str) -> Line2D:
        return Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            markersize=size,
            markerfacecolor=face,
            markeredgecolor=edge,
            label=label,
        )

    handles = [
        Line2D([], [], color="#444444", linewidth=2, label="way of a robot (its colour)"),
        dot("o", "white", "#444444", 8, "start"),
        dot(">", "#444444", "white", 10, "robot at the end"),
        dot("^", "#888888", INK, 7, "pick-up"),
        dot("v", "#888888", INK, 7, "drop-off"),
        dot("o", "none", "#444444", 12, "waited here (area: time)"),
        dot("X", UNSAFE, "white", 11, "contact"),
        Line2D([], [], color=HUMAN, linewidth=1, linestyle="--", marker="o", label="person"),
        Line2D(
            [],
            [],
            color=HUMAN_BLIND,
            linewidth=1,
            linestyle="--",
            marker="o",
            label="person who ignores robots",
        ),
        dot("*", "#ffbf00", ROOM, 11, "room point"),
        dot("s", "#fff6cc", "#8a6d00", 8, "queue spot, 1 = head"),
        dot("o", "#e4f0e4", "#4c7a4c", 8, "parking spot"),
        Line2D([], [], color="#7d8aa5", linewidth=1, alpha=0.6, label="right-hand lane"),
        Patch(facecolor=WALL, label="wall"),
        Patch(facecolor=FURNITURE, edgecolor=FURNITURE_EDGE, label="furniture"),
        Patch(facecolor="#96bee8", label="costmap: near an obstacle"),
        Patch(facecolor="#f6c6d0", label="costmap: robot would touch"),
    ]
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(-0.02, 1.0 + y / height),
        fontsize=9,
        frameon=False,
        title="Legend",
        title_fontproperties={"weight": "bold", "size": 11.5},
        alignment="left",
        labelspacing=0.55,
        borderaxespad=0.0,
    )
