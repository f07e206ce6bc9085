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
from mrta_falsify.core.spec_profile import SpecProfile
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


class ContactCounter:
    """Counts contact episodes of each pair, and says which robots count as moving.

    An episode begins with a touch after at least 0.5 s without one. Update it once a tick.

    A robot counts as moving if it is faster than ``DRIVING_SPEED`` in a tick or in the tick
    before. While a person touches it, and in pauses of up to 0.5 s between touches, it counts as
    what it was in the tick before the first touch, until it drives as it was commanded to: so a
    robot that is shoved does not count as moving. An episode in which a robot at rest begins to
    drive is counted as both.
    """

    def start(self, world: World, dt: float) -> None:
        """Begin an episode with control period ``dt`` [s]."""
        self._last: dict[tuple[str, int, int], float] = {}
        self._totals = {
            "robot_robot": 0,
            "robot_human": 0,
            "robot_static": 0,
            "robot_human_at_rest": 0,
        }
        self._settle = max(CONTACT_PAUSE, 1.5 * dt)
        self._moving = np.zeros(len(world.robots), dtype=np.bool_)
        self._touched = np.full(len(world.robots), -np.inf)  # last time by a person [s]
        self._touch = -np.inf  # the same of any robot [s]
        self._frames: tuple[Frame, Frame] | None = None  # of the tick before, and of this one

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        sensed = frame.sensed
        self._frames = (frame if self._frames is None else self._frames[1], frame)
        is_touched = closest(sensed).touched
        if not is_touched and sensed.time - self._touch > self._settle:
            return
        moving = self.moving()
        if is_touched:
            self._count(sensed, moving)

    def moving(self) -> BoolArray:
        """Say which robots ``(N,)`` count as moving in the tick that was taken in last."""
        assert self._frames is not None, "a tick was taken in"
        before, now = self._frames
        velocities = now.sensed.velocity, before.sensed.velocity
        twist, contact, time = before.command.twist, now.sensed.contact, now.sensed.time
        state = self._touched, self._moving
        _note_motion(*velocities, twist, contact, time, self._settle, *state)
        return self._moving

    def speed(self, i: int) -> float:
        """Measure the speed [m/s] of robot ``i``, in the tick before if it was faster then."""
        frames = self._frames or ()
        return max(float(np.hypot(*frame.sensed.velocity[i, :2])) for frame in frames)

    def _count(self, sensed: Sensed, moving: BoolArray) -> None:
        for i, kind in zip(*np.nonzero(sensed.contact), strict=True):
            robot, other = int(i), -1
            name = ("robot_robot", "robot_human", "robot_static")[kind]
            if kind == 0:
                other = int(sensed.nearest_robot[i])
                robot, other = min(robot, other), max(robot, other)
            elif kind == 1:
                other = int(sensed.nearest_human[i])
                name = name if moving[i] else "robot_human_at_rest"
                self._touch = sensed.time
            key = (name, robot, other)
            if sensed.time - self._last.get(key, -np.inf) > self._settle:
                self._totals[name] += 1
            self._last[key] = sensed.time

    def totals(self) -> dict[str, int]:
        """Count the episodes so far: robot_robot, robot_human, robot_static, robot_human_at_rest.

        ``robot_human`` are those of a moving robot only.
        """
        return dict(self._totals)


