"""What a stack in another process may ask in the middle of a tick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import StackConfig
from mrta_falsify.core.costmap import LETHAL, Costmap
from mrta_falsify.core.plane import NO_POINTS
from mrta_falsify.core.protocols import CostmapSource, Planner
from mrta_falsify.core.world import World
from simulator_interface.external.answers import FARTHEST, Wrong, shown
from simulator_interface.external.messages import Message, map_message

STEP = 0.5  # cells between two looks along a line


class Services:
    """Answers a stack's questions by the shipped planner and the costmap of the moment.

    Args:
        world: of the episode.
        config: whose planner plans.
        costmaps: of the building.
    """

    def __init__(self, world: World, config: StackConfig, costmaps: CostmapSource) -> None:
        self._world = world
        self._config = config
        self._costmaps = costmaps
        self._planner: Planner | None = None
        self._answers = {
            "plan": self._plan,
            "travel_time": self._travel_time,
            "visible": self._visible,
            "map": self._map,
        }
        self._sent: Costmap | None = None  # the last map that was asked for
        self._number = 0  # of it
        self.known = frozenset(self._answers)  #: types of questions

    def answer(self, question: Message, time: float) -> Message:
        """Answer a question asked at ``time`` [s].

        Raises:
            Wrong: it is not as the protocol says.
        """
        return self._answers[question["type"]](question, time)

    def path(
        self, start: Array, goal: Array, time: float, avoided: Array = NO_POINTS
    ) -> tuple[Array, str]:
        """Plan from ``start`` to ``goal``; the path ``(L, 2)``, and why there is none."""
        if self._planner is None:
            self._planner = registry.build(
                "planner", self._config.planner, defects=self._config.defects
            )
        self._planner.use(self._costmaps.costmap(time, avoided))
        plan = self._planner.plan(start, goal)
        return plan.path, plan.reason

    def _plan(self, question: Message, time: float) -> Message:
        start, goal = _ends(question)
        path, reason = self.path(start, goal, time, self._avoided(question))
        return {"type": "path", "points": path, "reason": reason}

    def _travel_time(self, question: Message, time: float) -> Message:
        start, goal = _ends(question)
        robot = question.get("robot", 0)
        if type(robot) is not int or not 0 <= robot < len(self._world.robots):
            raise Wrong("robot", f"is {shown(robot)}; there are {len(self._world.robots)} robots")
        path, _ = self.path(start, goal, time)
        if len(path) == 0:
            return {"type": "travel_time", "seconds": math.inf}
        length = float(np.hypot(*np.diff(path, axis=0).T).sum())
        spec = self._world.robots[robot]
        return {"type": "travel_time", "seconds": length / min(spec.max_speed, spec.cruise_speed)}

    def _visible(self, question: Message, time: float) -> Message:
        start, goal = _ends(question)
        costmap = self._costmaps.costmap(time, NO_POINTS)
        if (costmap.cost_at(np.array([start, goal])) == LETHAL).any():  # or outside the map
            return {"type": "visible", "visible": False}
        away = float(np.hypot(*(goal - start)))
        looks = max(2, math.ceil(away / (STEP * costmap.resolution)) + 1)
        line = start + np.linspace(0.0, 1.0, looks)[:, None] * (goal - start)
        return {"type": "visible", "visible": not bool((costmap.cost_at(line) == LETHAL).any())}

    def _map(self, question: Message, time: float) -> Message:
        costmap = self._costmaps.costmap(time, self._avoided(question))
        if self._sent is not costmap:
            self._sent, self._number = costmap, self._number + 1
        if question.get("known") == self._number:
            return {"type": "map", "number": self._number}
        return {"type": "map", "number": self._number, **map_message(costmap)}

    def _avoided(self, question: Message) -> Array:
        """Read where robots stand, ``(P, 2)`` [m]."""
        rows = question.get("avoid", ())
        if not isinstance(rows, (list, tuple)) or len(rows) > len(self._world.robots):
            raise Wrong("avoid", "must be a list of at most one point a robot")
        return np.array([_point("avoid", row) for row in rows]).reshape(-1, 2)


def _ends(question: Message) -> tuple[Array, Array]:
    return _point("start", question.get("start")), _point("goal", question.get("goal"))


def _point(field: str, value: Any) -> Array:
    is_pair = isinstance(value, (list, tuple)) and len(value) == 2
    if is_pair and all(type(n) in (int, float) and abs(n) <= FARTHEST for n in value):
        return np.array(value, dtype=np.float64)
    raise Wrong(
        field, f"is {shown(value)}; it must be two finite numbers, at most {FARTHEST:g} [m]"
    )
