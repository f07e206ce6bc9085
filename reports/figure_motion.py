"""What moved in a run, drawn on its floor: people, robots, waits, stops, contacts."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import ArrayLike

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.trace import Trace
from reports.colours import HUMAN, HUMAN_BLIND, INK, UNSAFE, robot_colour
from reports.figure_floor import draw_label, write_text
from reports.run_view import RunView


def _column(trace: Trace, name: str) -> np.ndarray | None:
    column = trace.columns.get(name)
    return column if column is not None and len(column) else None


def draw_humans(axes: Axes, view: RunView) -> None:
    """Where people went, and where they are at the end."""
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
        write_text(
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


def draw_robots(axes: Axes, view: RunView) -> None:
    """Where robots went, stood and waited, and where they are at the end."""
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
        draw_label(
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
                draw_label(
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


def draw_contacts(axes: Axes, trace: Trace) -> None:
    """Where robots touched something."""
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
