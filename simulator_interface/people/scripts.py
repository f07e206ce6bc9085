"""People's errands: directives carried out one after the other, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrta_falsify.core.arrays import Array, BoolArray
from mrta_falsify.core.directives import (
    Appear,
    Directive,
    FollowRoute,
    Leave,
    Push,
    StandStill,
    Wait,
    WaitUntil,
    WalkTo,
)
from mrta_falsify.core.world import World
from simulator_interface.people.pushing import TOP_SPEED, Bystanders, Furnishings, Pushers, Pushing
from simulator_interface.people.walking import Walker, Walking
from simulator_interface.staging import first_inside

SOON = 1e-9  # s; times are products of floats


@dataclass(slots=True, eq=False)
class Errand:
    """Directives and how far they are carried out."""

    directives: tuple[Directive, ...]
    index: int = 0  #: of the directive at work
    walker: Walker | None = None  #: of the directive at work
    left: float | None = None  #: of its waiting time [s]
    push: Pushing | None = None

    @property
    def done(self) -> bool:
        """Whether everything is carried out."""
        return self.index >= len(self.directives)

    def go_on(self) -> None:
        """Turn to the next directive."""
        self.index += 1
        self.walker = self.left = self.push = None

    def suspend(self) -> None:
        """Let go of what is held; the way is looked for anew when the errand goes on."""
        self.walker = self.push = None


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a person does in the next tick; nothing given: it stands."""

    target: Array | None = None  #: (2,) next point to walk to [m]
    speed: float = 0.0  #: desired [m/s]
    velocity: Array | None = None  #: (2,) [m/s]; walks exactly like this


STANDS = Step()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Now:
    """The moment at which errands are carried out."""

    time: float  #: [s]
    around: Bystanders


class Errands:
    """Carries out the errands of a world's people."""

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
        self._acts: dict[type, Callable[[int, Errand, Any, Now], Step | None]] = {
            FollowRoute: self._follow,
            WalkTo: self._walk,
            Wait: self._wait,
            WaitUntil: self._wait_until,
            StandStill: self._stop,
            Push: self._push,
            Appear: self._appear,
            Leave: self._leave,
        }

    def set_speed(self, person: int, speed: float) -> None:
        """Give a person another speed of its own [m/s]."""
        self._speed[person] = speed

    def begin_tick(self) -> None:
        """Forget who was put down in the last tick."""
        if np.isfinite(self.placed).any():
            self.placed = np.full_like(self.placed, np.nan)

    def step(self, person: int, errand: Errand, now: Now) -> Step:
        """What a person does next; directives that are done give way to those after them."""
        for _ in range(len(errand.directives)):
            if errand.done:
                break
            directive = errand.directives[errand.index]
            step = self._acts[type(directive)](person, errand, directive, now)
            if step is not None:
                return step
            errand.go_on()
        return STANDS

    # --- the directives; None: carried out ---------------------------------------------------

    def _follow(self, person: int, errand: Errand, to_do: FollowRoute, now: Now) -> Step | None:
        return self._go(person, errand, to_do.route, to_do.repeat, to_do.speed, now)

    def _walk(self, person: int, errand: Errand, to_do: WalkTo, now: Now) -> Step | None:
        return self._go(person, errand, to_do.point[None], False, to_do.speed, now)

    def _go(
        self, person: int, errand: Errand, route: Array, repeat: bool, speed: float, now: Now
    ) -> Step | None:
        if not self.inside[person] or not len(route):
            return None
        position = now.around.person[person]
        if errand.walker is None:
            errand.walker = self._walking.set_out(
                route, repeat=repeat, speed=speed or self._speed[person], start=position
            )
        target = self._walking.target(errand.walker, position, now.time)
        if not len(errand.walker.way):
            return None
        return Step(target=target, speed=errand.walker.speed)

    def _wait(self, person: int, errand: Errand, to_do: Wait, now: Now) -> Step | None:
        left = to_do.duration if errand.left is None else errand.left
        if left <= SOON:
            return None
        errand.left = left - self._dt
        return STANDS

    def _wait_until(self, person: int, errand: Errand, to_do: WaitUntil, now: Now) -> Step | None:
        return None if now.time >= to_do.time - SOON else STANDS

    def _stop(self, person: int, errand: Errand, to_do: StandStill, now: Now) -> Step | None:
        return STANDS

    def _push(self, person: int, errand: Errand, to_do: Push, now: Now) -> Step | None:
        if not self.inside[person]:
            return None
        if errand.push is None:
            speed = min(to_do.speed or self._speed[person], TOP_SPEED)
            number = self.furnishings.number(to_do.furniture)
            errand.push = Pushing(number=number, goal=to_do.point, speed=speed)
        position = now.around.person[person]
        step = self._pushers.step(errand.push, person, position, now.time, now.around)
        if step.finished:
            return None
        return Step(target=step.target, speed=errand.push.speed, velocity=step.velocity)

    def _appear(self, person: int, errand: Errand, to_do: Appear, now: Now) -> Step | None:
        if self.inside[person]:
            return None
        place = self._walking.free_point(to_do.point)
        offset = now.around.robot - place
        room = float(now.around.person_radius[person]) + self._robot_radius
        if (np.hypot(offset[:, 0], offset[:, 1]) < room).any():
            return STANDS
        self._set_inside(person, True)
        self.placed[person] = now.around.person[person] = place
        now.around.present[person] = True
        return None

    def _leave(self, person: int, errand: Errand, to_do: Leave, now: Now) -> Step | None:
        if self.inside[person]:
            self._set_inside(person, False)
            now.around.present[person] = False
        return None

    def _set_inside(self, person: int, value: bool) -> None:
        self.inside = self.inside.copy()
        self.inside[person] = value
