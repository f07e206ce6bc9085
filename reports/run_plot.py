"""What moved in a run, drawn on its floor: people, robots, waits, stops, contacts."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Phase, StackEvent
from mrta_falsify.core.trace import Trace
from mrta_falsify.specs.books import confirmed
from reports.body_plot import BodyStyle, paint_robot
from reports.colours import INK, UNSAFE, person_colour, robot_colour
from reports.floor_plot import draw_label, write_text
from reports.floor_scene import Role, Shape
from reports.run_view import RunView, kept_column

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
