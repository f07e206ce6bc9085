"""The planted defects: faults of published systems, as parts of the shipped stack that have them.

Each class takes the place of the part it derives from while its defect is switched on (see
:mod:`mrta_falsify.core.defects`). Most are faults of MRTA-Sim 1.3.1 or of SMrTa for simulation.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

from mrta_falsify.core.allocation_problem import Allocation, AllocationProblem
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.defects import Defect
from mrta_falsify.core.fleet import FleetState, StackEvent
from mrta_falsify.core.protocols import ControlResult, ControlView, Waiter
from mrta_falsify.core.world import World
from mrta_falsify.stack.activity import Idle, Parking, Stalled
from mrta_falsify.stack.control.cluster import ClusterCbf
from mrta_falsify.stack.control.decentralised import DecentralisedCbf
from mrta_falsify.stack.control.state import ControllerState
from mrta_falsify.stack.control.steering import Scene, Steering
from mrta_falsify.stack.dispatcher import Dispatcher, DispatcherState, RobotReport
from mrta_falsify.stack.headway import Headway
from mrta_falsify.stack.itinerary import NOTHING_TO_DO, ItineraryFollower
from mrta_falsify.stack.mission import Mission
from mrta_falsify.stack.planning_service import PlanningService, ServiceState
from mrta_falsify.stack.resources.parking import ParkingTraffic, Reason
from mrta_falsify.stack.resources.queue import Queue, QueueState
from mrta_falsify.stack.resources.rooms import RoomTraffic
from mrta_falsify.stack.route import Way
from simulator_interface.costmap_layers import BoundCostmap, LayeredCostmap

FORGOTTEN_FROM = 3  # waiters that a queue keeps
FAILURE_BLOCKS = 10.0  # s, MRTA-Sim: 100 retries, 0.1 s each
SEEN = 2  # people that MRTA-Sim has room for
LATE = 1.0  # s behind its plan, from which a robot is late


# --- allocator --------------------------------------------------------------------------------


class _GivesUp(Dispatcher):
    """Allocates nothing any more once an answer was useless."""

    def _reason_to_stop(self, time: float, fleet: Sequence[RobotReport], answer: Allocation) -> str:
        """Say why nothing is allocated any more; empty if it goes on."""
        del time, fleet, answer
        return ""

    def _fault_of(
        self,
        state: DispatcherState,
        time: float,
        fleet: Sequence[RobotReport],
        problem: AllocationProblem,
        answer: Allocation,
    ) -> str:
        state.gave_up = state.gave_up or self._reason_to_stop(time, fleet, answer)
        return state.gave_up or super()._fault_of(state, time, fleet, problem, answer)


class UnsatAfterLateness(_GivesUp):
    """SMrTa for simulation asserts planned and actual times of the same stop.

    That is unsatisfiable from the first late robot on.
    """

    def _reason_to_stop(self, time: float, fleet: Sequence[RobotReport], answer: Allocation) -> str:
        late = any(
            report.itinerary and max(time, report.first_ends) - report.itinerary[0].time >= LATE
            for report in fleet
        )
        reason = "unsatisfiable since a robot was late" if late else ""
        return reason or super()._reason_to_stop(time, fleet, answer)


class StopsWithoutPlan(_GivesUp):
    """The dispatcher of SMrTa for simulation does not expect an answer without a plan."""

    def _reason_to_stop(self, time: float, fleet: Sequence[RobotReport], answer: Allocation) -> str:
        reason = "" if answer.status == "plan" else "no plan since a deadline cannot be met"
        return reason or super()._reason_to_stop(time, fleet, answer)


# --- rooms ------------------------------------------------------------------------------------


class AdmitsAtEveryRelease(Queue):
    """Any release admits the head of the queue, full or not."""

    def let_go(
        self, state: QueueState, robot: int, time: float, position: Array
    ) -> list[StackEvent]:
        """See :meth:`Queue.let_go`."""
        events = super().let_go(state, robot, time, position)
        return [*events, *self._admit_head(state, time)]

    def turn_away(self, state: QueueState, robot: int, time: float) -> list[StackEvent]:
        """See :meth:`Queue.turn_away`."""
        events = super().turn_away(state, robot, time)
        return [*events, *self._admit_head(state, time)]

    def _admit_head(self, state: QueueState, time: float) -> list[StackEvent]:
        if not state.waiters:
            return []
        return self.grants((self.admit(state, self.order(state)[0]),), time)


class ForgetsTheFourth(Queue):
    """A queue of three forgets whoever asks."""

    def ask(self, state: QueueState, waiter: Waiter) -> bool:
        """See :meth:`Queue.ask`."""
        robot = waiter.robot
        if robot in state.ignored:
            return False
        is_known = robot in state.holders or any(known.robot == robot for known in state.waiters)
        if not is_known and len(state.waiters) >= FORGOTTEN_FROM:
            state.ignored.append(robot)
            return False
        return super().ask(state, waiter)


class FreesEarly(RoomTraffic):
    """A robot that has finished frees the room in which it stays parked."""

    def _may_let_go(
        self, queue: Queue, memory: QueueState, robot: int, mission: Mission, position: Array
    ) -> tuple[Mission, bool]:
        if not mission.itinerary and isinstance(mission.activity, (Idle, Parking)):
            return mission, True
        return super()._may_let_go(queue, memory, robot, mission, position)


class ParksAnywhere(ParkingTraffic):
    """Nobody minds a robot that parks in a room it has freed, or on the way of others."""

    def _stands_in(self, queue: Queue, position: Array) -> bool:
        return False

    def _blocked(
        self, missions: Sequence[Mission], headway: Headway, robot: int, fleet: FleetState
    ) -> Reason | None:
        return None

    def _in_crossing(self, position: Array) -> Reason | None:
        return None


# --- waypoints --------------------------------------------------------------------------------


class StallsAtTheSameRoom(ItineraryFollower):
    """Two consecutive stops in one room leave the robot without a way."""

    def _served(self, mission: Mission) -> Mission:
        room = mission.itinerary[0].room
        served = super()._served(mission)
        if served.itinerary and served.itinerary[0].room == room:
            return dataclasses.replace(served, activity=Stalled())
        return served

    def _is_busy(self, mission: Mission) -> bool:
        return isinstance(mission.activity, Stalled) or super()._is_busy(mission)

    def _stop_of(
        self, robot: int, mission: Mission, memories: Sequence[QueueState]
    ) -> tuple[object, ...]:
        if mission.itinerary and isinstance(mission.activity, Stalled):
            return NOTHING_TO_DO
        return super()._stop_of(robot, mission, memories)


# --- planner, costmap -------------------------------------------------------------------------


class FailureBlocksAll(PlanningService):
    """One unreachable goal holds up the plans of all robots."""

    def plan(
        self,
        state: ServiceState,
        way: Way,
        position: Array,
        time: float,
        not_held: Sequence[int] = (),
    ) -> Way:
        """See :meth:`PlanningService.plan`."""
        if state.blocked_until > time:
            return way
        planned = super().plan(state, way, position, time, not_held)
        if planned.failed:
            state.blocked_until = time + FAILURE_BLOCKS
        return planned


class _Unfurnished(BoundCostmap):
    def furnish(self, outlines: tuple[Array, ...]) -> None:
        super().furnish(())


@functools.lru_cache(maxsize=4)  # one object for each world, as maps are kept by it
def _without_furniture(world: World) -> World:
    return dataclasses.replace(world, furniture=())


class BlindToFurniture(LayeredCostmap):
    """Furniture is missing from the costmap."""

    def bind(self, world: World) -> BoundCostmap:
        """See :meth:`LayeredCostmap.bind`."""
        return _Unfurnished(_without_furniture(world), self._options)


# --- controller -------------------------------------------------------------------------------


def _first_people(view: ControlView) -> ControlView:
    return dataclasses.replace(
        view,
        human_position=view.human_position[:SEEN],
        human_velocity=view.human_velocity[:SEEN],
        human_radius=view.human_radius[:SEEN],
    )


class SeesTwoPeople(ClusterCbf):
    """Only the first two people are avoided."""

    def control(self, view: ControlView) -> ControlResult:
        """See :meth:`ClusterCbf.control`."""
        return super().control(_first_people(view))

    def scene(self, view: ControlView) -> Scene:
        """See :meth:`ClusterCbf.scene`."""
        return super().scene(_first_people(view))


class SeesTwoPeopleAlone(DecentralisedCbf):
    """Only the first two people are avoided."""

    def control(self, view: ControlView) -> ControlResult:
        """See :meth:`DecentralisedCbf.control`."""
        return super().control(_first_people(view))

    def scene(self, view: ControlView) -> Scene:
        """See :meth:`DecentralisedCbf.scene`."""
        return super().scene(_first_people(view))


class FollowersDisobey(ClusterCbf):
    """A follower's own zero command fights its leader's remote command, every other tick."""

    def _obeys(self, state: ControllerState) -> bool:
        return state.tick % 2 != 0


class FollowersBrake(ClusterCbf):
    """A boxed-in leader keeps the lead, so its neighbours never move."""

    def __init__(self, options: ClusterCbf.Options) -> None:
        super().__init__(dataclasses.replace(options, followers="brake"))


class CrossesRows(ClusterCbf):
    """Barrier rows of a cluster use another robot's state; the kernel has this fault itself."""

    def _steering(self, options: ClusterCbf.Options) -> Steering:
        return Steering(options, crosses_rows=True)


