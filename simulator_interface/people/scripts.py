"""Scripts: what people are told to do, directive after directive, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core import directives
from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.directives import Directive
from mrta_falsify.core.world import World
from simulator_interface.people.furnishings import Furnishings
from simulator_interface.people.margins import Bystanders
from simulator_interface.people.pushing import TOP_SPEED, Pusher, Pushers, Pushing
from simulator_interface.people.walking import Walker, Walking
from simulator_interface.staging import first_inside

SOON = 1e-9  # s; times are products of floats


@dataclass(slots=True, eq=False)
class Script:
    """Directives of one person and how far they are carried out."""

    directives: tuple[Directive, ...]
    index: int = 0  #: of the directive at work
    walker: Walker | None = None  #: of the directive at work
    left: float | None = None  #: of its waiting time [s]
    push: Pushing | None = None  #: of the directive at work

    @property
    def done(self) -> bool:
        """Whether everything is carried out."""
        return self.index >= len(self.directives)

    def go_on(self) -> None:
        """Turn to the next directive."""
        self.index += 1
        self.walker = self.left = self.push = None

    def suspend(self) -> None:
        """Let go of what is held; the way is planned anew when the script goes on."""
        self.walker = self.push = None


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a person does in the next tick; without target and velocity it stands."""

    target: Array | None = None  #: (2,) next point to walk to [m]
    speed: float = 0.0  #: desired [m/s]
    velocity: Array | None = None  #: (2,) [m/s]; walks exactly like this


STANDS = Step()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Now:
    """The moment at which scripts are carried out."""

    time: float  #: [s]
    around: Bystanders


class ScriptPlayer:
    """Carries out the scripts of a world's people."""

    def __init__(self, world: World, walking: Walking, dt: float) -> None:
        humans = world.humans
        self._walking = walking
        self._dt = dt
        self._speed = [human.speed for human in humans]
        self._robot_radius = np.array([robot.radius for robot in world.robots])
        self.furnishings = Furnishings(world)
        self._pushers = Pushers(world, self.furnishings, walking, dt)
        self.inside: BoolArray = first_inside(world)  #: (H,) as far as the directives go
        self.placed = np.full((len(humans), 2), np.nan)  #: (H, 2) put down in this tick [m]
        self._acts: dict[type, Callable[[int, Script, Any, Now], Step | None]] = {
            directives.FollowRoute: self._follow,
            directives.WalkTo: self._walk,
            directives.Wait: self._wait,
            directives.WaitUntil: self._wait_until,
            directives.StandStill: self._stop,
            directives.Push: self._push,
            directives.Appear: self._appear,
            directives.Leave: self._leave,
        }

    def set_speed(self, person: int, speed: float) -> None:
        """Give a person another speed of its own [m/s]."""
        self._speed[person] = speed

    def begin_tick(self) -> None:
        """Forget the people put down in the last tick."""
        if np.isfinite(self.placed).any():
            self.placed = np.full_like(self.placed, np.nan)

    def step(self, person: int, script: Script, now: Now) -> Step:
        """Say what a person does next; a directive that is done gives way to the next."""
        for _ in range(len(script.directives)):
            if script.done:
                break
            directive = script.directives[script.index]
            step = self._acts[type(directive)](person, script, directive, now)
            if step is not None:
                return step
            script.go_on()
        return STANDS

    # --- the directives; None: carried out ---------------------------------------------------

    def _follow(
        self, person: int, script: Script, directive: directives.FollowRoute, now: Now
    ) -> Step | None:
        return self._go(person, script, directive.route, directive.repeat, directive.speed, now)

    def _walk(
        self, person: int, script: Script, directive: directives.WalkTo, now: Now
    ) -> Step | None:
        return self._go(person, script, directive.point[None], False, directive.speed, now)

    def _go(
        self, person: int, script: Script, route: Array, repeat: bool, speed: float, now: Now
    ) -> Step | None:
        if not self.inside[person] or not len(route):
            return None
        position = now.around.person[person]
        if script.walker is None:
            script.walker = self._walking.set_out(
                route, repeat=repeat, speed=speed or self._speed[person], start=position
            )
        target = self._walking.target(script.walker, position, now.time)
        if not len(script.walker.way):
            return None
        return Step(target=target, speed=script.walker.speed)

    def _wait(
        self, person: int, script: Script, directive: directives.Wait, now: Now
    ) -> Step | None:
        left = directive.duration if script.left is None else script.left
        if left <= SOON:
            return None
        script.left = left - self._dt
        return STANDS

    def _wait_until(
        self, person: int, script: Script, directive: directives.WaitUntil, now: Now
    ) -> Step | None:
        return None if now.time >= directive.time - SOON else STANDS

    def _stop(
        self, person: int, script: Script, directive: directives.StandStill, now: Now
    ) -> Step | None:
        return STANDS

    def _push(
        self, person: int, script: Script, directive: directives.Push, now: Now
    ) -> Step | None:
        if not self.inside[person]:
            return None
        if script.push is None:
            speed = min(directive.speed or self._speed[person], TOP_SPEED)
            number = self.furnishings.number(directive.furniture)
            script.push = Pushing(
                number=number, goal=directive.point, speed=speed, keeps=directive.keeps
            )
        place = now.around.person[person]
        pusher = Pusher(person=person, place=place, time=now.time, around=now.around)
        step = self._pushers.step(script.push, pusher)
        if step.finished:
            return None
        return Step(target=step.target, speed=script.push.speed, velocity=step.velocity)

    def _appear(
        self, person: int, script: Script, directive: directives.Appear, now: Now
    ) -> Step | None:
        if self.inside[person]:
            return None
        place = self._walking.free_point(directive.point)
        offset = now.around.robot - place
        room = float(now.around.person_radius[person]) + self._robot_radius
        if (np.hypot(offset[:, 0], offset[:, 1]) < room).any():
            return STANDS
        self._set_inside(person, True)
        self.placed[person] = now.around.person[person] = place
        now.around.present[person] = True
        return None

    def _leave(
        self, person: int, script: Script, directive: directives.Leave, now: Now
    ) -> Step | None:
        if self.inside[person]:
            self._set_inside(person, False)
            now.around.present[person] = False
        return None

    def leave(self, person: int) -> None:
        """Let a person be outside from now on."""
        self._set_inside(person, False)

    def _set_inside(self, person: int, value: bool) -> None:
        self.inside = self.inside.copy()
        self.inside[person] = value
