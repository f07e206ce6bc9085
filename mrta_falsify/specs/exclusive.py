"""Resources are used by no more robots than they have room for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.codec import quantity
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.plane import signed_distances
from mrta_falsify.core.spec_profile import SpecProfile
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Resource, World
from mrta_falsify.specs.contacts import GAP_CAP, SHRUNK
from mrta_falsify.specs.running_min import RunningMin

ROUNDING = 1e-9  # m


class ExclusiveUse:
    """At most ``capacity`` robots are inside each resource at once.

    Inside means that the robot's centre lies in the resource's own space. That is a room's outline
    where the world has one, otherwise the release area without a rim: robots on the rim are
    coming or going. Robustness [m]: signed distance, positive outside, of the robot that
    would be one too many (the ``capacity + 1``-th nearest) to that space, worst over time. How near
    that robot starts is the scene's doing: it counts from when it comes nearer. A resource that is
    overfull at the start is judged from when it first was not.

    A resource that is held ``until_served`` is free again before the robot has left. There a robot
    counts until it has been inside for the service time, in a room until a stop of it was done.

    Only positions count, not what the stack's queues say.
    """

    profile = SpecProfile(meaning="more robots were in a resource than it has room for", tie=4)

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """What counts as inside."""

        rim: float = quantity(low=0.0, unit="m", default=0.5)  #: of release areas, left out

    def __init__(self, options: Options) -> None:
        self._options = options

    def start(self, world: World, dt: float) -> None:
        """Begin an episode."""
        del dt
        self._names = tuple(robot.name for robot in world.robots)
        crowded = [r for r in world.resources if r.capacity < len(world.robots)]
        self._resources = tuple(crowded)
        self._areas = tuple(_inner_area(world, r, self._options.rim) for r in crowded)
        first = np.cumsum([0, *map(len, self._areas)])
        self._spaces = _Spaces(
            corners=np.concatenate([np.zeros((0, 2)), *self._areas]),
            first=first.astype(np.int64),
            capacity=np.array([r.capacity for r in crowded], dtype=np.int64),
            box=np.array([[a.min(axis=0), a.max(axis=0)] for a in self._areas]).reshape(-1, 2, 2),
        )
        self._judged = np.zeros(len(crowded), dtype=np.bool_)
        self._widest = np.full(len(crowded), -np.inf)  # (R,) margin before that [m]
        self._visits = _Visits(crowded, len(world.robots))
        self._closest = RunningMin("exclusive_use", GAP_CAP)

    def update(self, frame: Frame) -> None:
        """Take in one tick."""
        pose = frame.sensed.pose
        uses = self._visits.uses(frame)
        state, least = (self._judged, self._widest), self._closest.margin
        if not _is_news(tuple(self._spaces), pose, uses, state, least):
            return
        for k, resource in enumerate(self._resources):
            margin = float(_margin(self._spaces, k, pose, uses[k]))
            if self._judged[k] and margin < self._closest.margin:
                distance = np.where(uses[k], signed_distances(self._areas[k], pose), np.inf)
                self._note(frame, resource, distance, margin)

    def _note(self, frame: Frame, resource: Resource, distance: Array, margin: float) -> None:
        order = np.argsort(distance, kind="stable")[: resource.capacity + 1]
        near = [self._names[i] for i in order]
        time = frame.sensed.time
        evidence = {
            "resource": resource.name,
            "capacity": resource.capacity,
            "time": time,
            "nearest": near,
            "distances": [float(distance[i]) for i in order],
        }
        self._closest.note(margin, time, tuple(sorted(near)), evidence)

    def verdict(self) -> Verdict:
        """Give the verdict to date."""
        return self._closest.verdict()


class _Visits:
    """Tells who uses each of R resources, or may go on to use it: ``(R, N)``.

    Args:
        resources: whose ``hold`` says when a robot that is inside has done with it.
        robots: how many there are.
    """

    def __init__(self, resources: Sequence[Resource], robots: int) -> None:
        self._resources = [(k, r) for k, r in enumerate(resources) if r.hold == "until_served"]
        self._uses = np.ones((len(resources), robots), dtype=np.bool_)
        self._since = np.full((len(resources), robots), np.inf)  # inside since then [s]
        self._before = np.zeros((len(resources), robots), dtype=np.int64)  # stops served by then

    def uses(self, frame: Frame) -> BoolArray:
        """Take in one tick."""
        time = frame.sensed.time
        for k, resource in self._resources:
            inside = signed_distances(np.asarray(resource.release_area), frame.sensed.pose) < 0.0
            enters = inside & np.isinf(self._since[k])
            self._since[k][enters], self._before[k][enters] = time, frame.served[enters]
            self._since[k][~inside] = np.inf
            is_served = time >= self._since[k] + resource.service_time
            if resource.room is not None:
                is_served = inside & (frame.served > self._before[k])
            self._uses[k] = ~is_served
        return self._uses


def _inner_area(world: World, resource: Resource, rim: float) -> Array:
    """Find the outline ``(V, 2)`` [m] of a resource's own space."""
    if resource.room is not None and len(world.rooms[resource.room].area) >= 3:
        return np.asarray(world.rooms[resource.room].area)
    outline = Polygon(resource.release_area)
    inner = outline.buffer(-rim, join_style="mitre")
    if inner.is_empty:
        inner = outline
    largest = max(getattr(inner, "geoms", [inner]), key=lambda part: part.area)
    return np.array(orient(largest).exterior.coords)[:-1]


