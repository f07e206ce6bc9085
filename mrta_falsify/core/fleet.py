"""What engine and stack exchange each tick, and what the observer sees of it.

N robots, H humans, A obstacle rays per robot, F movable pieces of furniture. What a trace keeps of
a value stands beside it (:mod:`.observed`).
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.observed import Observed, observed_in
from mrta_falsify.core.stack_failure import DeterminismCheck

NOT_MEASURED: Any = None  #: stands for an optional value that is not given
PARKED_AFTER = 5.0  #: s at rest, after which engines and stack treat a robot as an obstacle


class Phase(enum.IntEnum):
    """What a robot is doing, as its stack says."""

    OFF = 0  #: has not joined yet
    IDLE = 1  #: no task
    DRIVING = 2  #: on the way to a room with a task
    QUEUEING = 3  #: waits for a resource, or is on its way to a waiting spot without the grant
    PLANNING = 4  #: waits for a valid path
    SERVING = 5  #: loads or unloads
    PARKING = 6  #: idle, on the way to a parking spot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sensed:
    """The world after a step, as the engine measures it; ground truth, no noise."""

    tick: int  #: control ticks since the start
    time: Annotated[float, Observed((), finite=True)]  #: simulation time [s]
    #: x [m], y [m], yaw [rad], map frame
    pose: Annotated[Array, Observed(("N", 3), finite=True)]
    #: forward [m/s], left [m/s], turn rate [rad/s], body frame
    velocity: Annotated[Array, Observed(("N", 3), finite=True)]
    #: [m]; nan: left, or has not appeared yet
    human_position: Annotated[Array, Observed(("H", 2), np.nan)]
    human_velocity: Annotated[Array, Observed(("H", 2))]  #: [m/s], map frame
    #: nearest static hit per ray [m], map frame; inf: none
    obstacle_points: Annotated[Array, Observed(("N", "A", 2), np.inf, kept_as="f4")]
    #: narrowest surface gap to a robot over the sub-steps [m], inf: far
    gap_robot: Annotated[Array, Observed(("N",), np.inf)]
    gap_human: Annotated[Array, Observed(("N",), np.inf)]  #: the same to a human
    #: the same to walls, furniture and blockages
    gap_static: Annotated[Array, Observed(("N",), np.inf)]
    nearest_robot: Annotated[IntArray, Observed(("N",), -1)]  #: number of ``gap_robot``, -1: none
    nearest_human: Annotated[IntArray, Observed(("N",), -1)]  #: number of ``gap_human``, -1: none
    #: touched a robot, human, static during the sub-steps
    contact: Annotated[BoolArray, Observed(("N", 3), False)]
    #: of the F movable pieces of furniture: centre x, y [m], turn since the start [rad]
    furniture_pose: Annotated[Array, Observed(("F", 3), optional=True)] = NOT_MEASURED

    def __post_init__(self) -> None:
        """Give a value to what the engine does not measure."""
        for name, row in _OPTIONAL.items():
            if getattr(self, name) is NOT_MEASURED:
                lengths = {"N": len(self.pose), "H": len(self.human_position)}
                object.__setattr__(self, name, row.blank(lengths))


SENSED = observed_in(Sensed)  #: by name
_OPTIONAL = {name: row for name, row in SENSED.items() if row.optional}


def nothing_sensed(robots: int, people: int = 0, rays: int = 0) -> Sensed:
    """Make a measurement of time 0 in which nothing is near; poses and velocities are 0."""
    lengths = {"N": robots, "H": people, "A": rays}
    values = {name: row.blank(lengths) for name, row in SENSED.items()}
    return Sensed(tick=0, **{**values, "time": 0.0})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FleetState:
    """Input of the stack: localisation with its noise, humans, obstacle points."""

    tick: int
    time: float  #: [s]
    pose: Array  #: (N, 3) as localised
    velocity: Array  #: (N, 3) as in ``Sensed``
    human_position: Array  #: (H, 2) [m]
    human_velocity: Array  #: (H, 2) [m/s]
    human_radius: Array  #: (H,) [m]
    obstacle_points: Array  #: (N, A, 2) [m], map frame; inf: none
    parked_for: Array  #: (N,) time since the robot last moved [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Command:
    """Set points for the bases until the next tick."""

    #: forward [m/s], left [m/s], turn rate [rad/s], body frame
    twist: Annotated[Array, Observed(("N", 3), finite=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class StackEvent:
    """One line of the event table: what happened and why."""

    time: float  #: [s]
    kind: str  #: for example "granted", "picked-up", "no-path"; see docs/world.md
    robot: int = -1  #: robot number, -1: none
    task: int = -1  #: task number, -1: none
    resource: str = ""  #: name of the room or resource
    other: int = -1  #: a second robot that is involved
    detail: str = ""  #: in words


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A claim of the stack that motion contradicts."""

    time: float  #: when it was claimed [s]
    kind: str  #: of the event
    task: int  #: number, as claimed, -1: none
    robot: str  #: name, empty: none, or there is no such robot
    room: str  #: name of the room or resource, empty: none is concerned
    reason: str  #: in words


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intent:
    """What the stack reports each tick; the oracle uses goals and paths, not claims."""

    #: 0 off, 1 idle, 2 driving, 3 queueing, 4 planning, 5 serving, 6 making room
    phase: Annotated[IntArray, Observed(("N",), Phase.OFF.value)]
    #: room point or spot the robot finally heads for [m], nan: none
    goal: Annotated[Array, Observed(("N", 2), np.nan)]
    waypoint: Annotated[Array, Observed(("N", 2), np.nan)]  #: next waypoint [m], nan: none
    path: tuple[
        Array, ...
    ]  #: N polylines (L, 2) still ahead, empty: none; same object if unchanged
    cluster: Annotated[IntArray, Observed(("N",), 0)]  #: smallest robot number of its cluster
    leader: Annotated[IntArray, Observed(("N",), 0)]  #: robot number that computes its command
    #: largest barrier slack of the robot's QP, 0: none used
    slack: Annotated[Array, Observed(("N",))]
    tasks_left: Annotated[IntArray, Observed(("N",), 0)]  #: stops still in the robot's itinerary
    queue: Annotated[IntArray, Observed(("N",), -1)]  #: place in its queue, 0 = head, -1: none
    waits_for: tuple[str, ...]  #: N names of the resource waited for, "" if none