@njit(cache=True)
def _note_motion(
    velocity: Array,
    before: Array,
    twist: Array,
    contact: BoolArray,
    time: float,
    pause: float,
    touched: Array,
    moving: BoolArray,
) -> None:
    """Bring ``moving`` ``(N,)`` and ``touched`` ``(N,)`` [s] to a tick; doing it twice is once.

    Args:
        velocity: ``(N, 3)`` of the tick.
        before: ``(N, 3)`` of the tick before.
        twist: ``(N, 3)`` commanded in the tick before, which led to ``velocity``.
        contact: ``(N, 3)`` touched a robot, a person, a solid.
        time: of the tick [s].
        pause: longest time between touches of one episode [s].
        touched: last time by a person.
        moving: who counts as moving.
    """
    for i in range(len(velocity)):
        drives = np.hypot(velocity[i, 0], velocity[i, 1]) > DRIVING_SPEED
        drove = np.hypot(before[i, 0], before[i, 1]) > DRIVING_SPEED
        is_known = time - touched[i] <= pause
        if contact[i, 1] or is_known:
            commanded = np.hypot(twist[i, 0], twist[i, 1]) > DRIVING_SPEED
            moving[i] = (moving[i] if is_known else drove) or (drives and commanded)
        else:
            moving[i] = drives or drove
        if contact[i, 1]:
            touched[i] = time


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
        nearest = {
            "gap": float(gaps[i]),
            "time": sensed.time,
            "robot": self._world.robots[i].name,
            "speed": self._speed(frame, i),
            "x": float(sensed.pose[i, 0]),
            "y": float(sensed.pose[i, 1]),
        }
        self._narrowest.note(gap, sensed.time, who, {"nearest": nearest, "between": list(who)})

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return self._narrowest.verdict(**self._more())

    def _speed(self, frame: Frame, i: int) -> float:
        return float(np.hypot(*frame.sensed.velocity[i, :2]))

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
        """No options."""

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

    profile = SpecProfile(meaning="two robots touched", scale=0.5, tie=5, layer="controller")

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

    profile = SpecProfile(meaning="a robot touched a wall or furniture", scale=0.3, tie=6)

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
        self._at_rest = GAP_CAP
        self._news_below = self._least_news()
        self._counter = ContactCounter()
        self._counter.start(world, dt)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        if not self._world.humans:
            return
        self._counter.update(frame)
        sensed = frame.sensed
        near = closest(sensed)
        if not near.touched and near.human >= self._news_below:
            return
        gap, contact, moving = sensed.gap_human, sensed.contact[:, 1], self._counter.moving()
        least, counts_at_rest = self._narrowest.margin + self.limit, self._options.count_at_rest
        if not _is_nearer(gap, contact, moving, least, self._at_rest, counts_at_rest):
            return
        gaps = _with_contacts(gap, contact)
        self._at_rest = min(self._at_rest, float(np.where(moving, np.inf, gaps).min()))
        self._note(frame, gaps if counts_at_rest else np.where(moving, gaps, np.inf))
        self._news_below = self._least_news()

    def _least_news(self) -> float:
        """Find the gap [m] that changes nothing, as all wider ones, without a contact."""
        return max(self._narrowest.margin + self.limit, self._at_rest)

    def _speed(self, frame: Frame, i: int) -> float:
        return self._counter.speed(i)

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


@njit(cache=True)
def _is_nearer(
    gap: Array,
    contact: BoolArray,
    moving: BoolArray,
    least: float,
    at_rest: float,
    counts_at_rest: bool,
) -> bool:
    """Say whether a robot is nearer to people than any of its kind has been.

    Args:
        gap: ``(N,)`` [m].
        contact: ``(N,)`` touched a person.
        moving: ``(N,)`` counts as moving.
        least: narrowest gap so far of the robots that count [m].
        at_rest: the same of robots at rest [m].
        counts_at_rest: robots at rest count, too.
    """
    for i in range(len(gap)):
        before = least if moving[i] else at_rest
        if counts_at_rest:
            before = max(before, least)
        if contact[i] or max(gap[i], 0.0) < before:
            return True
    return False


class NoRobotHumanContact(_HumanGap):
    """No moving robot touches a person. Robustness: narrowest surface gap [m].

    Which robots count as moving is for :class:`ContactCounter` to say, whose counts are in
    ``evidence["contacts"]`` and, of people who walk into a robot at rest, in
    ``evidence["at_rest"]``. ``evidence["nearest"]["speed"]`` is the robot's speed at the nearest
    pass, or in the tick before if that is larger.
    """

    profile = SpecProfile(
        meaning="a moving robot touched a person", scale=0.5, tie=7, layer="controller"
    )

    name = "no_robot_human_contact"


class HumanClearance(_HumanGap):
    """Moving robots keep clear of people. Robustness: narrowest surface gap minus 0.1 m [m]."""

    profile = SpecProfile(
        meaning="a moving robot came closer than 0.1 m to a person",
        scale=0.5,
        tie=12,
        part_of=NoRobotHumanContact.name,
        layer="controller",
    )

    name = "human_clearance"

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """How much room people get."""

        clearance: float = quantity(low=0.0, unit="m", default=0.1)  #: surface to surface
        count_at_rest: bool = False  #: as in ``no_robot_human_contact``

    def __init__(self, options: Options) -> None:
        super().__init__(_HumanGap.Options(count_at_rest=options.count_at_rest))
        self.limit = options.clearance
