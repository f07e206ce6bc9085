"""The specifications that every run is scored with.

All are folds over frames; robustness is in the unit named in each docstring, larger is
safer, below zero is a violation. Gaps beyond 10 m and "nothing to judge" give the cap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import Frame, StackEvent
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.motion import SAME_GOAL, Standstill, remaining_length

FAR = 10.0  # m, cap of gaps
TOUCH = -1e-3  # m, robustness of a contact whose measured gap is not negative
SETTLE = 0.5  # s without contact that end a contact episode
AT_REST = 0.05  # m/s, slower robots count as at rest
NEAR_ROOM = 2.0  # m from a room's point within which a stop can have been served
AT_GOAL = 0.6  # m, as in ``blocked_by``
LOOK_EVERY = 0.5  # s between two looks at slow things (progress, starvation)
STOP_KINDS = ("picked-up", "dropped-off")


def default_specifications() -> tuple[str, ...]:
    """Registered names of the specifications that score a run unless the user says otherwise."""
    return (
        "no_robot_robot_contact",
        "no_robot_human_contact",
        "no_robot_static_contact",
        "human_clearance",
        "all_tasks_done",
        "deadlines",
        "no_deadlock",
        "no_livelock",
        "no_starvation",
        "progress",
    )


# --- contacts --------------------------------------------------------------------------


@dataclass(slots=True)
class _MovingBeforeContact:
    """Tells robots that drive from robots that stand, also while somebody pushes them.

    During a contact with a person the state from before holds, unless the robot is commanded
    to drive and does: a robot that is shoved does not count as moving.
    """

    _velocity: Array | None = None  #: (N, 3) of the last tick
    _moving: BoolArray | None = None  #: (N,) of the last tick, None: nobody asked

    def skip(self, frame: Frame) -> None:
        """Take in a tick at which nobody needs to know."""
        self._velocity = frame.sensed.velocity
        self._moving = None

    def update(self, frame: Frame) -> BoolArray:
        """Take in a tick; which robots ``(N,)`` count as moving."""
        velocity, contact = frame.sensed.velocity, frame.sensed.contact
        before = velocity if self._velocity is None else self._velocity
        held = self._moving
        if held is None:
            held = np.sqrt(before[:, 0] ** 2 + before[:, 1] ** 2) > AT_REST
        self._velocity = velocity
        self._moving = _moving(velocity, before, frame.command.twist, contact, held)
        return self._moving


@numba.njit(cache=True)
def _moving(
    velocity: Array, before: Array, twist: Array, contact: BoolArray, held: BoolArray
) -> BoolArray:
    moving = held.copy()
    for i in range(len(velocity)):
        drives = np.hypot(velocity[i, 0], velocity[i, 1]) > AT_REST
        if contact[i, 1]:
            commanded = np.hypot(twist[i, 0], twist[i, 1]) > AT_REST
            moving[i] = held[i] or (drives and commanded)
        else:
            moving[i] = drives or np.hypot(before[i, 0], before[i, 1]) > AT_REST
    return moving


class ContactCounter:
    """Counts contact episodes: onsets after at least 0.5 s without, each pair on its own."""

    def start(self, world: World, dt: float) -> None:
        """Begin an episode with control period ``dt`` [s]."""
        self._moving = _MovingBeforeContact()
        self._last: dict[tuple[str, int, int], float] = {}
        self._totals = {
            "robot_robot": 0,
            "robot_human": 0,
            "robot_static": 0,
            "robot_human_at_rest": 0,
        }
        self._settle = max(SETTLE, 1.5 * dt)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        contact = frame.sensed.contact
        if not contact.any():
            self._moving.skip(frame)
            return
        moving = self._moving.update(frame)
        for i, kind in zip(*np.nonzero(contact), strict=True):
            robot, other = int(i), -1
            name = ("robot_robot", "robot_human", "robot_static")[kind]
            if kind == 0:
                other = int(frame.sensed.nearest_robot[i])
                robot, other = min(robot, other), max(robot, other)
            elif kind == 1:
                other = int(frame.sensed.nearest_human[i])
                name = name if moving[i] else "robot_human_at_rest"
            key = ("robot_human" if kind == 1 else name, robot, other)
            known = self._last.get(key, -np.inf)
            if frame.sensed.time - known > self._settle:
                self._totals[name] += 1
            self._last[key] = frame.sensed.time

    def totals(self) -> dict[str, int]:
        """Episodes so far: robot_robot, robot_human, robot_static, robot_human_at_rest.

        ``robot_human`` are those of a moving robot only.
        """
        return dict(self._totals)


class _NarrowestGap:
    """Narrowest gap of one kind [m] over the robots that count; negative after a contact."""

    name = ""
    limit = 0.0  #: gap that must be kept [m]
    _kind = 0  #: column of ``Sensed.contact``

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del dt
        self._world = world
        self._worst = FAR
        self._where: dict[str, Any] = {}
        self._who: tuple[str, ...] = ()
        self._violated_at: float | None = None

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        gaps = self._gaps(frame)
        if not len(gaps):
            return
        i = int(gaps.argmin())
        gap = float(gaps[i]) - self.limit
        if gap >= self._worst:
            return
        sensed = frame.sensed
        self._worst = gap
        if gap < 0.0 and self._violated_at is None:
            self._violated_at = sensed.time
        self._who = self._names(frame, i)
        speed = float(np.hypot(sensed.velocity[i, 0], sensed.velocity[i, 1]))
        self._where = {
            "gap": float(gaps[i]),
            "time": sensed.time,
            "robot": self._world.robots[i].name,
            "speed": speed,
            "x": float(sensed.pose[i, 0]),
            "y": float(sensed.pose[i, 1]),
        }

    def verdict(self) -> Verdict:
        """Verdict to date."""
        return Verdict(
            spec=self.name,
            robustness=self._worst,
            violated=self._worst < 0.0,
            violated_at=self._violated_at,
            who=self._who if self._worst < 0.0 else (),
            evidence={"nearest": self._where, "between": list(self._who), **self._more()},
        )

    def _gaps(self, frame: Frame) -> Array:
        raise NotImplementedError

    def _names(self, frame: Frame, i: int) -> tuple[str, ...]:
        return (self._world.robots[i].name,)

    def _more(self) -> dict[str, Any]:
        return {}


def _with_contacts(gap: Array, contact: BoolArray) -> Array:
    """Gaps ``(N,)`` [m] in which a contact is never positive."""
    if True not in contact.tolist():
        # an engine that reports no contact saw none: rounding must not make one
        return np.maximum(gap, 0.0)
    return np.where(contact, np.minimum(gap, TOUCH), np.maximum(gap, 0.0))


class NoRobotRobotContact(_NarrowestGap):
    """No two robots touch. Robustness: narrowest surface gap [m], negative after a contact."""

    name = "no_robot_robot_contact"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def _gaps(self, frame: Frame) -> Array:
        return _with_contacts(frame.sensed.gap_robot, frame.sensed.contact[:, 0])

    def _names(self, frame: Frame, i: int) -> tuple[str, ...]:
        robots = self._world.robots
        other = int(frame.sensed.nearest_robot[i])
        return tuple(sorted(robots[k].name for k in {i, other} if k >= 0))


class NoRobotStaticContact(_NarrowestGap):
    """No robot touches a solid. Robustness: narrowest surface gap [m], negative after a contact."""

    name = "no_robot_static_contact"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def _gaps(self, frame: Frame) -> Array:
        return _with_contacts(frame.sensed.gap_static, frame.sensed.contact[:, 2])


class _HumanGap(_NarrowestGap):
    """Narrowest gap to people over moving robots; what happens at rest is told apart."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Which robots count."""

        count_at_rest: bool = False  #: a person who walks into a robot at rest counts as well

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._moving = _MovingBeforeContact()
        self._at_rest = FAR
        self._counter = ContactCounter()
        self._counter.start(world, dt)

    def _gaps(self, frame: Frame) -> Array:
        if not len(self._world.humans):
            return np.zeros(0)
        sensed = frame.sensed
        gaps = _with_contacts(sensed.gap_human, sensed.contact[:, 1])
        self._counter.update(frame)
        if gaps.min(initial=np.inf) >= max(self._worst + self.limit, self._at_rest):
            self._moving.skip(frame)
            return np.zeros(0)  # nothing new
        moving = self._moving.update(frame)
        self._at_rest = min(self._at_rest, float(np.where(moving, np.inf, gaps).min()))
        if self._options.count_at_rest:
            return gaps
        return np.where(moving, gaps, np.inf)

    def _names(self, frame: Frame, i: int) -> tuple[str, ...]:
        human = int(frame.sensed.nearest_human[i])
        names = [self._world.robots[i].name]
        if human >= 0:
            names.append(self._world.humans[human].name)
        return tuple(names)

    def _more(self) -> dict[str, Any]:
        totals = self._counter.totals()
        return {
            "at_rest": {"narrowest": self._at_rest, "contacts": totals["robot_human_at_rest"]},
            "contacts": totals["robot_human"],
        }


