"""The extension points: what a method must offer to take a layer's place.

Every component is built as ``Component(options)`` from its frozen dataclass
``Component.Options`` (the YAML options of the layer), by :mod:`mrta_falsify.core.registry`.
N robots, H humans, A obstacle rays, R rooms.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.candidate import Proposal
from mrta_falsify.core.costmap import Costmap
from mrta_falsify.core.feedback import Feedback, SceneLoads
from mrta_falsify.core.fleet import (
    Command,
    FleetState,
    Frame,
    Intent,
    Sensed,
    StackEvent,
)
from mrta_falsify.core.free_space import Disc
from mrta_falsify.core.polyline import Polylines
from mrta_falsify.core.renamed import renamed_attribute
from mrta_falsify.core.stack_failure import DeterminismCheck, StackFailure
from mrta_falsify.core.steadiness import Memory
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.core.world import Lane, World

# --- the whole stack -------------------------------------------------------------------


class FleetStack(Protocol):
    """The whole stack under test, as an episode asks it; its memory is a value of its own."""

    def start(self) -> Any:
        """Give the memory at time 0; it has ``digest()``, a hash of all that decides."""

    def step(
        self, state: Any, fleet: FleetState
    ) -> tuple[Any, Command, Intent, tuple[StackEvent, ...]]:
        """Run one control tick.

        Args:
            state: memory; it is consumed.
            fleet: what the robots' sensors say.

        Returns:
            The memory for the next tick, the command, what the stack intends, and what happened.
        """

    def forget_after(self, state: Any, time: float) -> None:
        """Let no task arrive any more, and no outage begin, after ``time`` [s]."""


# --- allocation ------------------------------------------------------------------------


@runtime_checkable
class Allocator(Protocol):
    """Decides which robot serves which task, and in which order."""

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """Plan itineraries for all robots; never raises for an overloaded fleet, never None."""


# --- queues ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Waiter:
    """A robot that asks for a resource."""

    robot: int
    since: float  #: when it asked [s]
    distance: float  #: straight distance to the resource's entry [m]
    deadline: float  #: of its next drop-off [s], inf: none


@runtime_checkable
class QueuePolicy(Protocol):
    """Decides who gets a resource next."""

    def order(self, waiters: Sequence[Waiter]) -> tuple[int, ...]:
        """Order the robot numbers of the waiters, the next holder first; a permutation."""


# --- waypoints -------------------------------------------------------------------------


@runtime_checkable
class WaypointGenerator(Protocol):
    """Turns "go from room i to room j" into waypoints."""

    def to_queue(self, lane: Lane, tail: Array) -> Array:
        """Give waypoints ``(K, 2)`` [m] from the lane's start room to the waiting spot ``tail``."""

    def to_room(self, lane: Lane) -> Array:
        """Give waypoints ``(K, 2)`` [m] from the lane's start room to the end room's point."""


# --- planning --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A planner's answer: a path, or the reason why there is none."""

    path: Array  #: (L, 2) from start to goal [m], map frame; (0, 2) if there is none
    length: float  #: [m], inf if there is no path
    reason: str = ""  #: "", "start-blocked", "goal-blocked" or "unreachable"

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return len(self.path) > 0


@runtime_checkable
class Planner(Protocol):
    """Finds paths on a costmap; shared by all robots and by the humans."""

    def use(self, costmap: Costmap) -> None:
        """Plan on ``costmap`` from now on; may keep what it learned of an earlier one."""

    def plan(self, start: Array, goal: Array) -> Plan:
        """Plan from ``start`` to ``goal``, both ``(2,)`` [m]; a pure function of map and points."""


class CostmapSource(Protocol):
    """Source of costmaps; the stack asks, the simulator interface builds."""

    def costmap(self, time: float, parked: Array) -> Costmap:
        """Build the costmap of ``time`` [s] with robots parked at ``parked`` ``(P, 2)`` [m].

        Returns the same object as long as nothing changed.
        """


