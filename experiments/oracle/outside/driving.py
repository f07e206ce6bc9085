"""What the stacks outside of the benchmark share: stops in turn, driving, and why a robot stands.

A robot drives to the stops of its tasks along paths of the harness's planner and stops for what is
in front of it. A robot without a task stands where it is. A subclass holds robots up in its way.

With ``MRTA_ORACLE_STATE`` set to the name of a file, a line of JSON is appended to it whenever a
robot begins to stand for another reason. The labels take members from it. The judged stack never
gets that variable, so nothing of it reaches the harness.
"""

from __future__ import annotations

import json
import math
import os
from typing import Any, NamedTuple

import numpy as np

SPEED = 0.5  # m/s
ARRIVED = 0.2  # m; as far as labels take a robot to be served
AHEAD = 0.4  # m; how far along its path a robot aims
STOP_AHEAD, STOP_ASIDE = 0.9, 0.5  # m; a robot stops for another one that is nearer
PERSON_AHEAD, PERSON_ASIDE = 0.9, 0.55  # m; the same for a person
STALLED_AFTER, STALLED = 2.0, 0.02  # s, m; a robot that comes no farther stands at something
STEP = 0.1  # m between points of a path
REPLAN_AFTER = 2.0  # s of standing, after which a path is planned anew
DRIVING, SERVING, IDLE = 2, 5, 1  # phases of the protocol


class Reason(NamedTuple):
    """Why a robot stands."""

    why: str  #: lock, robot, person, solid, no_path, partner, timer
    robots: tuple[int, ...] = ()  #: for whom it waits


class Stop(NamedTuple):
    """A place where a robot is served."""

    point: Any  #: (2,) [m]
    claim: str  #: event once it is served
    service: float  #: [s]
    task: int


