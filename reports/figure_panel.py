"""The panel beside the picture of a run: verdicts, who was to blame, the fleet, the legend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.verdict import Verdict
from reports.colours import (
    FURNITURE,
    FURNITURE_EDGE,
    HUMAN,
    HUMAN_BLIND,
    INK,
    ROOM,
    SAFE,
    UNSAFE,
    WALL,
    robot_colour,
)
from reports.figure_floor import write_text
from reports.figure_motion import _column
from reports.run_view import RunView


def draw_panel(axes: Axes, view: RunView, height: float) -> None:
    """Text column; ``height`` [in] sets the line pitch so that text never overlaps."""
    axes.axis("off")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-height, 0.0)
    y = -0.25
    write_text(axes, 0.0, y, view.world.name, size=17, weight="bold", color=INK, va="center")
    y -= 0.42
    for label, text in view.facts:
        write_text(axes, 0.0, y, label, size=9.5, color="#666666", va="center")
        write_text(axes, 0.36, y, text, size=9.5, color=INK, va="center")
        y -= 0.235
    y = _draw_verdicts(axes, view.verdicts, y - 0.22)
    y = _draw_fleet(axes, view, y - 0.22)
    _draw_legend(axes, view, y - 0.1, height)


def _heading(axes: Axes, y: float, text: str) -> float:
    write_text(axes, 0.0, y, text, size=11.5, weight="bold", color=INK, va="center")
    return y - 0.29


def _draw_verdicts(axes: Axes, verdicts: Sequence[Verdict], y: float) -> float:
    if not verdicts:
        return y
    y = _heading(axes, y, "Verdicts")
    for verdict in verdicts:
        colour = UNSAFE if verdict.violated else SAFE
        mark = "violated" if verdict.violated else "holds"
        write_text(axes, 0.0, y, verdict.spec, size=9.5, color=INK, va="center")
        write_text(axes, 0.60, y, mark, size=9.5, color=colour, weight="bold", va="center")
        write_text(
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
    write_text(axes, 0.04, y, text, size=8.5, color=UNSAFE, va="center")
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
        write_text(axes, 0.07, y, robot.name, size=9.5, color=INK, va="center")
        if phase is not None and left is not None and poses is not None:
            state = Phase(int(phase[-1, number])).name.lower().replace("_", " ")
            stops = int(left[-1, number])
            rest = f"{state}, {stops} stop{'s' * (stops != 1)} left" if stops else state
            length = np.linalg.norm(np.diff(poses[:, number, :2], axis=0), axis=1).sum()
            write_text(axes, 0.33, y, rest, size=9.5, color=INK, va="center")
            write_text(
                axes, 1.0, y, f"{length:.0f} m", size=9.5, color=INK, va="center", ha="right"
            )
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
