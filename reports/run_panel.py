"""The panel beside the picture of a run: verdicts, who was concerned, the fleet, the legend."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from reports.colours import INFLATED, INK, PAINTS, SAFE, TOUCHING, UNSAFE, robot_colour
from reports.floor_plot import MARKS, write_text
from reports.floor_scene import Role
from reports.run_view import RunView, kept_column
from reports.sentences import robustness_text

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
