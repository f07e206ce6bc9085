"""Objects of a Scenic program as the frames of a run show them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from scenic.core.scenarios import Scene
from scenic.core.simulators import SimulationCreationError
from scenic.core.vectors import Vector

from mrta_falsify.core.directives import Appear, StandStill, WaitUntil
from mrta_falsify.core.errors import InputError, WorldError
from mrta_falsify.core.fleet import Frame, Sensed
from simulator_interface.episode import Episode
from simulator_interface.scenic_bridge.behaviors import BehaviorReader
from simulator_interface.scenic_bridge.scene_contract import is_library_behavior, places_of_scene
from simulator_interface.scenic_bridge.scene_objects import (
    box_outline,
    names_in_world,
    world_objects,
)
from simulator_interface.scenic_bridge.scene_people import is_free_place, late_person
from simulator_interface.staging import FAR_FUTURE

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
        """Read everything about it that changes."""
        if self.kind == "robot":
            return (*sensed.pose[self.number].tolist(), *sensed.velocity[self.number].tolist())
        if self.kind == "human":
            place, pace = sensed.human_position[self.number], sensed.human_velocity[self.number]
            return (*place.tolist(), *pace.tolist())
        return tuple(sensed.furniture_pose[self.number].tolist()) if self.kind == "piece" else ()

    def place(self, sensed: Sensed) -> Vector:
        """Read its position; people who have left the building keep their last one."""
        state = self.state(sensed)
        if state and state[0] == state[0] and state[:2] != (self.at.x, self.at.y):
            self.at = Vector(state[0], state[1], self.at.z)
        return self.at

    def properties(self, sensed: Sensed) -> dict[str, Any]:
        """Read what Scenic calls dynamic properties."""
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


class TrackedObjects:
    """The objects of a scene, and those that appear while it runs."""

    def __init__(self, scene: Scene, episode: Episode) -> None:
        self._episode = episode
        self._names = names_in_world(world_objects(scene))
        self._bodies: dict[int, Body] = {}
        humans = episode.world.humans
        self._late = [i for i, human in enumerate(humans) if is_free_place(human)]
        self.reader = BehaviorReader(places_of_scene(scene), self._names)
        self.moving: list[Any] = []  #: objects whose state can change

    def __getitem__(self, obj: Any) -> Body:
        """Body of an object that was added."""
        return self._bodies[id(obj)]

    def add(self, obj: Any, last: Frame | None) -> None:
        """Track an object; ``last`` is the frame after which it appears, None: the start.

        Raises:
            SimulationCreationError: it cannot appear now; the message says why.
        """
        name = self._names.get(id(obj), "")
        if name:
            body = self._find(obj, name)
        elif not hasattr(obj, "kind"):
            body = Body("still", obj.position)
        else:
            body = self._add_late(obj, last.sensed.time if last is not None else 0.0)
        self._bodies[id(obj)] = body
        if body.kind != "still":
            self.moving.append(obj)

    def _find(self, obj: Any, name: str) -> Body:
        world = self._episode.world
        robots = [robot.name for robot in world.robots]
        humans = [human.name for human in world.humans]
        pieces = [item.name for item in world.movable_furniture()]
        if obj.kind in ("robot", "human") and name in humans:
            number = humans.index(name)
            return _body_of_person(obj, number)
        if obj.kind == "robot" and name in robots:
            return Body("robot", obj.position, robots.index(name))
        if name in pieces:
            return Body("piece", obj.position, pieces.index(name), float(obj.yaw))
        return Body("still", obj.position)  # or not active

    def _add_late(self, obj: Any, time: float) -> Body:
        """An object that appears while the episode runs."""
        if not getattr(obj, "active", True):
            return Body("still", obj.position)
        number = len(self._names) + 1
        name = str(getattr(obj, "name", None) or f"{obj.kind}_{number}")
        self._names[id(obj)] = name
        try:
            if obj.kind == "human" or (obj.kind == "robot" and obj.behavior is not None):
                return self._add_person(obj, name, time)
            if obj.kind in ("robot", "comms_outage"):
                raise WorldError(
                    f"a {obj.kind} cannot appear while the simulation runs; give it to the "
                    "scene (a late robot has joins_at, an outage has during)"
                )
            taken = {event.name for event in self._episode.world.events}
            end = float(obj.during[1]) if obj.kind == "blockage" else FAR_FUTURE
            self._episode.add_blockage(
                name if name not in taken else f"{name}_{number}",
                box_outline(obj),
                height=float(obj.height),
                end=end,
            )
        except InputError as error:
            raise SimulationCreationError(f"{name}: {error}") from error
        return Body("still", obj.position)

    def _add_person(self, obj: Any, name: str, time: float) -> Body:
        if not self._late:
            raise WorldError(
                "no place is free for people who appear while the simulation runs; write "
                "`param late_people = N`, as many as may appear"
            )
        number = self._late.pop(0)
        place = self._episode.world.humans[number]
        spec = late_person(obj, name, self.reader)
        entry = (WaitUntil(time=time), Appear(point=spec.route[0]))
        directives = spec.directives if _is_told_by_world(obj) else (StandStill(),)
        spec = replace(spec, name=place.name, directives=(*entry, *directives))
        self._episode.replace_person(number, spec)
        return _body_of_person(obj, number)


def _is_told_by_world(obj: Any) -> bool:
    """Whether the world holds a person's script, so that Scenic need not direct it."""
    return obj.behavior is None or is_library_behavior(obj.behavior)


def _body_of_person(obj: Any, number: int) -> Body:
    behavior = obj.behavior if _is_told_by_world(obj) else None
    return Body("human", obj.position, number, float(obj.yaw), behavior)