# --- control ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlView:
    """What the controllers of all robots may know at one tick."""

    time: float  #: [s]
    dt: float  #: control period [s]
    pose: Array  #: (N, 3) as localised, map frame
    velocity: Array  #: (N, 3) forward, left [m/s], turn rate [rad/s], body frame
    target: Array  #: (N, 2) look-ahead point on the path [m]; nan: no reason to move
    goal: Array  #: (N, 2) end of the current path [m]; nan: none
    path: Sequence[Array]  #: N polylines (L, 2) ahead of the robot [m], empty: none
    active: BoolArray  #: (N,) has a task and does not wait in a queue
    present: BoolArray  #: (N,) has joined
    rank: IntArray  #: (N,) priority, 0 first, a permutation
    obstacle_points: Array  #: (N, A, 2) [m]; inf: none
    human_position: Array  #: (H, 2) [m]
    human_velocity: Array  #: (H, 2) [m/s]
    human_radius: Array  #: (H,) [m]
    states_link: BoolArray  #: (N,) robot shares its state with the others and hears theirs
    leader_link: BoolArray  #: (N,) robot can send and receive remote commands
    max_speed: Array  #: (N,) [m/s]
    max_acceleration: Array  #: (N,) [m/s^2]
    max_turn_rate: Array  #: (N,) [rad/s]
    cruise: Array | None = (
        None  #: (N,) speed driven at if nothing is in the way [m/s]; None: CRUISE
    )
    #: A outlines of places that robots must ask for [m]; None: not told
    shared_places: Polylines | None = None
    closed: BoolArray | None = None  #: (N, A) others hold the place, and it has room for no more


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlResult:
    """Commands of all robots, and how they came about."""

    command: Command
    cluster: IntArray  #: (N,) smallest robot number of the robot's cluster
    leader: IntArray  #: (N,) robot that computed this robot's command
    slack: Array  #: (N,) largest barrier slack used, 0: none
    fallback: BoolArray  #: (N,) no usable QP solution: braked instead


@runtime_checkable
class Controller(Protocol):
    """Computes every robot's command; what it remembers must survive ``copy.deepcopy``."""

    def control(self, view: ControlView) -> ControlResult:
        """Compute the commands for one tick."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PriorityView:
    """What a priority rule may use."""

    time: float  #: [s]
    pose: Array  #: (N, 3)
    active: BoolArray  #: (N,)
    distance_to_goal: Array  #: (N,) along the path [m], inf: none
    waiting_since: Array  #: (N,) since when it made no progress [s], inf: makes progress


@runtime_checkable
class PriorityRule(Protocol):
    """Orders the robots; the first active one of a cluster leads it."""

    def ranks(self, view: PriorityView) -> IntArray:
        """Rank the robots, ``(N,)``, 0 first; a permutation."""


# --- people ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CrowdView:
    """What people perceive at one tick."""

    dt: float  #: [s]
    position: Array  #: (H, 2) [m]
    velocity: Array  #: (H, 2) [m/s]
    target: Array  #: (H, 2) next point of the own way [m]
    desired_speed: Array  #: (H,) [m/s], 0: stands
    radius: Array  #: (H,) [m]
    reacts_to_robots: BoolArray  #: (H,)
    present: BoolArray  #: (H,)
    robot_position: Array  #: (N, 2) [m]
    robot_velocity: Array  #: (N, 2) [m/s], map frame
    robot_radius: Array  #: (N,) [m]
    walls: Array  #: (S, 4) solid edges x1, y1, x2, y2 [m]


@runtime_checkable
class HumanModel(Protocol):
    """Moves people.

    A model may have ``sight`` [m], more than 0.8: targets are then the farthest points of people's
    ways within it that they see, not points 0.8 m ahead.
    """

    def velocities(self, view: CrowdView) -> Array:
        """Compute velocities ``(H, 2)`` [m/s] for the next tick, map frame."""


# --- the world's physics ---------------------------------------------------------------


@runtime_checkable
class Engine(Protocol):
    """Carries robots and people through the world; one object per episode."""

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """Build the world for control period ``dt`` [s] and measure it at time 0.

        ``human_position`` ``(H, 2)`` [m] is where the people of ``world.humans`` begin.
        """

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """Advance one control period; ``human_velocity`` ``(H, 2)`` [m/s], map frame."""

    def close(self) -> None:
        """Free everything; may be called twice."""


# --- search ----------------------------------------------------------------------------


@runtime_checkable
class Sampler(Protocol):
    """Proposes points of the unit cube and learns from what happened there.

    ``Options`` have at least the fields ``cube`` (:class:`~mrta_falsify.core.feedback.Cube`)
    and ``seed``. The n-th proposal is a function of options and of the feedback told before
    it was asked for, so that a campaign resumes by asking and telling again.
    """

    def ask(self) -> Proposal:
        """Make the next proposal, numbered from 0 without gaps."""

    def tell(self, feedback: Feedback) -> None:
        """Take in the result of a proposal; called once per proposal, in number order."""


@runtime_checkable
class SkippingSampler(Sampler, Protocol):
    """A sampler whose proposals take long; a resumed campaign need not compute all again."""

    def skip(self) -> None:
        """Use up a proposal's number, as ``ask`` does, where its result is known already."""


class Preflight(Protocol):
    """Looks at the scene of a point without running it; a pure function."""

    def __call__(self, u: Array) -> SceneLoads | None:
        """Measure what the scene at ``u`` ``(k,)`` asks of a stack; None: there is none."""


@runtime_checkable
class PreflightSampler(Sampler, Protocol):
    """A sampler that may look at scenes before it proposes one."""

    def rehearse_by(self, preflight: Preflight) -> None:
        """Look at scenes by ``preflight``; called before the first proposal, if at all."""