INTENT = observed_in(Intent)  #: by name


def no_intent(robots: int) -> Intent:
    """Make what a stack intends that says nothing of its N ``robots``."""
    values = {name: row.blank({"N": robots}) for name, row in INTENT.items()}
    own = np.arange(robots)
    paths = (np.zeros((0, 2)),) * robots
    return Intent(**{**values, "cluster": own, "leader": own}, path=paths, waits_for=("",) * robots)


class Tells(NamedTuple):
    """What a stack reports; a specification that needs what is missing cannot judge."""

    deliveries: bool = True  #: events ``picked-up`` and ``dropped-off``
    goals: bool = True  #: ``Intent.goal`` and ``Intent.tasks_left``
    paths: bool = True  #: ``Intent.path``

    def lacking(self, *needed: str) -> str:
        """Say which of the fields ``needed`` the stack does not tell, empty: it tells all."""
        if all(self):
            return ""
        missing = [name for name in needed if not getattr(self, name)]
        return f"the stack does not tell its {' and '.join(missing)}" if missing else ""


@dataclass(frozen=True, slots=True)
class BlockedBy:
    """One blocked-by edge: ``robot`` cannot move on because of ``other``."""

    robot: int
    cause: str  #: queue, cluster, barrier, human, wall, no-path, task
    other: int = -1  #: robot number or human number, -1: something without a number
    resource: str = ""  #: for cause "queue"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One tick of the trace: what specifications fold over."""

    sensed: Sensed
    command: Command
    intent: Intent
    events: tuple[StackEvent, ...]
    served: IntArray  #: (N,) stops done to date, as motion confirms
    confirmed: tuple[StackEvent, ...] = ()  #: stops claimed in this tick that motion confirms
    refused: tuple[Refusal, ...] = ()  #: claims that motion contradicts, each once
    blocked_by: tuple[BlockedBy, ...] = ()
    signals: Mapping[str, float] = field(default_factory=dict)  #: extra named signals
    tells: Tells = Tells()  #: what the stack reports; the same in every frame of an episode
    determinism: DeterminismCheck | None = None  #: what the stack answered again; None: not asked

    @property
    def asked_again(self) -> DeterminismCheck | None:
        """The same by its name up to 0.1, which specifications of users read."""
        return self.determinism
