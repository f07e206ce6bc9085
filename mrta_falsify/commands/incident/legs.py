"""Where the robots of a log were going, leg by leg: as told, or derived from where they went."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import LineString
from shapely.strtree import STRtree

from mrta_falsify.core.arrays import Array, frozen_array
from mrta_falsify.core.shapes import polygons
from mrta_falsify.core.world import World
from simulator_interface.formats.fleet_log import FleetLog, RobotLog

SAME_PLACE = 0.5  # m between goals that are one
ARRIVED = 0.6  # m from a goal, as the deadlock oracle has it
HALTS_WITHIN = 0.15  # m: a robot that stays within this halts
HALTS_FOR = 5.0  # s, from then on a halt is a stop
HELD_FOR = 15.0  # s; a halt to the end of the log, this long and beside another one, is no stop
BESIDE = 2.5  # m between robots that may hold each other
AWAY = 1.0  # m from its last stop; a robot that the log leaves there was going somewhere
AHEAD = 5.0  # m straight ahead, where nothing else tells the goal
LOOKED_EVERY = 0.25  # s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leg:
    """A robot is on its way to a goal from ``begin`` on, until the next leg."""

    begin: float  #: [s]
    goal: Array  #: (2,) [m]
    origin: str  #: told, path, went there, last seen, guessed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Halt:
    begin: float  #: [s]
    end: float  #: [s]
    place: Array  #: (2,) [m]


def legs_of(log: FleetLog, floor: World) -> tuple[tuple[Leg, ...], ...]:
    """Find the legs of every robot.

    Goals that the log tells count, then the ends of paths. Without either, every halt of 5 s is a
    goal, and where a robot was last seen on its way. A robot that halts beside another one until
    the log ends may be held. Its goal is then where robots went from its last stop before, else
    straight ahead.

    Args:
        log: of the fleet.
        floor: walls, for what is ahead.
    """
    halts = [_halts(robot, log.duration) for robot in log.robots]
    solids = STRtree(polygons(floor.solid_polygons()))
    known = [(stops[k].place, stops[k + 1].place) for stops in halts for k in range(len(stops) - 1)]
    found = []
    for number, robot in enumerate(log.robots):
        told = [(time, goal, "told") for time, goal in robot.goals]
        told = told or [(time, path[-1], "path") for time, path in robot.paths]
        if told:
            found.append(_merged(told))
            continue
        held = _is_held(number, halts, log)
        found.append(_derived(robot, halts[number], held=held, known=known, solids=solids))
    return tuple(found)


def _merged(told: list[tuple[float, Array, str]]) -> tuple[Leg, ...]:
    legs: list[Leg] = []
    for time, goal, origin in told:
        if legs and math.dist(goal, legs[-1].goal) <= SAME_PLACE:
            continue
        legs.append(Leg(begin=max(time, 0.0), goal=frozen_array(goal), origin=origin))
    return tuple(legs)


def _halts(robot: RobotLog, until: float) -> list[_Halt]:
    """List the halts of a robot; where it is at first is one, however short.

    Once its poses fall silent it stands, until the log ends at ``until`` [s].
    """
    times = np.arange(0.0, until + LOOKED_EVERY, LOOKED_EVERY)
    places = robot.at(times)[:, :2]
    found: list[_Halt] = []
    first = 0
    for k in range(1, len(times) + 1):
        if k < len(times) and math.dist(places[k], places[first]) <= HALTS_WITHIN:
            continue
        begin, end = float(times[first]), float(times[k - 1])
        if end - begin >= HALTS_FOR or not found:
            place = places[first] if not found else places[k - 1]
            found.append(_Halt(begin=begin, end=end, place=frozen_array(place)))
        first = k
    return found


def _is_held(number: int, halts: list[list[_Halt]], log: FleetLog) -> bool:
    last = halts[number][-1]
    if log.duration - last.begin < HELD_FOR or last.end < log.duration - 1.0:
        return False
    return any(
        other != number
        and log.duration - stops[-1].begin >= HELD_FOR
        and math.dist(stops[-1].place, last.place) <= BESIDE
        for other, stops in enumerate(halts)
    )


def _derived(
    robot: RobotLog,
    halts: list[_Halt],
    *,
    held: bool,
    known: list[tuple[Array, Array]],
    solids: STRtree,
) -> tuple[Leg, ...]:
    legs = [
        Leg(begin=before.end, goal=stop.place, origin="went there")
        for before, stop in itertools.pairwise(halts)
    ]
    if held and legs:
        origin, last = halts[-2].place, halts[-1]
        begin = legs.pop().begin
        goal = _seen_before(origin, last.place, known)
        if goal is None:
            goal = _straight_ahead(robot, last, solids)
        legs.append(Leg(begin=begin, goal=goal, origin="guessed"))
    seen = robot.pose[-1, :2]
    if not held and math.dist(seen, halts[-1].place) > AWAY:
        legs.append(Leg(begin=halts[-1].end, goal=frozen_array(seen), origin="last seen"))
    return tuple(legs)


def _seen_before(origin: Array, here: Array, known: list[tuple[Array, Array]]) -> Array | None:
    """Find where robots went from a place, other than ``here``; the latest of a robot's ways."""
    for start, end in reversed(known):
        if math.dist(start, origin) <= SAME_PLACE and math.dist(end, here) > BESIDE:
            return end
    return None


def _straight_ahead(robot: RobotLog, halt: _Halt, solids: STRtree) -> Array:
    """Find the farthest free place on the way that the robot was driving."""
    before = robot.at(np.array([halt.begin - 2.0]))[0]
    way = halt.place - before[:2]
    if np.hypot(*way) < HALTS_WITHIN:
        yaw = float(robot.at(np.array([halt.begin]))[0, 2])
        way = np.array([math.cos(yaw), math.sin(yaw)])
    way = way / np.hypot(*way)
    reach = AHEAD
    line = LineString([halt.place, halt.place + AHEAD * way])
    for k in solids.query(line, predicate="intersects"):
        reach = min(reach, float(shapely.distance(solids.geometries[k], line.interpolate(0.0))))
    return frozen_array(halt.place + max(reach - 0.5, ARRIVED + 0.2) * way)
