"""What a controller remembers between ticks: one record a robot, and the points they saw.

Plain arrays, so that a stack can be copied, hashed and forked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.core.world import CRUISE
from mrta_falsify.stack.control.obstacles import People

SECTORS = 36  #: directions in which a seen point is kept, 10 degrees each
RANGE = 3.0  # m, farther points never matter: a robot stops within 1.5 m
SAME_POINT = 0.15  # m, a new hit this near an old point of its sector replaces it
NO_PLACES = Polylines.of([])
BODY = 0.28  # m, points this near another robot's centre are that robot
MET = RANGE + BODY  # m, a robot farther than this has no point on it that another one keeps

#: one record a robot; it has no padding, so that equal states have equal bytes
ROBOT_RECORD = np.dtype(
    (
        np.record,
        np.dtype(
            [
                # told by the view; while the robot is not heard, extrapolated
                ("pose", np.float64, (3,)),  # x [m], y [m], yaw [rad], map frame
                ("speed", np.float64),  # forward [m/s]
                # told by the view
                ("target", np.float64, (2,)),  # look-ahead point [m], nan: nowhere to go
                ("max_speed", np.float64),  # [m/s]
                ("cruise", np.float64),  # speed if nothing is in the way [m/s]
                ("max_acceleration", np.float64),  # [m/s^2]
                # remembered
                ("anchor", np.float64, (2,)),  # where it last counted as making progress [m]
                ("anchor_at", np.float64),  # when [s]
                ("demoted_until", np.float64),  # its lead is suspended until then [s]
                ("remote_at", np.float64),  # of its last remote command [s], -inf: leads itself
                ("twist", np.float64, (3,)),  # last command: forward, left [m/s], turn [rad/s]
                # decided
                ("cluster", np.int64),  # smallest robot number of its cluster
                ("leader", np.int64),  # robot that decides for this one
                # told by the view
                ("active", np.bool_),  # has a task and does not wait in a queue
                ("present", np.bool_),  # has joined
                ("heard", np.bool_),  # present, and its state is known to the others
                # decided
                ("wants", np.bool_),  # has somewhere to go
                ("joint", np.bool_),  # takes part in the joint decision
                ("hold", np.bool_),  # lost its leader a moment ago: repeats the last command
                ("halted", np.bool_),  # brakes for want of a link
                ("on_its_own", np.bool_),  # lost its leader, controls itself alone
            ],
            align=True,
        ),
    )
)
Crew = NDArray[np.void]  #: (N,) of ROBOT_RECORD


class CrewView(NamedTuple):
    """What a :class:`ControlView` says, but for paths, for compiled code."""

    time: float  #: [s]
    dt: float  #: control period [s]
    pose: Array  #: (N, 3)
    velocity: Array  #: (N, 3)
    target: Array  #: (N, 2)
    active: BoolArray  #: (N,)
    present: BoolArray  #: (N,)
    rank: IntArray  #: (N,)
    states_link: BoolArray  #: (N,)
    leader_link: BoolArray  #: (N,)
    max_speed: Array  #: (N,)
    max_acceleration: Array  #: (N,)
    cruise: Array  #: (N,)
    obstacle_points: Array  #: (N, A, 2)
    human_position: Array  #: (H, 2)
    human_velocity: Array  #: (H, 2)
    human_radius: Array  #: (H,)
    shared_corner: Array  #: (sum V, 2)
    shared_first: IntArray  #: (A + 1,)
    closed: BoolArray  #: (N, A)


@njit(cache=True)
def people_in(sensed: CrewView) -> People:
    """Take the people from what is told."""
    return People(sensed.human_position, sensed.human_velocity, sensed.human_radius)


def crew_view(view: ControlView) -> tuple[Any, ...]:
    """Take from a view what compiled code needs: the fields of a :class:`CrewView`.

    A plain tuple enters compiled code in half the time of a named one.
    """
    n, places, closed = len(view.pose), view.shared_places, view.closed
    if places is None or closed is None:
        places, closed = NO_PLACES, np.empty((n, 0), dtype=np.bool_)
    return (
        view.time,
        view.dt,
        view.pose,
        view.velocity,
        view.target,
        view.active,
        view.present,
        view.rank,
        view.states_link,
        view.leader_link,
        view.max_speed,
        view.max_acceleration,
        np.full(n, CRUISE) if view.cruise is None else view.cruise,
        view.obstacle_points,
        view.human_position,
        view.human_velocity,
        view.human_radius,
        places.points,
        places.first,
        closed,
    )


@dataclass(slots=True, kw_only=True, eq=False)
class ControllerState:
    """State of a controller for N robots."""

    crew: Crew  #: (N,) of ROBOT_RECORD
    point: Array  #: (N, SECTORS, 2) nearest seen obstacle point per direction [m], inf: none
    seen_at: Array  #: (N, SECTORS) when [s]
    tick: int  #: ticks done

    @classmethod
    def fresh(cls, pose: Array, time: float) -> ControllerState:
        """Begin with robots at ``pose`` ``(N, 3)`` and nothing seen."""
        n = len(pose)
        crew = np.zeros(n, dtype=ROBOT_RECORD)
        crew["pose"] = pose
        crew["anchor"] = pose[:, :2]
        crew["anchor_at"] = time
        crew["demoted_until"] = -np.inf
        crew["remote_at"] = -np.inf
        return cls(
            crew=crew,
            point=np.full((n, SECTORS, 2), np.inf),
            seen_at=np.full((n, SECTORS), -np.inf),
            tick=0,
        )


@njit(cache=True)
def hear_robots(crew: Crew, sensed: CrewView, is_first: bool) -> bool:
    """Bring the crew to this tick; says whether all poses are those told.

    A robot that is no longer heard is taken to brake along its heading, as it does. At the
    first tick all poses are told.
    """
    all_heard = True
    for i in range(crew.shape[0]):
        robot = crew[i]
        robot.active, robot.present = sensed.active[i], sensed.present[i]
        robot.heard = sensed.present[i] and sensed.states_link[i]
        robot.max_speed = sensed.max_speed[i]
        robot.cruise = min(sensed.max_speed[i], sensed.cruise[i])
        robot.max_acceleration = sensed.max_acceleration[i]
        robot.target[0], robot.target[1] = sensed.target[i, 0], sensed.target[i, 1]
        if robot.heard or is_first:
            for c in range(3):
                robot.pose[c] = sensed.pose[i, c]
            robot.speed = sensed.velocity[i, 0]
            continue
        all_heard = False
        v = robot.speed
        robot.pose[0] += v * sensed.dt * np.cos(robot.pose[2])
        robot.pose[1] += v * sensed.dt * np.sin(robot.pose[2])
        step = robot.max_acceleration * sensed.dt
        robot.speed = max(v - step, 0.0) if v >= 0.0 else min(v + step, 0.0)
    return all_heard


@njit(cache=True)
def _sector_of(dx: float, dy: float, sectors: int) -> int:
    """Number the direction (dx, dy)."""
    return int((np.arctan2(dy, dx) + np.pi) / (2.0 * np.pi) * sectors) % sectors


@njit(cache=True)
def _is_on_another(
    i: int, x: float, y: float, position: Array, known: BoolArray, near: Neighbours
) -> bool:
    """Whether (x, y) is on the body of a robot other than ``i``."""
    for m in range(near.first[i], near.first[i + 1]):
        j = near.number[m]
        if known[j]:
            dx, dy = x - position[j, 0], y - position[j, 1]
            if dx * dx + dy * dy < BODY * BODY:
                return True
    return False


@njit(cache=True)
def remember_points(
    point: Array,
    seen_at: Array,
    hits: Array,
    position: Array,
    known: BoolArray,
    now: float,
    horizon: float,
    near: Neighbours,
) -> tuple[Array, Array]:
    """Keep seen points: twelve rays miss corners that a moving robot's rays swept before.

    Args:
        point: ``(N, SECTORS, 2)`` remembered points [m], map frame.
        seen_at: ``(N, SECTORS)`` [s].
        hits: ``(N, A, 2)`` this tick's ray hits [m], inf: none.
        position: ``(N, 2)`` robots [m]; further columns are not read.
        known: ``(N,)`` robots whose position the others know; hits on them are left out.
        now: [s].
        horizon: older points are forgotten [s].
        near: robots within ``MET`` or farther.
    """
    n, sectors = seen_at.shape
    new_point = np.full((n, sectors, 2), np.inf)
    new_seen = np.full((n, sectors), -np.inf)
    nearest = np.empty(sectors)
    for i in range(n):
        x, y = position[i, 0], position[i, 1]
        for k in range(sectors):
            nearest[k] = RANGE
        for k in range(sectors):
            px, py = point[i, k, 0], point[i, k, 1]
            if now - seen_at[i, k] > horizon or not np.isfinite(px):
                continue
            dx, dy = px - x, py - y
            distance = np.sqrt(dx * dx + dy * dy)
            sector = _sector_of(dx, dy, sectors)
            if distance < nearest[sector]:
                nearest[sector] = distance
                new_point[i, sector, 0], new_point[i, sector, 1] = px, py
                new_seen[i, sector] = seen_at[i, k]
        for k in range(hits.shape[1]):
            px, py = hits[i, k, 0], hits[i, k, 1]
            if not (np.isfinite(px) and np.isfinite(py)):
                continue
            dx, dy = px - x, py - y
            distance = np.sqrt(dx * dx + dy * dy)
            if distance >= RANGE or _is_on_another(i, px, py, position, known, near):
                continue
            sector = _sector_of(dx, dy, sectors)
            old_x, old_y = new_point[i, sector, 0], new_point[i, sector, 1]
            same = (old_x - px) ** 2 + (old_y - py) ** 2 < SAME_POINT * SAME_POINT
            if same or distance < nearest[sector]:
                nearest[sector] = distance
                new_point[i, sector, 0], new_point[i, sector, 1] = px, py
                new_seen[i, sector] = now
    return new_point, new_seen
