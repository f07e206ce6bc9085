"""Deliveries: all of them, and in time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrta_falsify.core.fleet import Frame, StackEvent
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World

NEAR_ROOM = 2.0  # m from a room's point within which a stop can have been served
STOP_KINDS = ("picked-up", "dropped-off")


@dataclass(slots=True)
class Deliveries:
    """When each task was picked up and dropped off, as far as the robot was really there."""

    world: World
    picked: dict[int, float] = field(default_factory=dict)  #: task -> [s]
    dropped: dict[int, float] = field(default_factory=dict)  #: task -> [s]
    by: dict[int, int] = field(default_factory=dict)  #: task -> robot of its last stop
    refused: list[dict[str, Any]] = field(default_factory=list)  #: claims from elsewhere

    def update(self, frame: Frame) -> list[StackEvent]:
        """Take in one tick; gives the stops that count."""
        stops = [e for e in frame.events if e.kind in STOP_KINDS and self._holds(e, frame)]
        for event in stops:
            known = self.picked if event.kind == "picked-up" else self.dropped
            known.setdefault(event.task, event.time)
            self.by[event.task] = event.robot
        return stops

    def _holds(self, event: StackEvent, frame: Frame) -> bool:
        if not (0 <= event.task < len(self.world.tasks) and event.robot >= 0):
            return False
        task = self.world.tasks[event.task]
        room = self.world.rooms[task.start if event.kind == "picked-up" else task.end]
        away = float(np.hypot(*(frame.sensed.pose[event.robot, :2] - room.point)))
        if away > NEAR_ROOM:
            claim = {"task": event.task, "kind": event.kind, "room": room.name, "away": away}
            self.refused.append(claim)
        return away <= NEAR_ROOM


class AllTasksDone:
    """Every task is delivered before the horizon.

    Robustness is a share. If all is delivered, it is the share of the horizon that was left.
    Before the horizon it is the share still left; at the horizon, minus the share of open tasks.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._world, self._dt, self._time = world, dt, 0.0
        self._deliveries = Deliveries(world)
        self._due = {i for i, task in enumerate(world.tasks) if task.arrival <= world.horizon}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._time = frame.sensed.time
        if frame.events:
            self._deliveries.update(frame)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        horizon = self._world.horizon
        dropped = self._deliveries.dropped
        left = sorted(self._due - set(dropped))
        over = self._time >= horizon - 0.6 * self._dt
        if not left:
            last = max((time for task, time in dropped.items() if task in self._due), default=0.0)
            robustness = max(0.0, 1.0 - last / horizon)
        elif over:
            robustness = -len(left) / len(self._due)
        else:
            robustness = max(0.0, 1.0 - self._time / horizon)
        return Verdict(
            spec="all_tasks_done",
            robustness=robustness,
            violated=robustness < 0.0,
            violated_at=self._time if robustness < 0.0 else None,
            who=tuple(f"task{i}" for i in left) if robustness < 0.0 else (),
            evidence={
                "total": len(self._due),
                "delivered": len(self._due) - len(left),
                "open": left,
                "picked_up": sorted(set(left) & set(self._deliveries.picked)),
                "claims_refused": self._deliveries.refused,
            },
        )


class Deadlines:
    """Every task is delivered by its deadline.

    Robustness [s]: smallest margin; for an open task that has arrived, the time left to it.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del dt
        self._world, self._time = world, 0.0
        self._deliveries = Deliveries(world)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._time = frame.sensed.time
        if frame.events:
            self._deliveries.update(frame)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        dropped = self._deliveries.dropped
        margins = {
            i: task.deadline - dropped.get(i, self._time)
            for i, task in enumerate(self._world.tasks)
            if task.arrival <= self._time
        }
        worst = min(margins.values(), default=self._world.horizon)
        late = sorted(i for i, margin in margins.items() if margin < 0.0)
        tasks = self._world.tasks
        return Verdict(
            spec="deadlines",
            robustness=worst,
            violated=worst < 0.0,
            violated_at=min((tasks[i].deadline for i in late), default=None),
            who=tuple(f"task{i}" for i in late),
            evidence={
                "margins": {f"task{i}": margin for i, margin in margins.items()},
                "late": [
                    {
                        "task": i,
                        "deadline": tasks[i].deadline,
                        "delivered": dropped.get(i),
                        "robot": self._robot(i),
                    }
                    for i in late
                ],
            },
        )

    def _robot(self, task: int) -> str:
        robot = self._deliveries.by.get(task, -1)
        return self._world.robots[robot].name if robot >= 0 else ""
