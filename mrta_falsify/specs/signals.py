"""Named signals of a run, for STL formulas.

Fleet signals (a bare name) and robot signals (``name(robot1)``):

=====================  ======================================================================
``time``               simulation time [s]
``d_human``            narrowest gap between a robot and a person [m], surface to surface
``d_robot``            narrowest gap between two robots [m]
``d_static``           narrowest gap between a robot and a solid [m]
``tasks_left``         stops left in all itineraries
``longest_wait``       longest time a robot with a goal has stood on its spot [s]
``moving``             number of robots faster than 0.05 m/s
``blocked``            number of robots with a blocked-by edge (waiting for a task left out)
``slack``              largest barrier slack of a controller
``speed(r)``           speed [m/s]
``turn_rate(r)``       turn rate [rad/s], counter-clockwise
``x(r)``, ``y(r)``     position [m], map frame
``goal_distance(r)``   straight distance to the goal [m], 0 without a goal
``has_goal(r)``        1 with a goal, else 0
``d_human(r)``         narrowest gap to a person [m]; ``d_robot(r)``, ``d_static(r)`` alike
``wait(r)``            time on its spot with a goal [s]
``blocked(r)``         1 with a blocked-by edge, else 0
``tasks_left(r)``      stops left in its itinerary
``slack(r)``           largest barrier slack
=====================  ======================================================================

Gaps are capped at 10 m. Any other name is looked up in ``Frame.signals``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.fleet import Frame
from mrta_falsify.core.world import World
from mrta_falsify.specs.contacts import DRIVING_SPEED, GAP_CAP
from mrta_falsify.specs.deadlock.standstill import Standstill

#: signals that say nothing without ``Intent.goal`` and ``Intent.tasks_left``
NEED_GOALS = frozenset(
    ("tasks_left", "longest_wait", "blocked", "goal_distance", "has_goal", "wait")
)


@dataclass(slots=True, eq=False)
class Moment:
    """A frame with what signals need beside it."""

    frame: Frame
    wait: Array  #: (N,) time on the spot with a goal [s]


def _gap(values: Array) -> float:
    return float(min(values.min(initial=GAP_CAP), GAP_CAP))


def _speeds(frame: Frame) -> Array:
    velocity = frame.sensed.velocity
    return np.asarray(np.hypot(velocity[:, 0], velocity[:, 1]), dtype=np.float64)


def _is_blocked(frame: Frame, robot: int) -> float:
    return float(any(e.robot == robot and e.cause != "task" for e in frame.blocked_by))


def _goal_distance(moment: Moment, robot: int) -> float:
    frame = moment.frame
    distance = float(np.hypot(*(frame.intent.goal[robot] - frame.sensed.pose[robot, :2])))
    return distance if np.isfinite(distance) else 0.0


FLEET: dict[str, Callable[[Moment], float]] = {
    "time": lambda m: m.frame.sensed.time,
    "d_human": lambda m: _gap(m.frame.sensed.gap_human),
    "d_robot": lambda m: _gap(m.frame.sensed.gap_robot),
    "d_static": lambda m: _gap(m.frame.sensed.gap_static),
    "tasks_left": lambda m: float(m.frame.intent.tasks_left.sum()),
    "longest_wait": lambda m: float(m.wait.max(initial=0.0)),
    "moving": lambda m: float((_speeds(m.frame) > DRIVING_SPEED).sum()),
    "blocked": lambda m: float(len({e.robot for e in m.frame.blocked_by if e.cause != "task"})),
    "slack": lambda m: float(m.frame.intent.slack.max(initial=0.0)),
}

ROBOT: dict[str, Callable[[Moment, int], float]] = {
    "speed": lambda m, i: float(np.hypot(*m.frame.sensed.velocity[i, :2])),
    "turn_rate": lambda m, i: float(m.frame.sensed.velocity[i, 2]),
    "x": lambda m, i: float(m.frame.sensed.pose[i, 0]),
    "y": lambda m, i: float(m.frame.sensed.pose[i, 1]),
    "goal_distance": _goal_distance,
    "has_goal": lambda m, i: float(np.isfinite(m.frame.intent.goal[i, 0])),
    "d_human": lambda m, i: _gap(m.frame.sensed.gap_human[i : i + 1]),
    "d_robot": lambda m, i: _gap(m.frame.sensed.gap_robot[i : i + 1]),
    "d_static": lambda m, i: _gap(m.frame.sensed.gap_static[i : i + 1]),
    "wait": lambda m, i: float(m.wait[i]),
    "blocked": lambda m, i: _is_blocked(m.frame, i),
    "tasks_left": lambda m, i: float(m.frame.intent.tasks_left[i]),
    "slack": lambda m, i: float(m.frame.intent.slack[i]),
}


@dataclass(slots=True)
class SignalReader:
    """Reads chosen signals off each frame; one object per episode."""

    world: World
    fleet: tuple[str, ...]  #: fleet signals wanted
    robot: tuple[tuple[str, int], ...]  #: robot signals wanted, with robot numbers
    extra: tuple[str, ...] = ()  #: names to look up in ``Frame.signals``
    _still: Standstill | None = None

    def read(self, frame: Frame) -> list[float]:
        """Read the wanted signals: fleet, then robot, then extra ones.

        Raises:
            KeyError: an extra signal is missing from the frame.
        """
        moment = Moment(frame, self._wait(frame))
        return [
            *(FLEET[name](moment) for name in self.fleet),
            *(ROBOT[name](moment, i) for name, i in self.robot),
            *(float(frame.signals[name]) for name in self.extra),
        ]

    def _wait(self, frame: Frame) -> Array:
        wanted = "longest_wait" in self.fleet or any(name == "wait" for name, _ in self.robot)
        if not wanted:
            return np.zeros(0)
        if self._still is None:
            self._still = Standstill(len(self.world.robots))
        since = self._still.update(frame.sensed.pose, frame.sensed.time, frame.intent.goal)
        has_goal = np.isfinite(frame.intent.goal[:, 0])
        return np.where(has_goal, frame.sensed.time - since, 0.0)
