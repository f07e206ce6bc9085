"""A trace for the replay of a page: quantised, deflated, base64.

Positions are kept to 1 cm, headings to 2 pi / 256, planned paths to 3 cm, at a few frames per
second (fewer in the early parts of long runs); differences between frames compress well. 150 s
of seven robots on the floor of a hospital take about 35 kB.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.candidate import DimensionValue
from mrta_falsify.core.fleet import Phase
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.words import number_text
from mrta_falsify.core.world import World
from reports.colours import robot_colour
from reports.contents import TrialTable
from reports.floor_scene import Role, Shape, extent_of, fixed_outlines, floor_scene, furniture_poses

FRAME_RATE = 5.0  # Hz kept for the replay
FULL_WINDOW = 120.0  # s before the end that are kept at this rate however long the run is
BEFORE, AFTER = 40.0, 10.0  # s around a violation that are kept at this rate, too
OTHER_FRAMES = 1500  # frames at most of the rest
PATH_DETAIL = 0.03  # m that a planned path may be off
RAY_RATE = 1.0  # Hz kept of obstacle points
RAY_WINDOW = 40.0  # s before the end in which obstacle points are kept
CM = 100.0
NOWHERE = -32768  # for absent people


def pack(
    world: World, trace: Trace, verdicts: Sequence[Verdict], *, concerned: Sequence[str] = ()
) -> str:
    """Pack a replay as deflated base64: JSON text, a line feed, then little-endian arrays.

    The JSON names each array with its type and shape, in order.

    Args:
        world: of the run.
        trace: of the run.
        verdicts: on it; frames around violations are kept.
        concerned: things that took part, which the replay names from afar, too.
    """
    moments = [v.violated_at for v in verdicts if v.violated and v.violated_at is not None]
    ticks = kept_ticks(len(trace), trace.dt, moments)
    arrays = _arrays(world, trace, ticks)
    header = {
        "arrays": [[name, array.dtype.str[1:], list(array.shape)] for name, array in arrays],
        "time": [round(float(t), 2) for t in trace.columns["time"][ticks]],
        "world": _world(world),
        "concerned": list(concerned),
        "phases": [phase.name.lower().replace("_", " ") for phase in Phase],
        "paths": _paths(trace),
        **_happenings(trace, verdicts),
    }
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    body = b"".join(array.tobytes() for _, array in arrays)
    return base64.b64encode(zlib.compress(text + b"\n" + body, 9)).decode()


def pack_trials(table: TrialTable) -> str:
    """Pack the table of all trials as deflated base64: JSON of column names and rows."""
    fixed = ("trial", "outcome", "mode", "found [s]", "score", "simulated [s]")
    rows = [
        [row.id, row.outcome, row.mode or None, _short(row.found), _short(row.score),
         round(row.simulated, 1), *map(_short, row.values)]
        for row in table.rows
    ]  # fmt: skip
    data = {"columns": [*fixed, *table.parameters], "rows": rows}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).encode()
    return base64.b64encode(zlib.compress(text, 9)).decode()


def _short(value: DimensionValue) -> DimensionValue:
    """Keep of a number what can be told apart, and words as they are; None where it is none."""
    if isinstance(value, (str, bool)):
        return str(value)
    return float(number_text(value)) if value is not None and math.isfinite(value) else None


def _happenings(trace: Trace, verdicts: Sequence[Verdict]) -> dict[str, list[list[Any]]]:
    """List who blocked whom, what the stack reported and what was violated, with times [s]."""
    return {
        "edges": [
            [round(span.first * trace.dt, 2), round((span.last + 1) * trace.dt, 2),
             span.edge.robot, span.edge.cause, span.edge.other, span.edge.resource]
            for span in trace.edges
            if span.edge.cause != "task"
        ],
        "events": [
            [round(event.time, 2), event.kind, event.robot, event.task, event.resource,
             event.other, event.detail]
            for event in trace.events
        ],
        "violations": [
            [round(v.violated_at, 2), v.spec, list(v.who)]
            for v in verdicts
            if v.violated and v.violated_at is not None
        ],
    }  # fmt: skip


def kept_ticks(count: int, dt: float, moments: Sequence[float] = ()) -> np.ndarray:
    """Choose the ticks of a run that its replay keeps, first and last among them.

    Args:
        count: ticks of the run.
        dt: time between two [s].
        moments: of violations [s].
    """
    stride = max(1, round(1.0 / (FRAME_RATE * dt)))
    sparse = max(stride, -(-max(0, count - round(FULL_WINDOW / dt)) // OTHER_FRAMES))
    spans = [(count * dt - FULL_WINDOW, count * dt), *((m - BEFORE, m + AFTER) for m in moments)]
    chosen = [np.arange(0, count, sparse), np.arange(max(0, count - 1), count)]
    for first, last in spans:
        begin = max(0, round(first / dt)) // stride * stride
        chosen.append(np.arange(begin, min(count, round(last / dt)), stride))
    return np.unique(np.concatenate(chosen))


def _arrays(world: World, trace: Trace, ticks: np.ndarray) -> list[tuple[str, np.ndarray]]:
    columns = trace.columns
    pieces = furniture_poses(world, trace)[ticks]
    pose = columns["pose"][ticks]
    people = columns["human_position"][ticks]
    packed = [
        ("xy", _steps(_centimetres(pose[:, :, :2]))),
        ("yaw", _turns(pose[:, :, 2])),
        ("people", _steps(_centimetres(people))),
        ("phase", columns["phase"][ticks].astype("<u1")),
        ("cluster", columns["cluster"][ticks].astype("<i1")),
        ("leader", columns["leader"][ticks].astype("<i1")),
        ("goal", _steps(_centimetres(columns["goal"][ticks]))),
        ("pieces", _steps(_centimetres(pieces[:, :, :2]))),
        ("pieces_turn", _turns(pieces[:, :, 2])),
    ]
    rays, when = _rays(trace)
    return [*packed, ("rays", rays), ("rays_time", when)]


def _turns(angles: Array) -> np.ndarray:
    """Angles [rad] in steps of 2 pi / 256."""
    return (np.round(angles / (2.0 * np.pi) * 256.0) % 256.0).astype("<u1")


def _centimetres(points: Array) -> np.ndarray:
    known = np.isfinite(points) & (np.abs(points) < 300.0)
    return np.where(known, np.round(np.where(known, points, 0.0) * CM), NOWHERE).astype("<i2")


def _steps(values: np.ndarray) -> np.ndarray:
    """Differences along time, wrapping like the 16-bit numbers they are."""
    steps = values.copy()
    steps[1:] = values[1:] - values[:-1]
    return steps


def _rays(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    points = trace.columns["obstacle_points"]
    stride = max(1, round(1.0 / (RAY_RATE * trace.dt)))
    first = max(0, len(trace) - round(RAY_WINDOW / trace.dt))
    ticks = np.arange(first, len(trace), stride)
    times = np.round(trace.columns["time"][ticks] * 10.0).astype("<i4")
    return _centimetres(points[ticks]), times


def _paths(trace: Trace) -> list[list[Any]]:
    return [
        [round(change.tick * trace.dt, 2), change.robot, _points(change.points)]
        for change in trace.paths
    ]


def _points(points: Array) -> list[int]:
    """Centimetres, flat; without points that change the line by less than ``PATH_DETAIL``."""
    if len(points) > 2:
        points = shapely.get_coordinates(shapely.LineString(points).simplify(PATH_DETAIL))
    return _points_all(points)


def _world(world: World) -> dict[str, Any]:
    scene = floor_scene(world, fixed_outlines(world))
    return {
        "extent": [round(value, 2) for value in extent_of(world)],
        "scene": [_shape(shape) for shape in scene],
        "things": [  # that stand still: name, middle
            [item.name, *_points_all(item.center)] for item in world.furniture if not item.movable
        ],
        "pieces": [  # movable; outlines around their centres
            [item.name, item.kind, _points_all(item.polygon - item.center)]
            for item in world.movable_furniture()
        ],
        "robots": [
            [robot.name, robot_colour(i), robot.radius] for i, robot in enumerate(world.robots)
        ],
        "people": [
            [human.name, human.radius, Role.PERSON if human.reacts_to_robots else Role.BLIND_PERSON]
            for human in world.humans
        ],
    }


def _shape(shape: Shape) -> list[Any]:
    """Role, points [cm], then text and times [s] where a shape has them."""
    row: list[Any] = [shape.role, _points_all(shape.points), shape.text]
    if shape.role is Role.BLOCKAGE:
        row += [shape.start, shape.end]
    while row[-1] == "":
        row.pop()
    return row


def _points_all(points: Array) -> list[int]:
    return [int(value) for value in np.round(np.asarray(points) * CM).ravel()]