class Drivers:
    """All robots; `may_go` says which of them are held up by the stack itself.

    Args:
        world: message of the harness.
        harness: answers questions.
    """

    def __init__(self, world: dict[str, Any], harness: Any) -> None:
        self.harness = harness
        self.params = world["params"]
        self.rooms = [np.array(room["point"]) for room in world["rooms"]]
        self.names = [robot["name"] for robot in world["robots"]]
        n = len(self.names)
        self.count = n
        self.stops: list[list[Stop]] = [[] for _ in range(n)]
        self.path: list[Any] = [None] * n
        self.place = [0] * n  #: of each robot on its path; it only grows
        self.driven = np.zeros(n)  #: m on the way to the next stop
        self.since: list[float | None] = [None] * n  #: arrival at the stop
        self.stands_since: list[float | None] = [None] * n
        self.planned_at = np.full(n, -math.inf)
        self.anchor = [np.full(3, math.inf)] * n  #: pose since it last moved
        self.moved_at = [0.0] * n
        self.reached = [0] * n  #: stops served
        self.reasons: list[Reason | None] = [None] * n  #: in this tick
        self.reasons_before = [*self.reasons]  #: in the tick before
        self.stood_for: list[Reason | None] = [None] * n  #: when each stood last
        self.last = np.array([robot["pose"] for robot in world["robots"]])
        self.time = 0.0
        self.events: list[dict[str, Any]] = []
        self.shows_phases = bool(self.params.get("shows_phases", 1))
        self.shows_waits = bool(self.params.get("shows_waits", 0))
        self._notes = _StateFile()

    # --- what a subclass decides ---------------------------------------------------------------

    def may_go(self, i: int, pose: Any) -> Reason | None:
        """Hold a robot that has a path, or let it go (None)."""
        return None

    def arrived(self, i: int) -> None:
        """Take note that a robot has been served."""

    # --- a tick --------------------------------------------------------------------------------

    def step(self, tick: dict[str, Any]) -> dict[str, Any]:
        """Answer a tick."""
        pose, n = np.array(tick["pose"]), self.count
        self.driven += np.hypot(*(pose[:, :2] - self.last[:, :2]).T)
        self.last, self.time, self.events = pose, tick["time"], []
        self._take(tick["tasks"])
        twist, goal = np.zeros((n, 3)), np.full((n, 2), np.nan)
        phase, paths, left = [IDLE] * n, [], [0] * n
        self.reasons_before = [*self.reasons]
        for i in range(n):
            self.reasons[i] = None
            if not self.stops[i]:
                continue
            stop = self.stops[i][0]
            goal[i], left[i], phase[i] = stop.point, len(self.stops[i]), DRIVING
            if math.dist(pose[i, :2], stop.point) <= ARRIVED:
                phase[i] = SERVING
                self._serve(i, stop)
                continue
            self.since[i] = None
            if self._plans(i, pose, stop):
                paths.append([i, self.path[i]])
            twist[i] = self._move(i, pose, tick)
        self._notes.note(self.time, self.reasons)
        answer = {"twist": twist, "goal": goal, "stops_left": left, "paths": paths}
        answer["events"] = self.events
        if self.shows_phases:
            answer["phase"] = phase
        if self.shows_waits:
            answer["waits_for"] = [
                [i, self.names[reason.robots[0]]]
                for i, reason in enumerate(self.reasons)
                if reason and reason.robots
            ]
        return answer

    def _take(self, tasks: list[dict[str, Any]]) -> None:
        for task in tasks:
            named = [self.names.index(task["robot"])] if task["robot"] else range(self.count)
            i = min(named, key=lambda k: (len(self.stops[k]), k))
            self.stops[i] += [
                Stop(self.rooms[task["start"]], "picked-up", task["pickup_time"], task["task"]),
                Stop(self.rooms[task["end"]], "dropped-off", task["dropoff_time"], task["task"]),
            ]

    def _serve(self, i: int, stop: Stop) -> None:
        if self.since[i] is None:
            self.since[i] = self.time
        elif self.time - self.since[i] > stop.service + 1.0:
            self.events.append({"kind": stop.claim, "robot": i, "task": stop.task})
            self.stops[i].pop(0)
            self.path[i], self.since[i], self.driven[i] = None, None, 0.0
            self.reached[i] += 1
            self.arrived(i)

    def _plans(self, i: int, pose: Any, stop: Stop) -> bool:
        stands = self.stands_since[i]
        is_late = stands is not None and self.time - stands > REPLAN_AFTER
        if self.path[i] is not None and not (
            is_late and self._may_replan(i) and self.time - self.planned_at[i] > REPLAN_AFTER
        ):
            return False
        self.path[i] = dense(np.array(self.harness.plan(pose[i, :2], self.aim(i, stop))))
        self.place[i], self.planned_at[i] = 0, self.time
        return True

    def aim(self, i: int, stop: Stop) -> Any:
        """Point ``(2,)`` [m] to which a robot's path leads."""
        return stop.point

    def _may_replan(self, i: int) -> bool:
        """Only what stands in the way makes another path worth while."""
        reason = self.stood_for[i]
        return reason is not None and reason.why in ("solid", "person", "no_path")

    def _move(self, i: int, pose: Any, tick: dict[str, Any]) -> tuple[float, float, float]:
        path = self.path[i]
        if not len(path):
            return self._stand(i, Reason("no_path"))
        self._go_along(i, pose)
        held = self.may_go(i, pose)
        if held is not None:
            return self._stand(i, held)
        path, (x, y, yaw) = self.path[i], pose[i]
        if path is None or not len(path):
            return self._stand(i, Reason("no_path"))
        k = self.place[i]
        while k < len(path) - 1 and math.dist(path[k], (x, y)) < AHEAD:
            k += 1
        course = math.atan2(path[k][1] - y, path[k][0] - x)
        error = math.remainder(course - yaw, math.tau)
        reason = self._in_front(i, pose, tick, course)
        if reason is not None:
            self._stand(i, reason)
            return (0.0, 0.0, float(np.clip(2.0 * error, -1.5, 1.5)))
        if self._is_stalled(i, pose[i]):
            self._stand(i, Reason("solid"))
        else:
            self.stands_since[i] = None
        away = math.dist(path[-1], (x, y))
        speed = 0.0 if abs(error) > 0.4 else min(SPEED, 1.5 * away + 0.05)
        return (speed, 0.0, float(np.clip(2.0 * error, -1.5, 1.5)))

    def _stand(self, i: int, reason: Reason) -> tuple[float, float, float]:
        self.reasons[i] = self.stood_for[i] = reason
        if self.stands_since[i] is None:
            self.stands_since[i] = self.time
        return (0.0, 0.0, 0.0)

    def _is_stalled(self, i: int, pose: Any) -> bool:
        """Whether a robot that drives comes no farther."""
        before, now = self.anchor[i], self.time
        was_driving = self.reasons_before[i] is None or self.reasons_before[i].why == "solid"
        if np.abs(pose - before).max() > STALLED or not was_driving:
            self.anchor[i], self.moved_at[i] = pose.copy(), now
        return now - self.moved_at[i] > STALLED_AFTER

    def _go_along(self, i: int, pose: Any) -> None:
        path, k = self.path[i], self.place[i]
        away = np.hypot(*(path - pose[i, :2]).T)
        while k < len(path) - 1 and away[k + 1] <= away[k] and away[k] < 1.0:
            k += 1
        self.place[i] = k

    def _in_front(self, i: int, pose: Any, tick: dict[str, Any], course: float) -> Reason | None:
        others = [j for j in range(self.count) if j != i]
        near = _ahead(pose[i], course, pose[others, :2], STOP_AHEAD, STOP_ASIDE)
        if near.any():
            return Reason("robot", tuple(others[k] for k in np.flatnonzero(near)))
        people = np.array(tick["human_position"]).reshape(-1, 2)
        if _ahead(pose[i], course, people, PERSON_AHEAD, PERSON_ASIDE).any():
            return Reason("person")
        return None


def _ahead(pose: Any, course: float, points: Any, ahead: float, aside: float) -> Any:
    """Which points lie before a robot that drives on a course."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    with np.errstate(invalid="ignore"):
        away = points - pose[:2]
        forward = away @ np.array([math.cos(course), math.sin(course)])
        sideways = np.abs(away @ np.array([-math.sin(course), math.cos(course)]))
        return (forward > 0.0) & (forward < ahead) & (sideways < aside)


def dense(path: Any) -> Any:
    """Put a point on a path at least every 0.1 m."""
    if len(path) < 2:
        return path
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.arange(0.0, along[-1], STEP)
    points = np.stack([np.interp(at, along, path[:, 0]), np.interp(at, along, path[:, 1])], axis=1)
    return np.concatenate([points, path[-1:]])


class _StateFile:
    """Notes why robots stand; only in the process that the harness has started, not in a fork."""

    def __init__(self) -> None:
        self._name = os.environ.get("MRTA_ORACLE_STATE", "")
        self._process = os.getpid()
        self._last: dict[str, Any] | None = None

    def note(self, time: float, reasons: list[Reason | None]) -> None:
        if not self._name or os.getpid() != self._process:
            return
        now = {str(i): [r.why, *r.robots] for i, r in enumerate(reasons) if r is not None}
        if now != self._last:
            self._last = now
            with open(self._name, "a", encoding="ascii") as file:
                file.write(json.dumps({"time": time, "stand": now}) + "\n")
