"""Edges of robots that nothing stands before: who has what they wait for.

A stack may let robots wait for an area that nobody is in, as one that locks areas does. The
geometry shows no reason then. What the stack tells is asked instead: for whom or for what a robot
waits, and who was granted an area. It only explains robots that stand anyway; whether they stand
for good, the run shows.
"""

from __future__ import annotations

from collections.abc import Iterable

from mrta_falsify.core.fleet import BlockedBy, StackEvent
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import Resource, World
from mrta_falsify.specs.deadlock.path_ahead import points_ahead
from mrta_falsify.specs.deadlock.snapshot import FleetSnapshot

AHEAD = 3.0  # m of path ahead on which an area is asked for
STEP = 0.2  # m between points looked at


class Locks:
    """Who has which area, as the stack tells; one object per episode."""

    def __init__(self, world: World) -> None:
        self._resources = {resource.name: resource for resource in world.resources}
        self._robots = {robot.name: i for i, robot in enumerate(world.robots)}
        self._holders: dict[str, list[int]] = {name: [] for name in self._resources}

    def update(self, events: Iterable[StackEvent]) -> None:
        """Take in what was granted and released in a tick."""
        for event in events:
            holders = self._holders.get(event.resource)
            if holders is None or event.kind not in ("granted", "released"):
                continue
            if event.robot in holders:
                holders.remove(event.robot)
            if event.kind == "granted":
                holders.append(event.robot)
                # Not every stack tells that an area was released.
                del holders[: -self._resources[event.resource].capacity]

    def edges(self, fleet: FleetSnapshot, i: int) -> list[BlockedBy]:
        """Derive the edges of robot ``i``; empty: nobody has what it waits for."""
        told = fleet.intent.waits_for[i]
        other = self._robots.get(told, i)
        if other != i:
            return [BlockedBy(i, "queue", other)]
        for resource in self._wanted(fleet, i, told):
            others = [j for j in self._holders[resource.name] if j != i]
            if len(others) >= resource.capacity:
                return [BlockedBy(i, "queue", j, resource.name) for j in others]
        return []

    def _wanted(self, fleet: FleetSnapshot, i: int, told: str) -> list[Resource]:
        """List what robot ``i`` may wait for: what it tells, else areas ahead that it has not.

        Of rooms only the one that it goes to; it passes the others by.
        """
        if told in self._resources:
            return [self._resources[told]]
        open_ = [name for name, holders in self._holders.items() if holders and i not in holders]
        if not open_:
            return []
        x, y = fleet.position[i]
        ahead = points_ahead(fleet.way(i), x, y, AHEAD, STEP)
        goal = fleet.goal[i]
        resources = fleet.world.resources
        own = resources[goal.resource].name if goal is not None and goal.resource >= 0 else ""
        areas = [self._resources[name] for name in open_]
        return [
            area
            for area in areas
            if (area.room is None or area.name == own)
            and any(inside(area.release_area, at) for at in ahead)
        ]
