"""Contacts and gaps: robots, people and what stands around.

Robustness is a distance [m]; gaps beyond 10 m and "nothing to judge" give the cap.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Frame, Sensed
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import World
from mrta_falsify.specs.running_min import RunningMin

GAP_CAP = 10.0  # m; wider gaps count as this wide
TOUCH_GAP = -1e-3  # m, robustness of a contact whose measured gap is not negative
CONTACT_PAUSE = 0.5  # s without contact that end a contact episode
DRIVING_SPEED = 0.05  # m/s; slower robots count as at rest
SHRUNK = 0.01  # m by which a distance that was there at the start has to shrink to count


class Closest(NamedTuple):
    """What came nearest to people in a tick, over all robots."""

    human: float  #: least surface gap to a person [m], >= 0
    touched: bool  #: whether any robot touched anything; then the gap alone does not tell


@functools.lru_cache(maxsize=1)
def closest(sensed: Sensed) -> Closest:
    """Find what came nearest in a tick; all who ask about it share the answer."""
    return Closest(*_closest(sensed.gap_human, sensed.contact))


@njit(cache=True)
def _closest(human: Array, contact: BoolArray) -> tuple[float, bool]:
    least, touched = np.inf, False
    for i in range(len(contact)):
        least = min(least, human[i])
        touched = touched or contact[i, 0] or contact[i, 1] or contact[i, 2]
    return max(least, 0.0), touched


@dataclass(slots=True)
class _MovingBeforeContact:
    """Tells robots that drive from robots that stand, even while a person pushes them.

    During a contact with a person the state from before holds, unless the robot is commanded
    to drive and does. So a robot that is shoved does not count as moving.
    """

    _velocity: Array | None = None  #: (N, 3) of the last tick
    _moving: BoolArray | None = None  #: (N,) of the last tick, None: not worked out

    def skip(self, frame: Frame) -> None:
        """Take in a tick whose answer is not needed."""
        self._velocity = frame.sensed.velocity
        self._moving = None

    def update(self, frame: Frame) -> BoolArray:
        """Take in a tick; which robots ``(N,)`` count as moving."""
        velocity, contact = frame.sensed.velocity, frame.sensed.contact
        before = velocity if self._velocity is None else self._velocity
        held = self._moving
        if held is None:
            held = np.sqrt(before[:, 0] ** 2 + before[:, 1] ** 2) > DRIVING_SPEED
        self._velocity = velocity
        self._moving = _moving(velocity, before, frame.command.twist, contact, held)
        return self._moving


@njit(cache=True)
def _moving(
    velocity: Array, before: Array, twist: Array, contact: BoolArray, held: BoolArray
) -> BoolArray:
    moving = held.copy()
    for i in range(len(velocity)):
        drives = np.hypot(velocity[i, 0], velocity[i, 1]) > DRIVING_SPEED
        if contact[i, 1]:
            commanded = np.hypot(twist[i, 0], twist[i, 1]) > DRIVING_SPEED
            moving[i] = held[i] or (drives and commanded)
        else:
            moving[i] = drives or np.hypot(before[i, 0], before[i, 1]) > DRIVING_SPEED
    return moving


class ContactCounter:
    """Counts contact episodes of each pair: onsets after at least 0.5 s without contact."""

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
        self._settle = max(CONTACT_PAUSE, 1.5 * dt)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        if not closest(frame.sensed).touched:
            self._moving.skip(frame)
            return
        contact = frame.sensed.contact
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
        """Count the episodes so far: robot_robot, robot_human, robot_static, robot_human_at_rest.

        ``robot_human`` are those of a moving robot only.
        """
        return dict(self._totals)


class _NarrowestGap:
    """Narrowest gap of one kind [m] over the robots that count; negative after a contact."""

    name = ""
    limit = 0.0  #: gap that must be kept [m]

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del dt
        self._world = world
        self._narrowest = RunningMin(self.name, GAP_CAP, {"nearest": {}, "between": []})

    def _note(self, frame: Frame, gaps: Array) -> None:
        """Keep the narrowest of ``gaps`` ``(N,)`` [m], if it is narrower than all before."""
        i = int(gaps.argmin())
        gap = float(gaps[i]) - self.limit
        if gap >= self._narrowest.margin:
            return
        sensed = frame.sensed
        who = self._names(frame, i)
        speed = float(np.hypot(sensed.velocity[i, 0], sensed.velocity[i, 1]))
        nearest = {
            "gap": float(gaps[i]),
            "time": sensed.time,
            "robot": self._world.robots[i].name,
            "speed": speed,
            "x": float(sensed.pose[i, 0]),
            "y": float(sensed.pose[i, 1]),
        }
        self._narrowest.note(gap, sensed.time, who, {"nearest": nearest, "between": list(who)})

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return self._narrowest.verdict(**self._more())

    def _names(self, frame: Frame, i: int) -> tuple[str, ...]:
        return (self._world.robots[i].name,)

    def _more(self) -> dict[str, Any]:
        return {}


def _with_contacts(gap: Array, contact: BoolArray) -> Array:
    """Correct gaps ``(N,)`` [m] by contacts: a contact is never positive, a gap never negative."""
    if True not in contact.tolist():
        # an engine that reports no contact saw none: rounding must not make one
        return np.maximum(gap, 0.0)
    return np.where(contact, np.minimum(gap, TOUCH_GAP), np.maximum(gap, 0.0))


class _ShrunkGap(_NarrowestGap):
    """Narrowest gap that was not there from the start.

    How near a robot stands to something at the start is the scene's doing. Its gap counts once it
    has shrunk by ``SHRUNK``, or once there is a contact.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    _kind: ClassVar[int]  #: column of ``Sensed.contact``
    _gap: ClassVar[attrgetter[Array]]  #: ``(N,)`` of a :class:`Sensed` [m]

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._widest = np.full(len(world.robots), -np.inf)  # (N,) so far [m]
        self._counts = np.zeros(len(world.robots), dtype=np.bool_)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        gap, contact = self._gap(frame.sensed), frame.sensed.contact
        margin = self._narrowest.margin
        if _is_news(gap, contact, self._kind, self._widest, self._counts, margin):
            gaps = _with_contacts(gap, contact[:, self._kind])
            self._note(frame, np.where(self._counts, gaps, np.inf))


