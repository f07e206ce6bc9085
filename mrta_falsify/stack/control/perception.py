"""What the fleet knows of itself at a tick: who is where, who decides with whom, who leads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.protocols import ControlView
from mrta_falsify.stack.control.grouping import connected_clusters, elect_leaders, precedence
from mrta_falsify.stack.control.state import Memory, remember_points, track_robots

AT_REST = 0.05  # m/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """The fleet at one tick."""

    pose: Array  #: (N, 3) as last heard, then extrapolated; the view's own if all are heard
    speed: Array  #: (N,) the same for the forward speed [m/s]
    points: Array  #: (N, S, 2) obstacle points seen lately [m], inf: none
    seen_at: Array  #: (N, S) when [s]
    wants: BoolArray  #: (N,) has somewhere to go
    cluster: IntArray  #: (N,) smallest robot number of the robot's cluster
    leader: IntArray  #: (N,) robot that decides for this one
    order: IntArray  #: (N,) robot numbers, the one that goes first in front
    joint: BoolArray  #: (N,) takes part in the joint decision
    hold: BoolArray  #: (N,) lost its leader a moment ago: repeats the last command
    halted: BoolArray  #: (N,) brakes for want of a link
    on_its_own: BoolArray  #: (N,) lost its leader, controls itself alone


def survey_fleet(
    view: ControlView,
    memory: Memory,
    *,
    neighbour_distance: float,
    obstacle_memory: float,
    command_lifetime: float,
) -> Survey:
    """The fleet as its states, rays and links show it.

    Args:
        view: what the controller is told.
        memory: of the tick before.
        neighbour_distance: two robots nearer than this are neighbours [m].
        obstacle_memory: seen points are kept so long [s].
        command_lifetime: a remote command is repeated so long after the link is lost [s].
    """
    same, pose, speed, points, seen_at, claims, numbers = _survey(
        view.time,
        view.dt,
        view.pose,
        view.velocity,
        view.target,
        view.active,
        view.present,
        view.rank,
        view.obstacle_points,
        view.states_link,
        view.leader_link,
        view.max_acceleration,
        memory.pose,
        memory.speed,
        memory.point,
        memory.seen_at,
        memory.demoted_until,
        memory.remote_at,
        memory.on_its_own,
        memory.tick == 0,
        neighbour_distance,
        obstacle_memory,
        command_lifetime,
    )
    wants, joint, hold, halted, on_its_own = claims
    cluster, leader, order = numbers
    return Survey(
        pose=view.pose if same else pose,
        speed=speed,
        points=points,
        seen_at=seen_at,
        wants=wants,
        cluster=cluster,
        leader=leader,
        order=order,
        joint=joint,
        hold=hold,
        halted=halted,
        on_its_own=on_its_own,
    )


@njit(cache=True)
def _survey(
    time: float,
    dt: float,
    pose: Array,
    velocity: Array,
    target: Array,
    active: BoolArray,
    present: BoolArray,
    rank: IntArray,
    hits: Array,
    states_link: BoolArray,
    leader_link: BoolArray,
    max_acceleration: Array,
    last_pose: Array,
    last_speed: Array,
    last_point: Array,
    last_seen_at: Array,
    demoted_until: Array,
    remote_at: Array,
    was_on_its_own: BoolArray,
    is_first: bool,
    neighbour_distance: float,
    obstacle_memory: float,
    command_lifetime: float,
) -> tuple[bool, Array, Array, Array, Array, BoolArray, IntArray]:
    """Whether the poses are those of the view, then the first four fields of :class:`Survey`.

    The others come in two arrays, because each that leaves compiled code costs as much as
    filling ten: ``wants``, ``joint``, ``hold``, ``halted``, ``on_its_own`` ``(5, N)`` and
    ``cluster``, ``leader``, ``order`` ``(3, N)``.
    """
    n = pose.shape[0]
    claims, numbers = np.empty((5, n), dtype=np.bool_), np.empty((3, n), dtype=np.int64)
    wants, joint = claims[0], claims[1]
    heard, demoted = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    there, busy = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    speed = np.empty(n)
    same = True
    for i in range(n):
        heard[i] = present[i] and states_link[i]
        joint[i] = heard[i] and leader_link[i]
        there[i] = heard[i] or is_first
        same = same and there[i]
        wants[i] = present[i] and np.isfinite(target[i, 0])
        busy[i] = active[i] and present[i]
        demoted[i] = demoted_until[i] > time
        speed[i] = velocity[i, 0]
    known_pose, known_speed = track_robots(
        pose, speed, last_pose, last_speed, there, max_acceleration, dt
    )
    position = np.empty((n, 2))
    for i in range(n):
        position[i, 0], position[i, 1] = known_pose[i, 0], known_pose[i, 1]
    points, seen_at = remember_points(
        last_point, last_seen_at, hits, position, present, time, obstacle_memory
    )
    key = precedence(busy, wants, demoted, rank)
    cluster = connected_clusters(position, heard, neighbour_distance)
    numbers[0] = cluster
    numbers[1] = elect_leaders(cluster, joint, active, key)
    numbers[2] = _sorted_by(key)
    claims[2:] = _without_leader(
        velocity,
        present,
        states_link,
        leader_link,
        remote_at,
        was_on_its_own,
        time,
        command_lifetime,
    )
    return same, known_pose, known_speed, points, seen_at, claims, numbers


@njit(cache=True)
def _without_leader(
    velocity: Array,
    present: BoolArray,
    states_link: BoolArray,
    leader_link: BoolArray,
    remote_at: Array,
    was_on_its_own: BoolArray,
    time: float,
    command_lifetime: float,
) -> BoolArray:
    """Robots ``(3, N)`` that repeat their last command, that brake, that control themselves.

    A robot that was led repeats its last command for a while, then brakes, and once at rest
    goes on by itself; one that led itself does so at once.
    """
    n = present.shape[0]
    hold_brake_alone = np.zeros((3, n), dtype=np.bool_)
    for i in range(n):
        if present[i] and not leader_link[i]:
            followed = np.isfinite(remote_at[i])
            hold = followed and time - remote_at[i] <= command_lifetime + 1e-9
            alone = was_on_its_own[i] or not followed or abs(velocity[i, 0]) < AT_REST
            hold_brake_alone[0, i] = hold
            hold_brake_alone[1, i] = not hold and not alone
            hold_brake_alone[2, i] = not hold and alone
        if present[i] and not states_link[i]:
            hold_brake_alone[1, i] = True
    return hold_brake_alone


@njit(cache=True)
def _sorted_by(key: IntArray) -> IntArray:
    """Robot numbers ``(N,)`` by ascending key; keys differ (insertion sort, N is small)."""
    n = key.shape[0]
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        place = i
        while place > 0 and key[order[place - 1]] > key[i]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = i
    return order