# --- what is registered ------------------------------------------------------------------------

CLUSTER_ROWS_WRONG_ROBOT = Defect(
    "controller", "barrier rows of a cluster use another robot's state", {ClusterCbf: CrossesRows}
)
FOLLOWER_ZERO_COMMAND = Defect(
    "controller",
    "a follower's own zero command fights its leader's remote command",
    {ClusterCbf: FollowersDisobey},
)
QUEUE_RELEASE_LOSES_EXCLUSION = Defect(
    "queue_policy",
    "any release grants the room again, although another robot holds it",
    {Queue: AdmitsAtEveryRelease},
)
ROOM_FREED_WHILE_PARKED = Defect(
    "queue_policy",
    "a robot that finished frees the room while still parked in it",
    {RoomTraffic: FreesEarly, ParkingTraffic: ParksAnywhere},
)
SAME_ROOM_TWICE_STALLS = Defect(
    "waypoint_generator",
    "two consecutive stops in one room leave the robot without a way",
    {ItineraryFollower: StallsAtTheSameRoom},
)
COSTMAP_BLIND_TO_FURNITURE = Defect(
    "costmap", "furniture is missing from the costmap", {LayeredCostmap: BlindToFurniture}
)
HUMANS_UNSEEN_BEYOND_TWO = Defect(
    "controller",
    "only the first two humans are avoided",
    {ClusterCbf: SeesTwoPeople, DecentralisedCbf: SeesTwoPeopleAlone},
)
PLANNER_FAILURE_BLOCKS_ALL = Defect(
    "planner",
    "one unreachable goal holds up the plans of all robots",
    {PlanningService: FailureBlocksAll},
)
FOURTH_WAITER_DROPPED = Defect(
    "queue_policy", "the fourth robot in a queue is forgotten", {Queue: ForgetsTheFourth}
)
FIXED_PRIORITY_STARVES = Defect(
    "priority_rule",
    "a boxed-in leader keeps the lead, so its neighbours never move",
    {ClusterCbf: FollowersBrake},
)
LATE_FEEDBACK_UNSAT = Defect(
    "allocator",
    "once a robot ends a committed stop late, no later batch has a plan",
    {Dispatcher: UnsatAfterLateness},
)
NO_PLAN_WHEN_INFEASIBLE = Defect(
    "allocator",
    "no plan at all if one deadline cannot be met; the dispatcher stops for good",
    {Dispatcher: StopsWithoutPlan},
)
