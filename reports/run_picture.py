"""The picture of a run: its floor from above, what moved on it, and how it was judged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import confirmed
from reports.colours import (
    INFLATED,
    INK,
    PAINTS,
    SAFE,
    TOUCHING,
    UNSAFE,
    person_colour,
    robot_colour,
)
from reports.contents import RunView, kept_column
from reports.floor_plot import MARKS, BodyStyle, draw_floor, draw_label, paint_robot, write_text
from reports.floor_scene import Role, Shape, extent_of, fixed_outlines, movable_outlines
from reports.paper import MARGIN, Paper
from reports.sentences import robustness_text

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


# --- what moved -----------------------------------------------------------------------------

LEAST_WAIT = 2.0  # s; shorter stops are not marked
LONG_WAIT = 10.0  # s; longer waits are labelled
LARGEST_WAIT = 120.0  # s; rings of longer waits do not grow any more
AT_REST = 0.02  # m/s
MAX_STOPS = 8  # marks above one place
STOP_STEP = 0.55  # m between them
STOP_MARKERS = {"picked-up": "^", "dropped-off": "v"}
SAME_PLACE = 1.5  # m; stops nearer than this share a row of markers


def draw_people_tracks(axes: Axes, view: RunView) -> None:
    """Draw where people went, and where they are at the end."""
    track = kept_column(view.trace, "human_position")
    for number, human in enumerate(view.world.humans):
        colour = person_colour(blind=not human.reacts_to_robots)
        line = human.route[:1] if track is None else track[:, number]
        dashes = (0, (3, 2))
        axes.plot(*line.T, color=colour, linewidth=0.9, alpha=0.45, linestyle=dashes, zorder=6)
        x, y = line[-1]
        axes.plot(x, y, marker="o", markersize=8, color=colour, markeredgecolor="white", zorder=9)
        write_text(
            axes, x, y, "h", size=6, color="white", ha="center", va="center_baseline", zorder=10,
            clip_on=True,
        )  # fmt: skip


def draw_robot_tracks(axes: Axes, view: RunView) -> None:
    """Draw where robots went, stood and waited, and where they are at the end."""
    poses = kept_column(view.trace, "pose")
    for number, robot in enumerate(view.world.robots):
        track = robot.pose[None] if poses is None else poses[:, number]
        _draw_way(axes, track, robot_colour(number))
        body = Shape(
            role=Role.ROBOT,
            points=track[-1:, :2],
            number=number,
            radius=robot.radius,
            yaw=float(track[-1, 2]),
        )
        paint_robot(axes, body, BodyStyle(edge=0.9), layer=11)
        at = track[-1, :2] + np.array([0.42, -0.34])
        draw_label(axes, at, robot.name, size=8, colour=robot_colour(number), weight="bold")
    if poses is not None:
        _draw_waits(axes, view.trace, poses)
        _draw_stops(axes, confirmed(view.trace, view.world), poses)


def _draw_way(axes: Axes, track: Array, colour: str) -> None:
    """Draw a way with a ring at its start."""
    axes.plot(
        *track[:, :2].T, color=colour, linewidth=1.9, alpha=0.85, zorder=7, solid_joinstyle="round"
    )
    axes.plot(
        *track[0, :2], marker="o", markersize=9, markerfacecolor="white", markeredgecolor=colour,
        markeredgewidth=1.8, zorder=8,
    )  # fmt: skip


def _draw_waits(axes: Axes, trace: Trace, poses: Array) -> None:
    """Draw rings where robots stood waiting; the ring's area grows with the time."""
    phase = kept_column(trace, "phase")
    if phase is None:
        return
    waiting = (Phase.QUEUEING, Phase.DRIVING, Phase.PLANNING)
    for number in range(poses.shape[1]):
        steps = np.diff(poses[:, number, :2], axis=0, prepend=poses[:1, number, :2])
        still = np.linalg.norm(steps, axis=1) < AT_REST * trace.dt
        for first, last in runs_of(still & np.isin(phase[:, number], waiting)):
            seconds = (last - first + 1) * trace.dt
            if seconds >= LEAST_WAIT:
                _draw_wait(axes, poses[first, number, :2], seconds, robot_colour(number))


def _draw_wait(axes: Axes, place: Array, seconds: float, colour: str) -> None:
    axes.scatter(
        place[0],
        place[1],
        s=60.0 + 12.0 * min(seconds, LARGEST_WAIT),
        facecolor="none",
        edgecolor=colour,
        linewidth=1.1,
        alpha=0.8,
        zorder=8,
    )
    if seconds >= LONG_WAIT:
        below = place - np.array([0.0, 0.55])
        draw_label(axes, below, f"{seconds:.0f} s", size=6.5, colour=colour)


