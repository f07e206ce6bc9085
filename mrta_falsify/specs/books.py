"""The harness's own books: what was picked up and delivered, whatever the stack says.

A pick-up or delivery counts when the stack claims it and motion confirms it. The robot stood
within the room's reach for the whole service time, it had picked up what it delivers, and it
never carried more than it can. Claims that motion contradicts are refused, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.fleet import Refusal, Sensed, StackEvent
from mrta_falsify.core.free_space import around
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.world import Task, World
from mrta_falsify.specs.halts import STOPPED, Halts

#: m from a room's point within which a stop can be served. Twice what a robot needs whose goal is
#: covered: it stops within 0.15 m of a point up to 0.3 m away, and localises within centimetres.
ROOM_REACH = 1.0
AT_POINT = 0.3  # m; a wall this near to a room's point may cover it, and robots stop beside it
ROUNDING = 1e-6  # s that float arithmetic may add to a time, or take off
STOP_KINDS = ("picked-up", "dropped-off")
MAX_REFUSALS = 100  # rows in the evidence of one verdict


@dataclass(slots=True)
class Refusals:
    """Refused claims of one episode; what is repeated for the same reason is kept once."""

    world: World
    rows: list[Refusal] = field(default_factory=list)
    _said: set[tuple[str, int, int, str, str]] = field(default_factory=set)

    def add(self, event: StackEvent, time: float, reason: str) -> None:
        """Note that ``event`` was claimed at ``time`` [s], and why it does not hold."""
        said = (event.kind, event.robot, event.task, event.resource, reason.partition(":")[0])
        if said in self._said:
            return
        self._said.add(said)
        tasks, room = self.world.tasks, event.resource
        if event.kind in STOP_KINDS and 0 <= event.task < len(tasks):
            room = self.world.rooms[_room_of(tasks[event.task], event.kind)].name
        known = 0 <= event.robot < len(self.world.robots)
        row = Refusal(
            time=time,
            kind=event.kind,
            task=event.task,
            robot=self.world.robots[event.robot].name if known else "",
            room=room,
            reason=reason,
        )
        self.rows.append(row)


def encoded(rows: Sequence[Refusal]) -> list[dict[str, Any]]:
    """Give the first refused claims, JSON-shaped."""
    return [asdict(row) for row in rows[:MAX_REFUSALS]]


def unknown_in(event: StackEvent, world: World, *, must_name: bool) -> str:
    """Say which robot or task of a claim does not exist, empty: all do.

    Args:
        event: the claim.
        world: of the run.
        must_name: whether the claim must name both.
    """
    least = 0 if must_name else -1
    if not least <= event.robot < len(world.robots):
        return f"there is no robot number {event.robot}"
    if not least <= event.task < len(world.tasks):
        return f"there is no task number {event.task}"
    return ""


@dataclass(slots=True)
class Ledger:
    """What each robot picked up and delivered in one episode, of the stops that are confirmed."""

    world: World
    picked: dict[int, float] = field(default_factory=dict)  #: task -> [s]
    delivered: dict[int, float] = field(default_factory=dict)  #: task -> [s]
    by: dict[int, int] = field(default_factory=dict)  #: task -> robot that picked it up
    due: frozenset[int] = field(init=False)  #: tasks that are to be delivered

    def __post_init__(self) -> None:
        tasks, horizon = self.world.tasks, self.world.horizon
        self.due = frozenset(i for i, task in enumerate(tasks) if task.arrival <= horizon)

    def enter(self, stops: Iterable[StackEvent], time: float) -> None:
        """Enter confirmed stops of the tick at ``time`` [s]."""
        for stop in stops:
            if stop.kind == "picked-up":
                self.picked[stop.task] = time
                self.by[stop.task] = stop.robot
            else:
                self.delivered[stop.task] = time

    @property
    def open(self) -> tuple[int, ...]:
        """Tasks that are to be delivered and are not, sorted."""
        return tuple(sorted(self.due - self.delivered.keys()))

    @property
    def closed(self) -> bool:
        """Whether everything that can still arrive has been delivered."""
        return self.due <= self.delivered.keys()

    def margins(self, time: float) -> dict[int, float]:
        """Tell how long before its deadline each task was delivered [s]; below 0: it is late.

        Of a task that has arrived and is open at ``time`` [s]: how much time is left.
        """
        return {
            i: task.deadline - self.delivered.get(i, time)
            for i, task in enumerate(self.world.tasks)
            if task.arrival <= time
        }

    def aboard(self, robot: int) -> tuple[int, ...]:
        """List the tasks that ``robot`` carries, sorted."""
        held = self.picked.keys() - self.delivered.keys()
        return tuple(sorted(task for task in held if self.by[task] == robot))


class Entries(NamedTuple):
    """What became of the stops that were claimed in one tick."""

    confirmed: tuple[StackEvent, ...]
    refused: tuple[Refusal, ...]  #: what was refused before for the same reason is left out


@dataclass(slots=True)
class Books(Ledger):
    """Says which stops count, and keeps the ledger of them; update it once a tick."""

    given: dict[int, int] = field(default_factory=dict)  #: task -> robot, as the stack assigns
    refused: Refusals = field(init=False)
    _halts: Halts = field(init=False)
    _served_until: list[float] = field(init=False)  #: by robot: end of its last service [s]
    _walls: tuple[Polygon, ...] | None = None

    def __post_init__(self) -> None:
        Ledger.__post_init__(self)
        self.refused = Refusals(self.world)
        self._halts = Halts(len(self.world.robots))
        self._served_until = [robot.joins_at for robot in self.world.robots]

    def robots_finished(self) -> int:
        """Count the robots without work: nothing aboard, and no open task is theirs.

        An open task that no robot was given is left to all of them.
        """
        owners = {self.by.get(task, self.given.get(task, -1)) for task in self.open}
        if -1 in owners:
            return 0
        return len(self.world.robots) - len(owners)

    # --- time passes --------------------------------------------------------------------------

    def update(self, sensed: Sensed, events: Sequence[StackEvent]) -> Entries:
        """Take in one tick; gives what became of the stops that are claimed."""
        speeds = sensed.velocity[:, :2]
        return self.take(sensed.time, sensed.pose, speeds, sensed.contact, events)

    def take(
        self,
        time: float,
        pose: Array,
        velocity: Array,
        contact: BoolArray,
        events: Sequence[StackEvent],
    ) -> Entries:
        """Take in one tick by its parts; gives what became of the stops that are claimed.

        Args:
            time: [s].
            pose: ``(N, 3)`` [m, m, rad].
            velocity: ``(N, 2)`` forward and left [m/s].
            contact: ``(N, 3)`` touched a robot, a person, a solid.
            events: of the tick.
        """
        self._halts.update(pose, velocity, contact, time)
        counted, known = [], len(self.refused.rows)
        for event in events:
            if event.kind == "assigned":
                self.given[event.task] = event.robot
            if event.kind not in STOP_KINDS:
                continue
            reason = self._objection(event, time, pose, velocity)
            if reason:
                self.refused.add(event, time, reason)
            else:
                self.enter((event,), time)
                self._served_until[event.robot] = time
                counted.append(event)
        return Entries(tuple(counted), tuple(self.refused.rows[known:]))

    def forget_after(self, time: float) -> None:
        """Expect no task any more that arrives after ``time`` [s]."""
        tasks = self.world.tasks
        self.due = frozenset(task for task in self.due if tasks[task].arrival <= time)

    # --- what speaks against a claim ----------------------------------------------------------

    def _objection(self, event: StackEvent, time: float, pose: Array, velocity: Array) -> str:
        """Say what contradicts a claim, empty: nothing does."""
        return (
            unknown_in(event, self.world, must_name=True)
            or self._objection_of_order(event, time)
            or self._objection_of_place(event, pose[event.robot, :2])
            or self._objection_of_rest(event, time, velocity[event.robot])
        )

    def _objection_of_order(self, event: StackEvent, time: float) -> str:
        """Say what came before and does not allow the stop."""
        robot, task = self.world.robots[event.robot], event.task
        if self.world.tasks[task].arrival > time + ROUNDING:
            return "the task has not arrived"
        if robot.joins_at > time + ROUNDING:
            return "the robot has not joined"
        if task in self.delivered:
            return "it has been delivered already"
        if event.kind == "picked-up":
            if task in self.picked:
                return "it has been picked up already"
            aboard = len(self.aboard(event.robot))
            if aboard >= robot.capacity:
                return f"over capacity: {aboard} aboard, room for {robot.capacity}"
            return ""
        return "" if self.by.get(task, -1) == event.robot else "the robot has not picked it up"

    def _objection_of_place(self, event: StackEvent, position: Array) -> str:
        """Say why the robot cannot reach the room's point."""
        room = self.world.rooms[_room_of(self.world.tasks[event.task], event.kind)]
        if event.resource not in ("", room.name):
            return f"it names {event.resource}, the task's room is {room.name}"
        away = float(np.hypot(*(position - room.point)))
        if not away <= ROOM_REACH:
            return f"elsewhere: {away:.1f} m from {room.name}"
        if self._is_walled_off(room.point, position):
            return f"a wall stands between the robot and {room.name}"
        return ""

    def _objection_of_rest(self, event: StackEvent, time: float, velocity: Array) -> str:
        """Say why the robot was not at rest for long enough."""
        task = self.world.tasks[event.task]
        service = task.pickup_time if event.kind == "picked-up" else task.dropoff_time
        speed = float(np.hypot(*velocity))
        if not speed <= STOPPED and not self._halts.may_be_shoved(event.robot, time):
            return f"moving: at {speed:.2f} m/s"
        # Loading begins when the robot stands there, the task is known, and the one before is done.
        begun = max(self._halts.since(event.robot), self._served_until[event.robot], task.arrival)
        if time - begun < service - ROUNDING:
            return f"not long enough: {max(0.0, time - begun):.1f} s of {service:.1f} s"
        return ""

    def _is_walled_off(self, point: Array, position: Array) -> bool:
        if self._walls is None:
            self._walls = tuple(Polygon(wall.polygon) for wall in self.world.walls)
        line, center = LineString([point, position]), Point(point)
        return any(
            wall.intersects(line) and wall.distance(center) > AT_POINT for wall in self._walls
        )


