"""How near a run came to a deadlock, also where everybody got through: a slope for the search.

Two measures in [0, 1], 1 being nearest:

``cycle``: Robots that wait for a moving robot are a cycle but for one edge. That edge is missed by
    the time until the moving robot gets to where one of them stands. A closed cycle counts more,
    the longer it lasts.

``encroachment``: Robots that use a narrow place against each other. The time between one leaving it
    and the other entering is the post-encroachment time of traffic safety (Allen, Shin and Cooper,
    "Analysis of traffic conflicts and collisions", 1978).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt, maximum_filter

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.feedback import ENCROACHMENT_COUNTS
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.free_distance import free_distance
from mrta_falsify.specs.deadlock.occupancy import GRID_CELL, SOLID_CLEARANCE
from mrta_falsify.specs.waits import Waits, followers, in_cycles, waits_of

CLOSED = ENCROACHMENT_COUNTS  # a cycle that just closed; what is missing to 1 is how long it lasts
LASTING = 30.0  # s; a cycle that lasts longer counts no more
MISSED_BY = 5.0  # s; an edge missed by this counts 1/e of one that is missed by nothing
OVERLAP = 5.0  # s of waiting at the same time, after which a chain counts three quarters
BESIDE = 0.15  # m between two bodies that cannot pass each other's place
AHEAD = 6.0  # m of path that are looked at for a missing edge
PLACE = 0.5  # m, side of the squares that a narrow place consists of
SAME_WIDTH = 1.0  # m within which the widest spot tells the width of a passage
DRIVING = 0.05  # m/s, slower ones do not use a place but stand there
AGAINST = math.radians(60.0)  # robots whose headings differ by less follow each other


@dataclass(frozen=True, slots=True)
class NearMiss:
    """The moment at which a run was nearest to a deadlock."""

    closeness: float = 0.0
    robots: frozenset[int] = frozenset()  #: numbers of those that took part
    edges: tuple[BlockedBy, ...] = ()  #: of that moment


@dataclass(slots=True)
class AlmostCycles:
    """Follows chains of waiting robots and the edge that each lacks to be a cycle."""

    world: World
    nearest: NearMiss = NearMiss()
    _since: dict[frozenset[int], float] = field(default_factory=dict)  #: of chains and cycles [s]

    def update(self, frame: Frame) -> None:
        """Take in a moment."""
        waits = waits_of(frame.blocked_by)
        if not waits:
            self._since.clear()
            return
        time = frame.sensed.time
        now: dict[frozenset[int], float] = {}
        members = in_cycles(waits)
        if members:
            lasted = self._lasted(members, time, now)
            share = min(lasted / LASTING, 1.0)
            self._keep(CLOSED + (1.0 - CLOSED) * share, members, frame)
        for root, waiting in followers(waits).items():
            chain = waiting | {root}
            lasted = self._lasted(chain, time, now)
            missed_by = self._missed_by(root, waiting, frame)
            weight = 0.5 + 0.5 * lasted / (lasted + OVERLAP)
            self._keep(CLOSED * weight * math.exp(-missed_by / MISSED_BY), chain, frame)
        self._since = now

    def _lasted(
        self, robots: frozenset[int], time: float, now: dict[frozenset[int], float]
    ) -> float:
        now[robots] = self._since.get(robots, time)
        return time - now[robots]

    def _keep(self, closeness: float, robots: frozenset[int], frame: Frame) -> None:
        if closeness > self.nearest.closeness:
            self.nearest = NearMiss(closeness, robots, frame.blocked_by)

    def _missed_by(self, root: int, waiting: frozenset[int], frame: Frame) -> float:
        """Tell when ``root`` will need the place of a robot that waits for it [s]; inf: never."""
        path, robots = frame.intent.path[root], self.world.robots
        if len(path) < 2:
            return math.inf
        points, along = _resampled(path)
        reach = np.inf
        for other in waiting:
            place = frame.sensed.pose[other, :2]
            apart = robots[root].radius + robots[other].radius + BESIDE
            inside = np.flatnonzero(np.hypot(*(points - place).T) < apart)
            if len(inside):
                reach = min(reach, float(along[inside[0]]))
        return reach / max(robots[root].cruise_speed, DRIVING)


@dataclass(slots=True)
class Encroachments:
    """Follows who used each narrow place last, and in which direction."""

    world: World
    nearest: NearMiss = NearMiss()
    _narrow: BoolArray | None = None  #: (rows, cols) of the oracle's grid
    _last: dict[tuple[int, int], tuple[int, float, float]] = field(default_factory=dict)
    """Robot, time [s] and heading [rad] of the last use, by place."""

    def update(self, frame: Frame) -> None:
        """Take in a moment."""
        sensed = frame.sensed
        speed = np.hypot(sensed.velocity[:, 0], sensed.velocity[:, 1])
        for robot in np.flatnonzero(speed > DRIVING).tolist():
            x, y, yaw = sensed.pose[robot].tolist()
            if self._is_narrow(x, y):
                place = (math.floor(x / PLACE), math.floor(y / PLACE))
                self._use(robot, place, sensed.time, yaw, frame)

    def _use(
        self, robot: int, place: tuple[int, int], time: float, yaw: float, frame: Frame
    ) -> None:
        before = self._last.get(place)
        self._last[place] = (robot, time, yaw)
        if before is None or before[0] == robot:
            return
        other, left, heading = before
        if abs(math.remainder(yaw - heading, math.tau)) < AGAINST:
            return
        closeness = math.exp(-(time - left) / MISSED_BY)
        if closeness > self.nearest.closeness:
            self.nearest = NearMiss(closeness, frozenset((robot, other)), frame.blocked_by)

    def _is_narrow(self, x: float, y: float) -> bool:
        if self._narrow is None:
            self._narrow = narrow_places(self.world)
        rows, cols = self._narrow.shape
        row = math.floor((y - self.world.bounds[1]) / GRID_CELL)
        col = math.floor((x - self.world.bounds[0]) / GRID_CELL)
        return bool(0 <= row < rows and 0 <= col < cols and self._narrow[row, col])


def narrow_places(world: World) -> BoolArray:
    """Mark the free cells of the oracle's grid at which two of the robots cannot pass.

    Returns:
        ``(rows, cols)``; (0, 0) is at the map's lower left corner.
    """
    free = free_distance(world).free
    widest = max((robot.radius for robot in world.robots), default=0.0)
    beside = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * GRID_CELL + SOLID_CLEARANCE
    half_width = maximum_filter(beside, size=2 * round(SAME_WIDTH / GRID_CELL) + 1)
    narrow: BoolArray = free & (half_width < 2.0 * widest + BESIDE)
    return narrow


def _resampled(path: Array) -> tuple[Array, Array]:
    """Lay points ``(M, 2)`` 0.2 m apart along the first metres of ``path`` ``(L, 2)``.

    Returns:
        The points, and how far along the path each lies ``(M,)``, all in [m].
    """
    legs = np.hypot(*np.diff(path, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(legs)])
    along = np.arange(0.0, min(float(length[-1]), AHEAD) + 1e-9, 2.0 * GRID_CELL)
    points = np.stack([np.interp(along, length, path[:, axis]) for axis in (0, 1)], axis=1)
    return points, along


def chain_role(waits: Waits, robot: int, members: frozenset[int]) -> str:
    """Say which part a robot has in the waiting: ``cycle``, ``chain``, ``waits`` or ``alone``."""
    if robot in members:
        return "cycle"
    ahead = waits.get(robot)
    if not ahead:
        return "alone"
    return "chain" if any(other in waits for other in ahead) else "waits"
