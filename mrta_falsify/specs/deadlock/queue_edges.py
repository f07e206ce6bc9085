"""Edges of robots that wait for a resource: who is ahead of them, or keeps them out."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import Resource
from mrta_falsify.specs.deadlock.goals import Goal, is_inside
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL
from mrta_falsify.specs.deadlock.snapshot import FleetSnapshot

Claim = Literal["inside", "entering", "coming", "leaving", "none"]


def queue_edges(fleet: FleetSnapshot, i: int, goal: Goal) -> list[BlockedBy]:
    """Derive edges of robot ``i`` at its waiting spot: to the next one ahead, else occupants."""
    resource = fleet.world.resources[goal.resource]
    ahead = [
        (other.spot, j)
        for j, other in enumerate(fleet.goal)
        if j != i
        and other is not None
        and other.kind == "spot"
        and other.resource == goal.resource
        and other.spot < goal.spot
    ]
    if ahead:
        return [BlockedBy(i, "queue", max(ahead)[1], resource.name)]
    return [BlockedBy(i, "queue", j, resource.name) for j in _occupants(fleet, i, goal)]


def queue_edges_from_afar(fleet: FleetSnapshot, i: int, goal: Goal) -> list[BlockedBy]:
    """Derive the edges of a robot that waits outside a queue that is full or has no spots."""
    resource = fleet.world.resources[goal.resource]
    position = fleet.position
    near = inside(resource.request_area, position[i]) or inside(resource.release_area, position[i])
    if not near:
        return []
    if goal.kind == "spot":
        spot = resource.spots[goal.spot]
        taken = np.hypot(*(position - spot).T) <= AT_GOAL
        taken[i] = False
        return [BlockedBy(i, "queue", int(j), resource.name) for j in taken.nonzero()[0]]
    target = fleet.intent.goal[i]
    own = float(np.hypot(*(position[i] - target)))
    return [
        BlockedBy(i, "queue", j, resource.name)
        for j in _occupants(fleet, i, goal)
        if np.hypot(*(position[j] - target)) < own
    ]


def _occupants(fleet: FleetSnapshot, i: int, goal: Goal) -> list[int]:
    """Find who keeps robot ``i`` out: who is inside or enters, else who leaves, else who comes."""
    if goal.resource not in fleet.users:
        fleet.users[goal.resource] = _users(fleet, goal.resource)
    users = {claim: [j for j in by if j != i] for claim, by in fleet.users[goal.resource].items()}
    return users["inside"] + users["entering"] or users["leaving"] or users["coming"]


def _users(fleet: FleetSnapshot, number: int) -> dict[str, list[int]]:
    """Sort the robots by how they use the resource ``number``."""
    resource = fleet.world.resources[number]
    users: dict[str, list[int]] = {claim: [] for claim in get_args(Claim)}
    for j, position in enumerate(fleet.position):
        users[_claim(fleet, j, position, number, resource)].append(j)
    return users


def _claim(fleet: FleetSnapshot, j: int, position: Array, number: int, resource: Resource) -> Claim:
    """Tell how robot ``j`` uses the resource ``number``; to wait for it is not to use it."""
    goal = fleet.goal[j]
    if goal is not None and goal.kind == "spot" and goal.resource == number:
        return "none"
    heads_in = goal is not None and goal.kind == "room" and goal.resource == number
    near = inside(resource.release_area, position)
    if is_inside(fleet.world, resource, position):
        return "inside"
    if heads_in:
        return "entering" if near else "coming"
    return "leaving" if near and not fleet.is_idle(j) else "none"