def stop_area(point: Array, walls: Sequence[Polygon]) -> Any:
    """Make the area in which a robot's stop at a room counts, as :class:`Books` has it.

    Args:
        point: ``(2,)`` [m] of the room.
        walls: of the world; those behind which a stop does not count throw a shadow.

    Returns:
        A shape of shapely's.
    """
    center, area = Point(point), around(point, ROOM_REACH)
    for wall in walls:
        if AT_POINT < wall.distance(center) <= ROOM_REACH:
            area = shapely.difference(area, _shadow(point, wall))
    return area


def _shadow(point: Array, wall: Polygon) -> Any:
    """Make the area that a wall hides from a point, at least as far as a stop may be from it."""
    corners = np.asarray(wall.exterior.coords)
    behind = point + (corners - point) * (1.5 * ROOM_REACH / AT_POINT)
    sides = np.stack([corners[:-1], corners[1:], behind[1:], behind[:-1]], axis=1)
    return shapely.union_all([wall, *shapely.make_valid(shapely.polygons(sides))])


def _room_of(task: Task, kind: str) -> int:
    return task.start if kind == "picked-up" else task.end


# --- of a recorded run --------------------------------------------------------------------


def confirmed(trace: Trace, world: World) -> Trace:
    """Leave out of a trace the claims that its motion contradicts, as the books did in the run.

    Each remaining stop has the time of the tick in which the claim came, when it was counted.

    Args:
        trace: without its columns nothing can be confirmed, and it stays as it is.
        world: of the run.
    """
    if "pose" not in trace.columns:
        return trace
    columns, books = trace.columns, Books(world)
    brought: dict[int, list[StackEvent]] = {}
    for event, tick in zip(trace.events, _event_ticks(trace), strict=True):
        brought.setdefault(tick, []).append(event)
    kept: list[StackEvent] = []
    for k, time in enumerate(columns["time"].tolist()):
        now = brought.pop(k, [])
        speeds, contact = columns["velocity"][k, :, :2], columns["contact"][k]
        entries = books.take(time, columns["pose"][k], speeds, contact, now)
        counted = set(map(id, entries.confirmed))
        kept += [
            replace(event, time=time) if id(event) in counted else event
            for event in now
            if event.kind not in STOP_KINDS or id(event) in counted
        ]
    kept += [e for rest in brought.values() for e in rest if e.kind not in STOP_KINDS]
    return replace(trace, events=tuple(kept), event_ticks=())


def _event_ticks(trace: Trace) -> Sequence[int]:
    """Find the tick that brought each event; older traces tell only the event's own time."""
    if trace.event_ticks:
        return trace.event_ticks
    ends = trace.columns["time"] + 0.5 * trace.dt
    first = np.searchsorted(ends, [event.time for event in trace.events])
    return np.maximum.accumulate(first).tolist() if len(first) else ()
