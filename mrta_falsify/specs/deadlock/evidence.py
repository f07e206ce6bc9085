"""What the verdict of the deadlock oracle shows of a deadlock."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mrta_falsify.core import codec
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.claims import ClaimKind
from mrta_falsify.core.directives import Push
from mrta_falsify.core.fleet import BlockedBy, Frame
from mrta_falsify.core.world import Blockage, World
from mrta_falsify.specs.deadlock.goals import GoalMap
from mrta_falsify.specs.deadlock.obstruction import PATH_STEP, PULL_REACH, SOLID_CONE, SOLID_NEAR
from mrta_falsify.specs.deadlock.path_ahead import points_ahead
from mrta_falsify.specs.deadlock.place_kind import kind_of_place
from mrta_falsify.specs.deadlock.wait_graph import EdgesByRobot

PUSHING_REACH = 2.0  # m from a person's centre to the centre of a piece that the person pushes

ObjectKind = Literal["furniture", "person", "blockage", "wall"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deadlock:
    """A set of robots that waits for itself for good."""

    members: tuple[int, ...]  #: who hold each other, and whom no other robot holds
    victims: tuple[int, ...]  #: robots that wait for the members
    edges: EdgesByRobot  #: of the wait-for graph, once the deadlock had settled
    onsets: Mapping[int, float]  #: since when each member has made no progress [s]
    confirmed: bool  #: by a continuation

    @property
    def robots(self) -> frozenset[int]:
        """Members and victims."""
        return frozenset({*self.members, *self.victims})

    def awaited(self) -> frozenset[int]:
        """Find the robots that a member or a victim waits for, by its own edges."""
        own = [edge for i in self.robots for edge in self.edges.get(i, ())]
        return frozenset(edge.other for edge in own if edge.cause != "human" and edge.other >= 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeRow:
    """Who waits for whom, by name."""

    robot: str
    cause: str  #: of the blocked-by edge
    blocked_by: str  #: robot or person, empty: none
    resource: str  #: queue, solid or blockage, empty: none
    seen: bool = True  #: geometry shows it when the claim is made; else a continuation does


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectRow:
    """A thing or a person that takes part in a deadlock."""

    name: str
    kind: ObjectKind
    carried_by: str = ""  #: the person who pushes it, empty: none


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceRow:
    """Where a deadlock is, or one of its members."""

    x: float  #: [m]
    y: float  #: [m]
    near: str  #: room or queue
    distance: float  #: to it [m]
    kind: str  #: of place, see :mod:`mrta_falsify.specs.deadlock.place_kind`


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadlockEvidence:
    """What is shown of a deadlock."""

    members: tuple[str, ...]  #: first by onset first
    root: str  #: the first of them
    onsets: dict[str, float]  #: since when each member has made no progress [s]
    victims: tuple[str, ...]  #: robots that wait for members
    blockers: tuple[str, ...]  #: robots outside the deadlock that members wait for
    cycle: tuple[EdgeRow, ...]  #: edges of the members
    #: edges of the victims that stand already, and of robots in the way that cannot go on
    chain: tuple[EdgeRow, ...]
    objects: tuple[ObjectRow, ...]  #: things and people on those edges
    place: PlaceRow  #: the mean of the members' places
    onset: float  #: since when no member has made progress [s]
    detected_at: float  #: [s]
    confirmed: bool  #: by a continuation; else it is only suspected
    kind: ClaimKind = "stuck"
    shut_room: str = ""  #: room or place that was shut, of kind ``shut``
    shut_by: tuple[str, ...] = ()  #: things and people that shut it
    shut_since: float | None = None  #: [s]
    stands_for: float | None = None  #: for which a continuation showed members standing [s]
    for_good: bool = False  #: proven
    #: edges of the members as geometry showed them, before removals corrected them
    cycle_seen: tuple[EdgeRow, ...] = ()
    members_alone: tuple[str, ...] = ()  #: as removals alone tell them, where that differs
    places: dict[str, PlaceRow] = dataclasses.field(default_factory=dict)  #: of each member then

    def encoded(self, others: Iterable[DeadlockEvidence] = ()) -> dict[str, Any]:
        """Give the evidence of a verdict, JSON-shaped, with further deadlocks in ``others``."""
        rows: dict[str, Any] = codec.encode(self)
        return {**rows, "others": [codec.encode(other) for other in others]}


@dataclass(frozen=True, slots=True, kw_only=True)
class Contradiction:
    """A claim that the run itself refuted, and that was withdrawn."""

    members: tuple[str, ...]
    kind: ClaimKind
    claimed_at: float  #: [s]
    refuted_at: float  #: when one of the members went on [s]
    robot: str  #: that member


def describe(deadlock: Deadlock, world: World, frame: Frame, now: EdgesByRobot) -> DeadlockEvidence:
    """Describe a deadlock for its verdict.

    Args:
        deadlock: found at this moment.
        world: of the episode.
        frame: of the moment.
        now: edges of the wait-for graph at this moment, as geometry shows them.
    """

    def row(edge: BlockedBy) -> EdgeRow:
        seen = edge.other < 0 or any(_is_same(edge, other) for other in now.get(edge.robot, ()))
        named = _named(_edge_row(edge, world), edge, world, frame)
        return dataclasses.replace(named, seen=seen)

    names = [robot.name for robot in world.robots]
    members = sorted(deadlock.members, key=lambda i: (deadlock.onsets[i], i))
    cycle = [edge for i in sorted(members) for edge in deadlock.edges.get(i, ())]
    behind = [*sorted(deadlock.victims), *sorted(deadlock.awaited() - deadlock.robots)]
    chain = [e for i in behind for e in deadlock.edges.get(i, ()) if e.cause != "task"]
    others = {edge.other for edge in cycle if edge.cause != "human"}
    stand = frame.sensed.pose[members, :2]
    return DeadlockEvidence(
        members=tuple(names[i] for i in members),
        root=names[members[0]],
        onsets={names[i]: deadlock.onsets[i] for i in members},
        victims=tuple(names[i] for i in sorted(deadlock.victims)),
        blockers=tuple(sorted(names[i] for i in others - deadlock.robots - {-1})),
        cycle=tuple(map(row, cycle)),
        chain=tuple(map(row, chain)),
        objects=_objects((*cycle, *chain), world, frame),
        place=_place(stand, world),
        places={names[i]: _place(frame.sensed.pose[[i], :2], world) for i in members},
        onset=max(deadlock.onsets.values()),
        detected_at=frame.sensed.time,
        confirmed=deadlock.confirmed,
        kind="deadlock" if len(members) > 1 else "stuck",
    )


def _is_same(one: BlockedBy, other: BlockedBy) -> bool:
    """Whether two edges of a robot lead to the same robot or person."""
    return one.other == other.other and (one.cause == "human") == (other.cause == "human")


def _place(points: Array, world: World) -> PlaceRow:
    """Describe where the mean of ``points`` ``(N, 2)`` [m] lies."""
    middle = points.mean(axis=0)
    near, distance = GoalMap(world).nearest_name(middle)
    kind = kind_of_place(world, points)
    return PlaceRow(x=float(middle[0]), y=float(middle[1]), near=near, distance=distance, kind=kind)


def edge_rows(robots: Iterable[int], edges: EdgesByRobot, world: World) -> tuple[EdgeRow, ...]:
    """Write the edges of robots by name, sorted by robot."""
    return tuple(_edge_row(edge, world) for i in sorted(robots) for edge in edges.get(i, ()))


def _edge_row(edge: BlockedBy, world: World) -> EdgeRow:
    other = ""
    if edge.other >= 0:
        blockers = world.humans if edge.cause == "human" else world.robots
        other = blockers[edge.other].name
    robot = world.robots[edge.robot].name
    return EdgeRow(robot=robot, cause=edge.cause, blocked_by=other, resource=edge.resource)


def _named(row: EdgeRow, edge: BlockedBy, world: World, frame: Frame) -> EdgeRow:
    """Name the solid that holds a robot off, where geometry says only that one does.

    It is the nearest one ahead; nothing is on the robot's path.
    """
    if edge.cause != "wall" or edge.resource:
        return row
    from shapely import Point, Polygon  # noqa: PLC0415 - loads slowly
    from shapely.ops import nearest_points  # noqa: PLC0415

    x, y = place = frame.sensed.pose[edge.robot, :2]
    path, goal = frame.intent.path[edge.robot], frame.intent.goal[edge.robot]
    way = path if len(path) else goal[None]
    pull = points_ahead(way, x, y, PULL_REACH, PATH_STEP)[-1] - place
    away: dict[str, float] = {}
    for name, outline in _solids(world, frame).items():
        point = nearest_points(Polygon(outline), Point(place))[0]
        offset = np.array([point.x, point.y]) - place
        length = float(np.hypot(*offset))
        if length <= SOLID_NEAR and offset @ pull >= SOLID_CONE * length * np.hypot(*pull):
            away[name] = length
    nearest = min(away, key=lambda name: away[name], default="")
    return dataclasses.replace(row, resource=nearest) if nearest else row


def _solids(world: World, frame: Frame) -> dict[str, Array]:
    """List the outlines ``(V, 2)`` [m] of walls, furniture and blockages as they stand now."""
    found = {wall.name: wall.polygon for wall in world.walls}
    found |= {item.name: item.polygon for item in world.furniture if not item.movable}
    pieces, poses = world.movable_furniture(), frame.sensed.furniture_pose
    if len(pieces) == len(poses):
        found |= {
            item.name: item.outline_at(pose) for item, pose in zip(pieces, poses, strict=True)
        }
    time = frame.sensed.time
    return found | {
        event.name: event.polygon
        for event in world.events
        if isinstance(event, Blockage) and event.start <= time < event.end
    }


def _objects(edges: Iterable[BlockedBy], world: World, frame: Frame) -> tuple[ObjectRow, ...]:
    """List the things and people on ``edges``, and what those people push."""
    kinds: dict[str, ObjectKind] = {wall.name: "wall" for wall in world.walls}
    kinds |= {item.name: "furniture" for item in world.furniture}
    kinds |= {event.name: "blockage" for event in world.events if isinstance(event, Blockage)}
    pushed_by = {
        step.furniture: human.name
        for human in world.humans
        for step in human.directives
        if isinstance(step, Push)
    }
    found: dict[str, ObjectRow] = {}
    for edge in edges:
        if edge.cause == "human":
            person = world.humans[edge.other].name
            found[person] = ObjectRow(name=person, kind="person")
            things = _pushed_now(edge.other, world, frame)
        else:
            things = [edge.resource] if edge.cause in ("wall", "no-path") else []
        for name in things:
            if name in kinds:
                carrier = pushed_by.get(name, "")
                found[name] = ObjectRow(name=name, kind=kinds[name], carried_by=carrier)
    return tuple(found[name] for name in sorted(found))


def _pushed_now(person: int, world: World, frame: Frame) -> list[str]:
    """Name the pieces that a person of the script pushes and stands next to."""
    steps = [step for step in world.humans[person].directives if isinstance(step, Push)]
    own = {step.furniture for step in steps}
    pieces = world.movable_furniture()
    poses = frame.sensed.furniture_pose
    if len(poses) != len(pieces):
        return []
    away = np.hypot(*(poses[:, :2] - frame.sensed.human_position[person]).T)
    return [
        item.name
        for item, gap in zip(pieces, away, strict=True)
        if item.name in own and gap <= PUSHING_REACH
    ]