def runs_of(flags: ArrayLike) -> list[tuple[int, int]]:
    """First and last index of every run of true values in ``flags`` ``(K,)``."""
    padded = np.concatenate([[False], np.asarray(flags, dtype=bool), [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _draw_stops(axes: Axes, trace: Trace, poses: Array) -> None:
    """Draw pick-ups and drop-offs in order, in a row above the place where they happened.

    Of a place with more than ``MAX_STOPS`` the rest are only counted.
    """
    places: list[Array] = []
    counts: list[int] = []
    for event in trace.events:
        marker = STOP_MARKERS.get(event.kind)
        if marker is None or event.robot < 0:
            continue
        where = poses[_tick_of(trace, event), event.robot, :2]
        near = [i for i, place in enumerate(places) if np.hypot(*(place - where)) < SAME_PLACE]
        if not near:
            places.append(where)
            counts.append(0)
            near = [len(places) - 1]
        counts[near[0]] += 1
        if counts[near[0]] > MAX_STOPS:
            continue
        x, y = places[near[0]] + (STOP_STEP * (counts[near[0]] - 2), 1.15)
        axes.plot(
            x, y, marker=marker, markersize=9, color=robot_colour(event.robot), markeredgecolor=INK,
            markeredgewidth=0.7, zorder=12,
        )  # fmt: skip
    for place, count in zip(places, counts, strict=True):
        if count > MAX_STOPS:
            beside = (place[0] + STOP_STEP * (MAX_STOPS - 0.5), place[1] + 1.15)
            draw_label(axes, beside, f"+{count - MAX_STOPS}", size=7.0, colour=INK)


def _tick_of(trace: Trace, event: StackEvent) -> int:
    return int(np.clip(np.searchsorted(trace.columns["time"], event.time), 0, len(trace) - 1))


def draw_contacts(axes: Axes, trace: Trace) -> None:
    """Draw where robots touched something."""
    contact, poses = kept_column(trace, "contact"), kept_column(trace, "pose")
    if contact is None or poses is None:
        return
    for number in range(contact.shape[1]):
        for first, _ in runs_of(np.any(contact[:, number], axis=1)):
            axes.plot(
                *poses[first, number, :2], marker="X", markersize=13, color=UNSAFE,
                markeredgecolor="white", markeredgewidth=1.0, zorder=13,
            )  # fmt: skip


# --- the panel: verdicts, who was concerned, the fleet, the legend --------------------------

MAX_ROBOTS = 24  # rows of the fleet
MAX_NAMES = 4  # of a verdict
GREY = "#444444"

OUTCOME_COLOURS = {"violated": UNSAFE, "holds": SAFE, "not_judged": GREY}


def draw_panel(axes: Axes, view: RunView, height: float) -> None:
    """Write the text column; ``height`` [inches] sets the line pitch, so no text overlaps."""
    axes.axis("off")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-height, 0.0)
    _write(axes, 0.0, -0.25, view.world.name, size=17, weight="bold")
    y = -0.67
    for label, text in view.facts:
        _write(axes, 0.0, y, label, colour="#666666")
        _write(axes, 0.36, y, text)
        y -= 0.235
    y = _write_verdicts(axes, view, y - 0.22)
    y = _write_fleet(axes, view, y - 0.22)
    _draw_legend(axes, view.world, y - 0.1, height)


def _write(
    axes: Axes,
    x: float,
    y: float,
    text: str,
    *,
    colour: str = INK,
    size: float = 9.5,
    weight: str = "normal",
) -> None:
    ha = "right" if x == 1.0 else "left"
    write_text(axes, x, y, text, size=size, color=colour, weight=weight, va="center", ha=ha)


def _write_verdicts(axes: Axes, view: RunView, y: float) -> float:
    if not view.verdicts:
        return y
    _write(axes, 0.0, y, "Verdicts", size=11.5, weight="bold")
    y -= 0.29
    for verdict in view.verdicts:
        colour = OUTCOME_COLOURS[verdict.outcome]
        _write(axes, 0.0, y, verdict.spec)
        _write(axes, 0.60, y, verdict.outcome.replace("_", " "), colour=colour, weight="bold")
        if not verdict.not_judged:
            _write(axes, 1.0, y, robustness_text(verdict.robustness))
        y -= 0.225
        blame = _blame(verdict)
        if blame:
            _write(axes, 0.04, y, blame, colour=UNSAFE, size=8.5)
            y -= 0.225
    return y


def _blame(verdict: Verdict) -> str:
    """Say when a verdict was violated and by whom; empty if it holds."""
    if not verdict.violated:
        return ""
    when = f"at {verdict.violated_at:.1f} s" if verdict.violated_at is not None else ""
    names = list(verdict.who[:MAX_NAMES]) + ["..."] * (len(verdict.who) > MAX_NAMES)
    return "  ".join(part for part in (when, ", ".join(names)) if part)


def _write_fleet(axes: Axes, view: RunView, y: float) -> float:
    if not view.world.robots:
        return y
    _write(axes, 0.0, y, "Robots at the end", size=11.5, weight="bold")
    y -= 0.29
    phase, left = kept_column(view.trace, "phase"), kept_column(view.trace, "tasks_left")
    poses = kept_column(view.trace, "pose")
    for number, robot in enumerate(view.world.robots[:MAX_ROBOTS]):
        axes.plot(0.025, y, marker="s", markersize=9, color=robot_colour(number), clip_on=False)
        _write(axes, 0.07, y, robot.name)
        if phase is not None and left is not None and poses is not None:
            _write(axes, 0.33, y, _state(int(phase[-1, number]), int(left[-1, number])))
            length = np.linalg.norm(np.diff(poses[:, number, :2], axis=0), axis=1).sum()
            _write(axes, 1.0, y, f"{length:.0f} m")
        y -= 0.225
    return y


def _state(phase: int, stops: int) -> str:
    state = Phase(phase).name.lower().replace("_", " ")
    return f"{state}, {stops} stop{'s' * (stops != 1)} left" if stops else state


# --- legend ----------------------------------------------------------------------------------


def _draw_legend(axes: Axes, world: World, y: float, height: float) -> None:
    axes.legend(
        handles=[*_motion_entries(), *_people_entries(world), *_floor_entries()],
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


def _motion_entries() -> Iterator[Line2D]:
    yield Line2D([], [], color=GREY, linewidth=2, label="way of a robot (its colour)")
    yield _dot("o", "white", GREY, 8, "start")
    yield _dot(">", GREY, "white", 10, "robot at the end")
    yield _dot("^", "#888888", INK, 7, "pick-up")
    yield _dot("v", "#888888", INK, 7, "drop-off")
    yield _dot("o", "none", GREY, 12, "waited here (area: time)")
    yield _dot("X", UNSAFE, "white", 11, "contact")


def _people_entries(world: World) -> Iterator[Line2D]:
    blind = {not human.reacts_to_robots for human in world.humans}
    for is_blind, label in ((False, "person"), (True, "person who ignores robots")):
        if is_blind in blind:
            yield person_entry(label, blind=is_blind)


def person_entry(label: str, *, blind: bool) -> Line2D:
    """Entry of a legend for people with their routes."""
    colour = PAINTS[Role.BLIND_PERSON if blind else Role.PERSON].fill
    return Line2D(
        [], [], color=colour, linewidth=1, linestyle="--", marker="o", markersize=5, label=label
    )


def _floor_entries() -> Iterator[Line2D | Patch]:
    labels = {
        Role.ROOM: "room point",
        Role.QUEUE_SPOT: "queue spot, 1 = head",
        Role.PARKING: "parking spot",
    }
    for role, label in labels.items():
        mark, paint = MARKS[role], PAINTS[role]
        yield _dot(mark.marker, paint.fill, paint.edge, mark.size, label)
    lane = PAINTS[Role.LANE].edge
    yield Line2D([], [], color=lane, linewidth=1, alpha=0.6, label="right-hand lane")
    for role, label in ((Role.WALL, "wall"), (Role.FURNITURE, "furniture")):
        yield area_entry(role, label)
    yield Patch(facecolor=INFLATED, label="costmap: near an obstacle")
    yield Patch(facecolor=TOUCHING, label="costmap: robot would touch")


def area_entry(role: Role, label: str, *, hatch: str | None = None) -> Patch:
    """Entry of a legend for areas of a role."""
    paint = PAINTS[role]
    return Patch(facecolor=paint.fill, edgecolor=paint.edge, hatch=hatch, label=label)


def _dot(marker: str, face: str, edge: str, size: float, label: str) -> Line2D:
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