@njit(cache=True)
def _is_news(
    gap: Array,
    contact: BoolArray,
    kind: int,
    widest: Array,
    counts: BoolArray,
    margin: float,
) -> bool:
    """Say whether a gap that counts may be below ``margin`` [m]; bring the others up to date.

    Args:
        gap: ``(N,)`` [m].
        contact: ``(N, 3)``.
        kind: column of ``contact``.
        widest: ``(N,)`` widest gap so far [m].
        counts: ``(N,)`` whose gap counts.
        margin: narrowest gap so far [m].
    """
    news = False
    for i in range(len(gap)):
        counts[i] = counts[i] or contact[i, kind] or gap[i] < widest[i] - SHRUNK
        widest[i] = max(widest[i], gap[i])
        news = news or (counts[i] and (contact[i, kind] or max(gap[i], 0.0) < margin))
    return news


class NoRobotRobotContact(_ShrunkGap):
    """No two robots touch. Robustness: narrowest surface gap [m], negative after a contact.

    A gap that was there at the start counts once it has shrunk.
    """

    name = "no_robot_robot_contact"
    _kind = 0
    _gap = attrgetter("gap_robot")

    def _names(self, frame: Frame, i: int) -> tuple[str, ...]:
        robots = self._world.robots
        other = int(frame.sensed.nearest_robot[i])
        return tuple(sorted(robots[k].name for k in {i, other} if k >= 0))


class NoRobotStaticContact(_ShrunkGap):
    """No robot touches a solid. Robustness: narrowest surface gap [m], negative after a contact.

    A gap that was there at the start counts once it has shrunk.
    """

    name = "no_robot_static_contact"
    _kind = 2
    _gap = attrgetter("gap_static")


class _HumanGap(_NarrowestGap):
    """Narrowest gap to people over moving robots; robots at rest are counted apart."""

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """Which robots count."""

        count_at_rest: bool = False  #: people who walk into a robot at rest count as well

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        super().start(world, dt)
        self._moving = _MovingBeforeContact()
        self._at_rest = GAP_CAP
        self._news_below = self._least_news()
        self._quiet: Frame | None = None  # the last tick, if nothing in it was new
        self._counter = ContactCounter()
        self._counter.start(world, dt)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        near = closest(frame.sensed)
        if not near.touched and near.human >= self._news_below:
            self._quiet = frame
            return
        gaps = self._gaps(frame)
        self._quiet = None
        if len(gaps):
            self._note(frame, gaps)
        self._news_below = self._least_news()

    def _gaps(self, frame: Frame) -> Array:
        if not len(self._world.humans):
            return np.zeros(0)
        if self._quiet is not None:
            self._counter.update(self._quiet)
            self._moving.skip(self._quiet)
        sensed = frame.sensed
        gaps = _with_contacts(sensed.gap_human, sensed.contact[:, 1])
        self._counter.update(frame)
        if gaps.min(initial=np.inf) >= max(self._narrowest.margin + self.limit, self._at_rest):
            self._moving.skip(frame)
            return np.zeros(0)  # nothing new
        moving = self._moving.update(frame)
        self._at_rest = min(self._at_rest, float(np.where(moving, np.inf, gaps).min()))
        if self._options.count_at_rest:
            return gaps
        return np.where(moving, gaps, np.inf)

    def _least_news(self) -> float:
        """Find the gap [m] that changes nothing, as all wider ones, without a contact."""
        return max(self._narrowest.margin + self.limit, self._at_rest)

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