class NoRobotHumanContact(_HumanGap):
    """No moving robot touches a person. Robustness: narrowest surface gap [m].

    ``evidence["nearest"]["speed"]`` is the robot's speed at the nearest pass; contacts of
    people who walk into a robot at rest are counted in ``evidence["at_rest"]``.
    """

    name = "no_robot_human_contact"


class HumanClearance(_HumanGap):
    """Moving robots keep clear of people. Robustness: narrowest surface gap minus 0.1 m [m]."""

    name = "human_clearance"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much room people get."""

        clearance: float = quantity(low=0.0, unit="m", default=0.1)  #: surface to surface
        count_at_rest: bool = False  #: as in ``no_robot_human_contact``

    def __init__(self, options: Options) -> None:
        super().__init__(_HumanGap.Options(count_at_rest=options.count_at_rest))
        self.limit = options.clearance


# --- tasks -----------------------------------------------------------------------------


@dataclass(slots=True)
class _Deliveries:
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

    Robustness, a share: if all is delivered, the share of the horizon that was left; before
    the horizon, the share still left; at the horizon, minus the share of open tasks.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._world, self._dt, self._time = world, dt, 0.0
        self._deliveries = _Deliveries(world)
        self._due = {i for i, task in enumerate(world.tasks) if task.arrival <= world.horizon}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._time = frame.sensed.time
        if frame.events:
            self._deliveries.update(frame)

    def verdict(self) -> Verdict:
        """Verdict to date."""
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
        self._deliveries = _Deliveries(world)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        self._time = frame.sensed.time
        if frame.events:
            self._deliveries.update(frame)

    def verdict(self) -> Verdict:
        """Verdict to date."""
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


# --- getting on ------------------------------------------------------------------------


@dataclass(slots=True)
class _Approach:
    """Best remaining distance of each robot to its goal, and when it last got better.

    Distances compare only along ways that lead to one goal by one next waypoint: the rest of
    the way behind that waypoint is not known, and a straight line through walls would be too
    short to be ever beaten. A new waypoint is progress; goals and waypoints that come back while
    no stop was served keep their best distance, so that alternating between them is none. A
    robot without a goal, or at its goal, has nothing to improve.
    """

    step: float  #: improvement that counts [m]
    robots: int
    since: Array = field(init=False)  #: (N,) of the last improvement [s]
    travelled: Array = field(init=False)  #: (N,) way driven since then [m]
    _best: list[list[tuple[Array, float]]] = field(init=False)  #: goal and waypoint (4,), distance
    _stops: Array = field(init=False)
    _last: Array = field(init=False)

    def __post_init__(self) -> None:
        self.since = np.zeros(self.robots)
        self.travelled = np.zeros(self.robots)
        self._best = [[] for _ in range(self.robots)]
        self._stops = np.full(self.robots, -1.0)
        self._last = np.full((self.robots, 2), np.nan)

    def update(self, frame: Frame) -> None:
        sensed, intent = frame.sensed, frame.intent
        position = sensed.pose[:, :2]
        driven = np.hypot(*(position - self._last).T)
        self.travelled += np.where(np.isfinite(driven), driven, 0.0)
        self._last = position.copy()
        away = np.hypot(*(position - intent.goal).T)
        served = (intent.tasks_left != self._stops) | np.isnan(away)
        self._stops = np.array(intent.tasks_left, dtype=np.float64)
        for i in range(self.robots):
            if served[i]:
                self._best[i] = []
            if served[i] or away[i] <= AT_GOAL:
                self._restart(i, sensed.time)
                continue
            path = intent.path[i]
            if not len(path):
                continue
            x, y = position[i]
            way = np.concatenate([intent.goal[i], path[-1]])
            if self._improves(i, way, remaining_length(path, x, y)):
                self._restart(i, sensed.time)

    def _restart(self, i: int, time: float) -> None:
        self.since[i] = time
        self.travelled[i] = 0.0

    def _improves(self, i: int, way: Array, distance: float) -> bool:
        known = self._best[i]
        for k, (seen, best) in enumerate(known):
            if np.abs(seen - way).sum() <= SAME_GOAL:
                if distance > best - self.step:
                    return False
                known[k] = (seen, distance)
                return True
        known.append((way, distance))
        return True


class NoLivelock:
    """No robot keeps driving without getting nearer to its goal.

    Robustness [s]: patience minus the longest time in which a robot drove at least
    ``min_travel`` without net progress; driving less counts as safer by 1 s per 5 cm.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What counts as driving in vain."""

        patience: float = quantity(above=0.0, unit="s", default=60.0)
        min_travel: float = quantity(above=0.0, unit="m", default=5.0)  #: driven in that time
        step: float = quantity(above=0.0, unit="m", default=0.5)  #: nearer by this: progress

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LOOK_EVERY / dt))
        self._approach = _Approach(self._options.step, len(world.robots))
        self._worst = self._options.patience
        self._who: tuple[str, ...] = ()
        self._violated_at: float | None = None
        self._evidence: dict[str, Any] = {}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        if sensed.tick % self._stride:
            return
        self._approach.update(frame)
        options, approach = self._options, self._approach
        margin = np.maximum(
            options.patience - (sensed.time - approach.since),
            (options.min_travel - approach.travelled) / 0.05,
        )
        if not len(margin):
            return
        i = int(margin.argmin())
        if margin[i] >= self._worst:
            return
        self._worst = float(margin[i])
        self._evidence = {
            "robot": self._names[i],
            "since": float(approach.since[i]),
            "travelled": float(approach.travelled[i]),
            "time": sensed.time,
            "x": float(sensed.pose[i, 0]),
            "y": float(sensed.pose[i, 1]),
        }
        if self._worst < 0.0:
            if self._violated_at is None:
                self._violated_at = sensed.time
            self._who = tuple(self._names[k] for k in np.flatnonzero(margin < 0.0))

    def verdict(self) -> Verdict:
        """Verdict to date."""
        return Verdict(
            spec="no_livelock",
            robustness=self._worst,
            violated=self._worst < 0.0,
            violated_at=self._violated_at,
            who=self._who,
            evidence=self._evidence,
        )


class Progress:
    """Every robot with a goal gets nearer to it by ``step`` within each ``window``.

    Robots at their goal (served, or waiting at their spot) are exempt: queues are judged by
    ``no_starvation`` and ``no_deadlock``. Robustness [s]: window minus the longest time
    without such progress.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much progress in how much time."""

        window: float = quantity(above=0.0, unit="s", default=90.0)
        step: float = quantity(above=0.0, unit="m", default=0.3)

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LOOK_EVERY / dt))
        self._approach = _Approach(self._options.step, len(world.robots))
        self._worst = self._options.window
        self._who: tuple[str, ...] = ()
        self._violated_at: float | None = None
        self._evidence: dict[str, Any] = {}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        if sensed.tick % self._stride:
            return
        self._approach.update(frame)
        margin = self._options.window - (sensed.time - self._approach.since)
        if not len(margin):
            return
        i = int(margin.argmin())
        if margin[i] >= self._worst:
            return
        self._worst = float(margin[i])
        self._evidence = {
            "robot": self._names[i],
            "since": float(self._approach.since[i]),
            "time": sensed.time,
            "causes": [e.cause for e in frame.blocked_by if e.robot == i],
        }
        if self._worst < 0.0:
            if self._violated_at is None:
                self._violated_at = sensed.time
            self._who = tuple(self._names[k] for k in np.flatnonzero(margin < 0.0))

    def verdict(self) -> Verdict:
        """Verdict to date."""
        return Verdict(
            spec="progress",
            robustness=self._worst,
            violated=self._worst < 0.0,
            violated_at=self._violated_at,
            who=self._who,
            evidence=self._evidence,
        )


class NoStarvation:
    """Nobody waits for ever while others are served.

    A robot with a goal that has not left its place for ``robot_patience`` while another one
    served a stop, or a task not picked up for ``task_patience`` although one that arrived
    later was, starves. Robustness [s]: the smaller margin of the two, scaled to
    ``robot_patience``.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How long is too long."""

        robot_patience: float = quantity(above=0.0, unit="s", default=120.0)
        task_patience: float = quantity(above=0.0, unit="s", default=600.0)
        radius: float = quantity(above=0.0, unit="m", default=0.5)  #: of "its place"

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        robots = len(world.robots)
        self._world = world
        self._names = tuple(robot.name for robot in world.robots)
        self._stride = max(1, round(LOOK_EVERY / dt))
        self._still = Standstill(robots, radius=self._options.radius)
        self._waiting_since = np.zeros(robots)
        self._last_stop = np.full(robots, -np.inf)  # of each robot itself [s]
        self._deliveries = _Deliveries(world)
        self._worst = self._options.robot_patience
        self._who: tuple[str, ...] = ()
        self._violated_at: float | None = None
        self._evidence: dict[str, Any] = {}

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        if frame.events:
            for stop in self._deliveries.update(frame):
                self._last_stop[stop.robot] = sensed.time
        if sensed.tick % self._stride or not len(self._names):
            return
        since = self._still.update(sensed.pose, sensed.time)
        no_goal = ~np.isfinite(frame.intent.goal[:, 0])
        self._waiting_since[no_goal] = sensed.time
        self._waiting_since = np.maximum(self._waiting_since, since)
        self._waiting_since = np.maximum(self._waiting_since, self._last_stop)
        self._judge_robots(sensed.time)
        if self._world.tasks:
            self._judge_tasks(sensed.time)

    def _judge_robots(self, time: float) -> None:
        i = int(self._waiting_since.argmin())
        since = float(self._waiting_since[i])
        others = np.delete(self._last_stop, i)
        if len(others) and others.max() > since:
            margin = self._options.robot_patience - (time - since)
            self._note(margin, self._names[i], since, time)

    def _judge_tasks(self, time: float) -> None:
        tasks, picked = self._world.tasks, self._deliveries.picked
        if not picked:
            return
        last_served = max(tasks[i].arrival for i in picked)
        scale = self._options.robot_patience / self._options.task_patience
        for i, task in enumerate(tasks):
            if i not in picked and task.arrival < last_served:
                margin = (self._options.task_patience - (time - task.arrival)) * scale
                self._note(margin, f"task{i}", task.arrival, time)

    def _note(self, margin: float, name: str, since: float, time: float) -> None:
        if margin >= self._worst:
            return
        self._worst = margin
        if margin < 0.0:
            if self._violated_at is None:
                self._violated_at = time
            if name not in self._who:
                self._who = (*self._who, name)
        self._evidence = {"who": name, "waiting_since": since, "time": time}

    def verdict(self) -> Verdict:
        """Verdict to date."""
        return Verdict(
            spec="no_starvation",
            robustness=self._worst,
            violated=self._worst < 0.0,
            violated_at=self._violated_at,
            who=self._who,
            evidence=self._evidence,
        )


# --- by name ---------------------------------------------------------------------------


def specification_choice(text: str) -> Choice:
    """What ``--spec TEXT`` means: a registered name, ``module:Class`` or ``stl:FORMULA``."""
    if text.startswith("stl:"):
        return Choice("stl", {"formula": text.removeprefix("stl:").strip()})
    return Choice(text)


def build_specifications(
    names: Sequence[str] = (), *, where: str = "--spec"
) -> tuple[Specification, ...]:
    """Specifications by name, the default ones if there are none.

    Raises:
        InputError: unknown name, or a formula that cannot be read.
    """
    chosen = names or default_specifications()
    return tuple(
        registry.build("specification", specification_choice(name), where=where) for name in chosen
    )
