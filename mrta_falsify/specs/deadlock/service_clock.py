"""Who is being served: at a room's point, in a lift, at a charger."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray, IntArray
from mrta_falsify.core.fleet import Intent, Sensed
from mrta_falsify.core.plane import inside
from mrta_falsify.core.world import Resource, World
from mrta_falsify.specs.deadlock.goals import Goal, GoalMap
from mrta_falsify.specs.deadlock.standstill import GOAL_JITTER

AT_GOAL = 0.6  # m; a robot this near to its goal has arrived
SERVING_KINDS = ("elevator", "charger")  # areas that robots stand in for the service time
SERVICE_SLACK = 1.0  # s that a service may take longer than the world says ...
SERVICE_FACTOR = 1.3  # ... and its relative spread


@dataclass(slots=True)
class ServiceClock:
    """Tells robots that are being served from robots that wait at their goal in vain."""

    world: World
    goals: GoalMap
    goal: list[Goal | None] = field(init=False)  #: N meanings of the goals, None: no goal
    at_goal: BoolArray = field(init=False)  #: (N,)
    _goal_point: Array = field(init=False)  #: (N, 2) [m]
    _served: IntArray = field(init=False)  #: (N,) stops done
    _arrived: Array = field(init=False)  #: (N,) [s]
    _serving: BoolArray = field(init=False)
    _areas: tuple[Resource, ...] = field(init=False)  #: in which robots stand to be served
    _entered: Array = field(init=False)  #: (N, A) since when a robot is in an area [s]
    _in_service: BoolArray = field(init=False)  #: (N,) in one of them

    def __post_init__(self) -> None:
        robots = len(self.world.robots)
        self.goal = [None] * robots
        self.at_goal = np.zeros(robots, dtype=np.bool_)
        self._goal_point = np.full((robots, 2), np.nan)
        self._served = np.zeros(robots, dtype=np.int64)
        self._arrived = np.full(robots, np.inf)
        self._serving = np.zeros(robots, dtype=np.bool_)
        self._areas = tuple(
            r for r in self.world.resources if r.kind in SERVING_KINDS and r.service_time > 0.0
        )
        self._entered = np.full((robots, len(self._areas)), np.inf)
        self._in_service = np.zeros(robots, dtype=np.bool_)

    def update(self, sensed: Sensed, intent: Intent, served: IntArray) -> None:
        """Take in goals and positions, and how many stops each robot has done ``(N,)``."""
        time = sensed.time
        away = np.hypot(*(sensed.pose[:, :2] - intent.goal).T)
        moved = ~(np.hypot(*(intent.goal - self._goal_point).T) <= GOAL_JITTER)
        for i in moved.nonzero()[0]:
            given = np.isfinite(intent.goal[i]).all()
            self.goal[i] = self.goals.of(intent.goal[i]) if given else None
            self._goal_point[i] = intent.goal[i]
        restart = moved | (served != self._served)
        self._served = served
        self.at_goal = away <= AT_GOAL
        self._arrived[restart | ~self.at_goal] = np.inf
        self._arrived[self.at_goal] = np.minimum(self._arrived[self.at_goal], time)
        for i in self.at_goal.nonzero()[0]:
            goal = self.goal[i]
            self._serving[i] = (
                goal is not None
                and goal.kind == "room"
                and time - self._arrived[i] <= self._allowed(goal, time)
            )
        self._serving[~self.at_goal] = False
        self._watch_areas(sensed)

    def _watch_areas(self, sensed: Sensed) -> None:
        self._in_service[:] = False
        for a, area in enumerate(self._areas):
            limit = SERVICE_FACTOR * area.service_time + SERVICE_SLACK
            for i, position in enumerate(sensed.pose[:, :2]):
                if not inside(area.release_area, position):
                    self._entered[i, a] = np.inf
                    continue
                self._entered[i, a] = min(self._entered[i, a], sensed.time)
                self._in_service[i] |= sensed.time - self._entered[i, a] <= limit

    def is_in_service(self, robot: int) -> bool:
        """Whether ``robot`` is in a lift or at a charger, with service time left."""
        return bool(self._in_service[robot])

    def is_serving(self, robot: int) -> bool:
        """Whether ``robot`` is at a room's point with service time left."""
        return bool(self._serving[robot])

    def _allowed(self, goal: Goal, time: float) -> float:
        """Find how long a service at ``goal`` may take [s]."""
        longest = 0.0
        for task in self.world.tasks:
            if task.arrival <= time:
                if task.start == goal.room:
                    longest = max(longest, task.pickup_time)
                if task.end == goal.room:
                    longest = max(longest, task.dropoff_time)
        if goal.resource >= 0:
            longest += self.world.resources[goal.resource].service_time
        return SERVICE_FACTOR * longest + SERVICE_SLACK
