"""The kinematic engine, in which one robot may vanish."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrta_falsify.core import registry
from mrta_falsify.core.arrays import Array
from mrta_falsify.core.config import Choice
from mrta_falsify.core.fleet import Command, Sensed
from mrta_falsify.core.world import World


class GhostEngine:
    """The kinematic engine until :meth:`vanish`.

    The body of the robot that vanishes stays where it is, but nobody perceives it there: poses
    say it is far outside the map. Bodies of the kinematic engine do not hinder each other.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Options:
        """None."""

    def __init__(self, options: Options) -> None:
        del options
        self._engine = registry.build("engine", Choice("kinematic"))
        self._gone = -1

    def vanish(self, robot: int) -> None:
        """From the next step on ``robot`` is nowhere."""
        self._gone = robot

    def start(self, world: World, dt: float, human_position: Array) -> Sensed:
        """As the engine's."""
        x_min, y_min = world.bounds[:2]
        self._limbo = np.array([x_min - 50.0, y_min - 50.0, 0.0])
        return self._hidden(self._engine.start(world, dt, human_position))

    def step(self, command: Command, human_velocity: Array) -> Sensed:
        """As the engine's; the ghost does not move."""
        twist = np.array(command.twist)
        if self._gone >= 0:
            twist[self._gone] = 0.0
        return self._hidden(self._engine.step(Command(twist=twist), human_velocity))

    def close(self) -> None:
        """Free everything."""
        self._engine.close()

    def _hidden(self, sensed: Sensed) -> Sensed:
        if self._gone < 0:
            return sensed
        pose, velocity = np.array(sensed.pose), np.array(sensed.velocity)
        points = np.array(sensed.obstacle_points)
        pose[self._gone], velocity[self._gone], points[self._gone] = self._limbo, 0.0, np.inf
        return dataclasses.replace(sensed, pose=pose, velocity=velocity, obstacle_points=points)
