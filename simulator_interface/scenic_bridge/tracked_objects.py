"""Objects of a Scenic program as the frames of a run show them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scenic.core.vectors import Vector

from mrta_falsify.core.fleet import Sensed

STANDING = 0.05  # m/s; a slower person keeps facing the way it last walked


@dataclass(slots=True)
class Body:
    """An object of the program as the frames of the run show it."""

    kind: str  #: "robot", "human", "piece" (movable furniture) or "still"
    at: Vector  #: where it was last, centre of the box as Scenic has it
    number: int = -1  #: of the robot, person or piece
    yaw: float = 0.0  #: heading at the start, of people the last one; Scenic's convention [rad]
    behavior: Any = None  #: the one whose directives are in the world, None: there is none
    read: tuple[float, ...] = ()  #: state that Scenic was last told

    def state(self, sensed: Sensed) -> tuple[float, ...]:
        """Everything about it that changes."""
        if self.kind == "robot":
            return (*sensed.pose[self.number].tolist(), *sensed.velocity[self.number].tolist())
        if self.kind == "human":
            place, pace = sensed.human_position[self.number], sensed.human_velocity[self.number]
            return (*place.tolist(), *pace.tolist())
        return tuple(sensed.furniture_pose[self.number].tolist()) if self.kind == "piece" else ()

    def place(self, sensed: Sensed) -> Vector:
        """Position; of people who are not in the building the last one."""
        state = self.state(sensed)
        if state and state[0] == state[0] and state[:2] != (self.at.x, self.at.y):
            self.at = Vector(state[0], state[1], self.at.z)
        return self.at

    def properties(self, sensed: Sensed) -> dict[str, Any]:
        """What Scenic calls dynamic properties."""
        state, turn, vx, vy = self.state(sensed), 0.0, 0.0, 0.0
        if self.kind == "robot":
            _, _, yaw, forward, left, turn = state
            c, s = math.cos(yaw), math.sin(yaw)
            vx, vy = c * forward - s * left, s * forward + c * left
            heading = yaw - math.pi / 2.0
        elif self.kind == "human" and state[0] == state[0]:
            vx, vy = state[2:]
            if math.hypot(vx, vy) > STANDING:
                self.yaw = math.atan2(vy, vx) - math.pi / 2.0
            heading = self.yaw
        else:
            heading = self.yaw + (state[2] if self.kind == "piece" else 0.0)
        moving = {
            "velocity": Vector(vx, vy, 0.0),
            "speed": math.hypot(vx, vy),
            "angularVelocity": Vector(0.0, 0.0, turn),
            "angularSpeed": turn,
        }
        if self.kind == "still":
            return moving
        return {
            "position": self.place(sensed),
            "yaw": heading,
            "pitch": 0.0,
            "roll": 0.0,
            **moving,
        }
