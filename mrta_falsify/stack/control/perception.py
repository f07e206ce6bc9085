"""What the fleet knows of itself at a tick: who decides with whom, who leads, who goes first."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.arrays import Array, IntArray
from mrta_falsify.core.compiled import njit
from mrta_falsify.core.neighbours import Neighbours
from mrta_falsify.stack.control.grouping import connected_clusters, elect_leaders, precedence
from mrta_falsify.stack.control.state import Crew, CrewView

AT_REST = 0.05  # m/s
ROUNDING = 1e-9  # s, ticks' times are sums of floats


@njit(cache=True)
def survey_crew(
    crew: Crew,
    sensed: CrewView,
    neighbour_distance: float,
    command_lifetime: float,
    position: Array,
    near: Neighbours,
) -> IntArray:
    """Decide for each robot with whom it decides, and who leads.

    Args:
        crew: robots as :func:`~mrta_falsify.stack.control.state.hear_robots` gives them; the
            decided fields are written.
        sensed: what the view says.
        neighbour_distance: two robots nearer than this are neighbours [m].
        command_lifetime: a remote command is repeated so long after the link is lost [s].
        position: ``(N, 2)`` of the crew [m].
        near: within ``neighbour_distance`` or farther.

    Returns:
        ``(N,)`` robot numbers, the one that goes first in front.
    """
    n = crew.shape[0]
    heard, joint = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    wants, busy = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    demoted = np.empty(n, dtype=np.bool_)
    for i in range(n):
        robot = crew[i]
        heard[i] = robot.heard
        joint[i] = robot.heard and sensed.leader_link[i]
        wants[i] = robot.present and np.isfinite(robot.target[0])
        busy[i] = robot.active and robot.present
        demoted[i] = robot.demoted_until > sensed.time
    key = precedence(busy, wants, demoted, sensed.rank)
    cluster = connected_clusters(position, heard, neighbour_distance, near)
    leader = elect_leaders(cluster, joint, sensed.active, key)
    for i in range(n):
        robot = crew[i]
        robot.wants, robot.joint = wants[i], joint[i]
        robot.cluster, robot.leader = cluster[i], leader[i]
        fill_link_loss(
            robot, sensed.velocity[i, 0], sensed.leader_link[i], sensed.time, command_lifetime
        )
    return np.argsort(key, kind="mergesort")


@njit(cache=True)
def fill_link_loss(
    robot: np.record, speed: float, leader_link: bool, time: float, command_lifetime: float
) -> None:
    """Decide whether a robot repeats its last command, brakes, or controls itself.

    A robot that was led and lost its leader repeats its last command for a while, then
    brakes, and once at rest goes on by itself; one that led itself does so at once. A robot
    that lost the others' states brakes.

    Args:
        robot: record whose ``hold``, ``halted`` and ``on_its_own`` are written.
        speed: forward, as the robot itself measures it [m/s].
        leader_link: whether it can send and receive remote commands.
        time: [s].
        command_lifetime: [s].
    """
    hold, halted, alone = False, False, False
    if robot.present and not leader_link:
        followed = np.isfinite(robot.remote_at)
        hold = followed and time - robot.remote_at <= command_lifetime + ROUNDING
        free = robot.on_its_own or not followed or abs(speed) < AT_REST
        halted = not hold and not free
        alone = not hold and free
    if robot.present and not robot.heard:
        halted = True
    robot.hold, robot.halted, robot.on_its_own = hold, halted, alone