@runtime_checkable
class Specification(Protocol):
    """A fold over frames; built anew for each episode."""

    def start(self, world: World, dt: float) -> None:
        """Begin an episode with control period ``dt`` [s]."""

    def update(self, frame: Frame) -> None:
        """Take in one tick."""

    def verdict(self) -> Verdict:
        """Give the verdict to date; may be asked at any time."""


# --- looking ahead -----------------------------------------------------------------------


class Watch(Protocol):
    """Watches the frames of a continuation until it has seen enough."""

    def update(self, frame: Frame) -> bool:
        """Take in a tick; True: seen enough."""

    def answer(self) -> dict[str, Any]:
        """Give what was seen, JSON-shaped."""


@runtime_checkable
class ResumedWatch(Watch, Protocol):
    """A watch that answers several questions about one continuation, which need not begin anew."""

    series: object | None  #: the same for all questions of one continuation; None: only one
    question: Any  #: that is asked; it can be sent to another process

    def resume(self, question: Any) -> bool:
        """Take up a later question of the series; True: what was seen answers it."""


@runtime_checkable
class SpeculativeWatch(ResumedWatch, Protocol):
    """A watch with an expected answer, so that the run itself may go on before it is known."""

    expected: dict[str, Any] | None  #: None: the answer is to be waited for

    def is_as_expected(self) -> bool:
        """Whether the answer is the expected one; asked once it is complete."""


class SteadyRun(Protocol):
    """A run whose memory can be read, so that it can be proven to be at rest."""

    @property
    def longest_timer(self) -> float:
        """The longest time for which the stack waits by a clock [s]; inf: it is not known."""

    def memory(self) -> Memory:
        """Read all that decides the next ticks."""

    def planned_times(self) -> Sequence[float]:
        """List moments at which the stack may decide anew by its own plan, past ones too [s]."""


@runtime_checkable
class ProvingWatch(Watch, Protocol):
    """A watch that may end early, once the run is proven to be at rest."""

    def take_run(self, run: SteadyRun) -> None:
        """Take the run that is watched; called before its first frame is shown."""


class Forecast(Protocol):
    """Runs a continuation: a copy of the run, usually without further outside events."""

    @property
    def is_outside(self) -> bool:
        """Whether a foreign stack runs in it, which may remember what a robot that is gone has."""

    @property
    def discs(self) -> Sequence[Disc]:
        """N, inside the robots' bodies."""

    def __call__(
        self, watch: Watch, *, without: Sequence[int] = (), nudge: int = 0, to_come: bool = False
    ) -> dict[str, Any] | None:
        """Answer by ``watch``; None: the engine cannot, or the stack fails in the continuation.

        An expected answer may be given before it is known. Where it proves wrong, the run is taken
        back to here, with the right one.

        Args:
            watch: sees the frames.
            without: robots that are taken away.
            nudge: number of a copy with small differences, 0: without any.
            to_come: whether what is still to come from outside comes: tasks arrive, blockages and
                outages begin.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What a run cost, to be compared with another run of the same world."""

    way: tuple[float, ...]  #: (N,) driven by each robot [m]
    time: float  #: of the last delivery, or to date [s]
    calls: int | None  #: of the allocator, None: they were not counted
    undelivered: int  #: tasks


@runtime_checkable
class Comparing(Protocol):
    """A specification that compares the run with one of a reference stack in the same world."""

    @property
    def reference(self) -> tuple[str, ...]:
        """Changes of the default stack that make the reference, as ``--set`` takes them."""

    def compare_with(self, costs: Costs) -> None:
        """Take the reference's costs; called before ``start``, and only if there are any."""


@runtime_checkable
class Foreseeing(Protocol):
    """A specification that may ask for forecasts of the run."""

    def foresee(self, forecast: Forecast) -> None:
        """Offer forecasts for this episode; called after ``start``, and only if there are any."""


# --- what the stack does wrong -----------------------------------------------------------


@runtime_checkable
class JudgingFailures(Protocol):
    """A specification that judges how the stack under test fails to answer."""

    def stack_failed(self, failure: StackFailure) -> None:
        """Take in that the stack failed; the episode ends here, without another frame."""


@runtime_checkable
class Repeating(Protocol):
    """A specification that has ticks asked again; :class:`Frame` has the answers."""

    def asks_again(self, tick: int) -> bool:
        """Whether the stack shall be asked ``tick`` again."""


@runtime_checkable
class RepeatingRun(Protocol):
    """A specification that has all ticks of a run asked again, where the stack can be told them."""

    def asked_at_end(self, again: DeterminismCheck) -> None:
        """Take in what a fresh process of the stack answered; the run has ended."""


def __getattr__(name: str) -> Any:
    names = {"Rehearsal": "Preflight", "RehearsingSampler": "PreflightSampler"}
    return renamed_attribute(sys.modules[__name__], name, names)
