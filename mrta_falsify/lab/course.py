"""The course of a failing run: who had which task, and where the run can be shortened."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mrta_falsify.core.run_result import Course, TimedPose
from mrta_falsify.core.task_history import last_robots
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.books import confirmed


def course_of(verdict: Verdict, trace: Trace, world: World) -> Course:
    """Read the course of a failing run.

    Args:
        verdict: the violated one that explains the failure.
        trace: of the run, with its columns.
        world: of the run.
    """
    had: dict[str, list[int]] = {name: [] for name in trace.robots}
    for task, robot in sorted(last_robots(trace).items()):
        had[robot].append(task)
    delivered: dict[str, list[TimedPose]] = {name: [] for name in trace.robots}
    done: dict[int, float] = {}
    for event in confirmed(trace, world).events:
        if event.kind == "dropped-off" and event.robot >= 0:
            done[event.task] = event.time
            place = _pose_at(trace, event.robot, event.time)
            delivered[trace.robots[event.robot]].append(place)
    return Course(
        found=verdict.violated_at,
        had={name: tuple(tasks) for name, tasks in had.items()},
        delivered={name: tuple(places) for name, places in delivered.items()},
        rests=tuple(_rests(trace, world, done)),
    )


def _pose_at(trace: Trace, robot: int, time: float) -> TimedPose:
    tick = min(int(np.searchsorted(trace.columns["time"], time)), len(trace) - 1)
    pose = trace.columns["pose"][tick, robot]
    return TimedPose(time=float(trace.columns["time"][tick]), pose=tuple(map(float, pose)))


def _rests(trace: Trace, world: World, done: dict[int, float]) -> Iterator[tuple[TimedPose, ...]]:
    """Yield the poses at each arrival of a task before which all earlier ones were delivered."""
    arrivals = sorted({task.arrival for task in world.tasks}, reverse=True)
    for arrival in arrivals:
        earlier = [i for i, task in enumerate(world.tasks) if task.arrival < arrival]
        if earlier and all(done.get(i, np.inf) <= arrival <= trace.duration for i in earlier):
            yield tuple(_pose_at(trace, i, arrival) for i in range(len(trace.robots)))
