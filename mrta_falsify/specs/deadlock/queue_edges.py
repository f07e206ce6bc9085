"""Edges of robots that wait for a resource: who is ahead of them, or keeps them out."""

from __future__ import annotations

import numpy as np

from mrta_falsify.core.fleet import BlockedBy
from mrta_falsify.core.plane import inside
from mrta_falsify.specs.deadlock.goals import Goal, are_inside, inside_each
from mrta_falsify.specs.deadlock.service_clock import AT_GOAL
from mrta_falsify.specs.deadlock.snapshot import Claim, FleetSnapshot


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


def _users(fleet: FleetSnapshot, number: int) -> dict[Claim, list[int]]:
    """Sort the robots by how they use the resource ``number``; to wait for it is not to use it."""
    resource, position = fleet.world.resources[number], fleet.position
    aims = [goal.kind if goal and goal.resource == number else "" for goal in fleet.goal]
    waits, heads_in = np.array([(kind == "spot", kind == "room") for kind in aims]).T
    is_in = are_inside(fleet.world, resource, position) & ~waits
    outside = ~is_in & ~waits
    near = inside_each(np.asarray(resource.release_area), position)
    leaving = (outside & near & ~heads_in).nonzero()[0].tolist()
    return {
        "inside": is_in.nonzero()[0].tolist(),
        "entering": (outside & near & heads_in).nonzero()[0].tolist(),
        "coming": (outside & ~near & heads_in).nonzero()[0].tolist(),
        "leaving": [j for j in leaving if not fleet.is_idle(j)],
    }
