"""What the verdict of the deadlock oracle shows of a deadlock."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.deadlock.goals import GoalMap
from mrta_falsify.specs.deadlock.place_kind import kind_of_place
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot


@dataclass(frozen=True, slots=True, kw_only=True)
class Deadlock:
    """A set of robots that waits for itself for good."""

    knot: EdgesByRobot  #: edges of each member
    victims: frozenset[int]  #: robots that wait for the members
    onset: float  #: when the last member stopped [s]
    hard: bool  #: no member has a way round the others
    confirmed: bool  #: by a forecast, not by patience

    @property
    def members(self) -> tuple[int, ...]:
        """Robots without any of whom the others would go free, sorted."""
        return tuple(self.knot)

    @property
    def robots(self) -> frozenset[int]:
        """Members and victims."""
        return self.victims | set(self.knot)


def deadlock_evidence(
    deadlock: Deadlock, stuck: Collection[int], world: World, frame: Frame
) -> dict[str, Any]:
    """Describe a deadlock for its verdict, JSON-shaped.

    Args:
        deadlock: found at this moment.
        stuck: robots that the reduction of the wait-for graph leaves over.
        world: of the episode.
        frame: of the moment.
    """
    names = [robot.name for robot in world.robots]
    shown = [edge for own in deadlock.knot.values() for edge in own]
    others = {edge.other for edge in shown if edge.cause != "human"}
    blockers = others - set(stuck) - deadlock.robots - {-1}
    stand = frame.sensed.pose[list(deadlock.members), :2]
    place = stand.mean(axis=0)
    near, distance = GoalMap(world).nearest_name(place)
    return {
        "members": [names[i] for i in deadlock.members],
        "cycle": [_shown_edge(edge, world) for edge in shown],
        "victims": [names[i] for i in sorted(deadlock.victims)],
        "blockers": sorted(names[i] for i in blockers),
        "place": {
            "x": float(place[0]),
            "y": float(place[1]),
            "near": near,
            "distance": distance,
            "kind": kind_of_place(world, stand),
        },
        "onset": deadlock.onset,
        "detected_at": frame.sensed.time,
        "hard": deadlock.hard,
        "confirmed": deadlock.confirmed,
    }


def _shown_edge(edge: BlockedBy, world: World) -> dict[str, str]:
    other = ""
    if edge.other >= 0:
        blockers = world.humans if edge.cause == "human" else world.robots
        other = blockers[edge.other].name
    return {
        "robot": world.robots[edge.robot].name,
        "cause": edge.cause,
        "blocked_by": other,
        "resource": edge.resource,
    }