class _Spaces(NamedTuple):
    """Spaces of resources, one after the other."""

    corners: Array  #: (V, 2) [m] of all
    first: IntArray  #: (R + 1,) corner of each
    capacity: IntArray  #: (R,) robots
    box: Array  #: (R, 2, 2) least, then largest x, y of each [m]


@njit(cache=True)
def _is_news(
    fields: tuple[Any, ...],
    pose: Array,
    uses: BoolArray,
    state: tuple[BoolArray, Array],
    least: float,
) -> bool:
    """Say whether a margin is below ``least`` [m].

    Args:
        fields: of the spaces.
        pose: ``(N, 3)``.
        uses: ``(R, N)`` robots that count.
        state: of which resources the margin counts ``(R,)``, and the widest margin ``(R,)`` [m]
            of the others; both are brought up to date.
        least: margin so far [m].
    """
    news = False
    spaces = _Spaces(*fields)
    judged, widest = state
    for k in range(len(judged)):
        if judged[k] and _count_around(spaces.box[k], pose, least) <= spaces.capacity[k]:
            continue
        margin = _margin(spaces, k, pose, uses[k])
        if not judged[k]:
            judged[k] = widest[k] >= 0.0 and (margin < 0.0 or margin < widest[k] - SHRUNK)
            widest[k] = max(widest[k], margin)
        news = news or (judged[k] and margin < least)
    return news


@njit(cache=True)
def _count_around(box: Array, pose: Array, within: float) -> int:
    """Count the robots that may be nearer than ``within`` [m] to what a box is around."""
    count = 0
    for i in range(len(pose)):
        is_off = False
        for axis in range(2):
            low, high = box[0, axis] - within, box[1, axis] + within
            is_off = is_off or pose[i, axis] < low - ROUNDING or pose[i, axis] > high + ROUNDING
        count += not is_off
    return count


@njit(cache=True)
def _margin(spaces: _Spaces, k: int, pose: Array, uses: BoolArray) -> float:
    """Measure how far the robot that is one too many is from resource ``k`` [m], inf: none is.

    ``uses`` ``(N,)``: robots that count.
    """
    area, box = spaces.corners[spaces.first[k] : spaces.first[k + 1]], spaces.box[k]
    last = spaces.capacity[k]
    nearest = np.full(last + 1, np.inf)  # distances of so many robots, ascending
    for i in range(len(pose)):
        if not uses[i] or _gap_to_box(box, pose[i, 0], pose[i, 1]) > nearest[last] + ROUNDING:
            continue
        distance, place = signed_distances(area, pose[i : i + 1])[0], last
        while place >= 0 and distance < nearest[place]:
            if place < last:
                nearest[place + 1] = nearest[place]
            nearest[place] = distance
            place -= 1
    margin: float = nearest[last]
    return margin


@njit(cache=True)
def _gap_to_box(box: Array, x: float, y: float) -> float:
    """Measure how far (x, y) is from a box (2, 2), least x, y first [m]; inside -inf."""
    dx = max(box[0, 0] - x, x - box[1, 0], 0.0)
    dy = max(box[0, 1] - y, y - box[1, 1], 0.0)
    return np.hypot(dx, dy) if dx > 0.0 or dy > 0.0 else -np.inf
