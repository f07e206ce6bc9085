"""From a point of the unit cube to an accepted scene.

Two ways, named for what they are. :meth:`SceneSearch.exact` rejects whole scenes and draws
fresh ones until one is accepted: Scenic's own distribution, conditional on the requirements,
if the point is uniform. :meth:`SceneSearch.repair` redraws only what belongs to the objects a
rejection blames, which takes tens of attempts where whole-scene rejection takes millions; the
scenes it finds are valid, but their distribution is not exactly Scenic's. Either way the point
that comes out gives the scene by itself.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np
from scenic.core.distributions import RejectionException

from mrta_falsify.core.arrays import Array
from mrta_falsify.core.errors import WorldError
from mrta_falsify.core.seeding import stream
from scenic_worlds.checking import FastChecker, Rejection
from scenic_worlds.origins import origin_of
from scenic_worlds.placing import Placing
from scenic_worlds.primitives import randomness
from scenic_worlds.primitives.driver import Driver, Sample, bits
from scenic_worlds.primitives.plan import NodeRejected

MAX_ATTEMPTS = 3000  # scenes; at 1 to 10 ms each
PATIENCE = 40  # redraws of one object until what it shares with others is redrawn too
RESTART = 200  # attempts until everything is drawn again
FAILURES = 4  # times that an object finds no place at all, likewise
DRAWS = 10  # rejected places of single objects that count as one attempt
TOP = 5  # rejecters that an error names

#: sampled numbers in messages; without them the same reason counts as the same
_FRACTION = re.compile(r"-?\d+\.\d+")

T = TypeVar("T")


class RejectedScene(WorldError):  # noqa: N818 - a result of sampling, not a fault
    """No scene was accepted.

    Args:
        program: its name.
        attempts: scenes that were tried.
        rejections: how often each rejecter rejected.
        hopeless: the last rejecter does not depend on anything random.
        places: ``file:line`` of objects by name, for those that rejecters begin with.
    """

    def __init__(
        self,
        program: str,
        attempts: int,
        rejections: dict[str, int],
        *,
        hopeless: bool,
        places: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.attempts = attempts
        self.rejections = rejections
        worst = sorted(rejections.items(), key=lambda entry: (-entry[1], entry[0]))
        listing = "; ".join(f"{who} ({count} times)" for who, count in worst[:TOP])
        more = f"; and {len(worst) - TOP} others" if len(worst) > TOP else ""
        advice = (
            "this does not depend on anything random, so no sample can be valid"
            if hopeless
            else "leave more room, place fewer objects, or weaken what rejects most"
        )
        times = "1 attempt" if attempts == 1 else f"{attempts} attempts"
        drawn = sum(rejections.values())
        parts = ", with parts drawn anew within each" if drawn > attempts else ""
        made = [f"{name} is made at {at}" for name, at in places.items() if _begins(worst, name)]
        super().__init__(
            f"{program}: no scene accepted in {times}{parts}. Rejected by: {listing}{more}. "
            f"Hint: {advice}{''.join(f'; {text}' for text in made)}"
        )


def _begins(worst: list[tuple[str, int]], name: str) -> bool:
    """Whether the most frequent rejecter begins with an object's name."""
    return bool(worst) and worst[0][0].startswith(f"{name} ")


@dataclass(frozen=True, slots=True, eq=False)
class FoundScene(Generic[T]):
    """An accepted scene."""

    value: T  #: what ``accept`` made of it
    u: Array  #: (k,) gives the scene by itself
    attempts: int
    rejections: dict[str, int]


@dataclass(frozen=True, slots=True)
class _Blame:
    """Whom a rejection blames; units as bit sets."""

    who: str
    choices: tuple[int, ...]  #: redrawing any of these may help
    wide: int  #: everything that the rejection depends on
    is_place: bool = False  #: objects stand where they must not


class SceneSearch:
    """Finds accepted scenes of one program.

    Args:
        driver: of the program.
        checker: that the scenario's requirements were given to.
        name: of the program, for messages.
    """

    def __init__(self, driver: Driver, checker: FastChecker, name: str) -> None:
        self.driver = driver
        self.checker = checker
        self._name = name
        self._own = _ownership(driver)
        self._placing = Placing(driver, checker, self._own.geometry)
        self._soft = [r for r in checker.requirements if 0.0 <= getattr(r, "prob", 1) < 1.0]
        self._watched = self._draws_elsewhere = False

    def exact(
        self, u: Array, seed: int, accept: Callable[[Any], T], *, max_attempts: int = MAX_ATTEMPTS
    ) -> FoundScene[T]:
        """Try ``u``, then a seeded sequence of uniform points, until a scene is accepted.

        Args:
            u: ``(k,)`` in [0, 1].
            seed: of everything that u does not cover.
            accept: makes the result of a sample that passed the checker; may reject it by
                raising Scenic's ``RejectionException``.
            max_attempts: scenes to try, >= 1.

        Raises:
            RejectedScene: none of them was accepted.
        """
        return self._search(u, seed, accept, max_attempts, local=False)

    def repair(
        self, u: Array, seed: int, accept: Callable[[Any], T], *, max_attempts: int = MAX_ATTEMPTS
    ) -> FoundScene[T]:
        """Try ``u``, then points that differ in what was to blame, until a scene is accepted.

        Arguments and errors as of :meth:`exact`.
        """
        return self._search(u, seed, accept, max_attempts, local=True)

    def _search(
        self, u: Array, seed: int, accept: Callable[[Any], T], max_attempts: int, *, local: bool
    ) -> FoundScene[T]:
        driver = self.driver
        self._choose_soft_requirements(seed)
        numbers = stream(seed, "scene/repair" if local else "scene/exact")
        rejections: Counter[str] = Counter()
        strikes: Counter[int] = Counter()
        u, changed = np.array(u, dtype=np.float64), driver.all_units
        attempt = failures = 0
        sample = driver.begin()
        with randomness.seeded(seed, "scene"):
            begin = randomness.GeneratorState()
            for attempt in range(1, max_attempts + 1):
                if self._draws_elsewhere:
                    begin.restore()
                if not local or self._draws_elsewhere:
                    sample = driver.begin()
                result, blame = self._try(sample, u, changed, accept, begin)
                if blame is None:
                    assert result is not None
                    u.setflags(write=False)
                    return FoundScene(result, u, attempt, dict(sorted(rejections.items())))
                restart = not local or attempt % RESTART == 0
                if blame.is_place and not restart and not self._draws_elsewhere:
                    placed = self._placing.place(sample, u, numbers, rejections)
                    changed, failures = placed.units, failures + placed.is_stuck
                    restart = placed.is_stuck and failures % FAILURES == 0
                    if changed and not restart:
                        continue
                else:
                    rejections[_FRACTION.sub("...", blame.who)] += 1
                if not blame.wide:
                    raise self._rejected(attempt, rejections, hopeless=True)
                if rejections.total() > DRAWS * max_attempts:
                    break
                changed = driver.all_units if restart else _redraw(blame, strikes, numbers)
                mask = driver.coordinates(changed)
                u[mask] = numbers.random(int(mask.sum()))
        raise self._rejected(attempt, rejections, hopeless=False)

    def _rejected(
        self, attempts: int, rejections: Counter[str], *, hopeless: bool
    ) -> RejectedScene:
        origins = {name: origin_of(thing) for thing, name in self.driver.names.items()}
        places = {name: f"{at[0]}:{at[1]}" for name, at in origins.items() if at is not None}
        return RejectedScene(
            self._name, attempts, dict(rejections), hopeless=hopeless, places=places
        )

    def _try(
        self,
        sample: Sample,
        u: Array,
        changed: int,
        accept: Callable[[Any], T],
        begin: randomness.GeneratorState,
    ) -> tuple[T | None, _Blame | None]:
        try:
            sample.move(u, changed)
        except NodeRejected as rejected:
            return None, self._blame_node(rejected)
        if not self._watched:
            # a function of the program may draw random numbers that the driver does not know
            self._watched = True
            self._draws_elsewhere = not begin.is_current()
        message = self.checker.checkRequirements(sample.values)
        if message is not None:
            return None, self._blame_check(message)
        try:
            return accept(sample.values), None
        except RejectionException as error:
            return None, self._blame_world(str(error))

    def _choose_soft_requirements(self, seed: int) -> None:
        """Choose which ``require[p]`` hold, once per scene as Scenic does."""
        numbers = stream(seed, "scene/soft_requirements")
        for requirement in self._soft:
            requirement.active = bool(numbers.random() <= requirement.prob)

    # --- who is to blame -----------------------------------------------------------------

    def _blame_node(self, rejected: NodeRejected) -> _Blame:
        """Blame a value that cannot be computed: redraw what it alone uses, or all it uses."""
        private = rejected.units & ~self._own.shared
        return _Blame(rejected.reason, (private or rejected.units,), rejected.units)

    def _blame_check(self, message: Any) -> _Blame:
        last = self.checker.last
        if last is None:
            return self._blame_everything(str(message))
        if last.kind == "requirement":
            return self._blame_requirement(last)
        own = self._own
        choices = tuple(own.geometry[id(item)] for item in last.objects if own.geometry[id(item)])
        wide = 0
        for item in last.objects:
            wide |= self.driver.geometry_units(item)
        wide |= self.driver.units_of(getattr(last.source, "container", None))
        is_place = last.kind in ("containment", "collision")
        return _Blame(last.who, choices or (wide,), wide, is_place)

    def _blame_requirement(self, last: Rejection) -> _Blame:
        """Blame a user's requirement: redraw one of the values that it mentions."""
        used = {id(value) for value in getattr(last.source, "dependencies", ())}
        roots = [root for root in self.driver.roots if id(root.value) in used]
        ego = self.driver.scenario.egoObject  # Scenic counts it in whether it is used or not
        mentioned = [root for root in roots if root.value is not ego] or roots
        own = self._own.everything
        choices = []
        wide = 0
        for root in mentioned:
            units = self.driver.units_of(root.value)
            wide |= units
            choices.append(own.get(id(root.value), units) or units)
        for root in roots:
            wide |= self.driver.units_of(root.value)
        if len(choices) > 1:
            choices.append(wide)
        return _Blame(last.who, tuple(choices) or (wide,), wide)

    def _blame_world(self, message: str) -> _Blame:
        """Blame the values that contradict each other; messages begin with whose they are."""
        label = message.partition(":")[0].strip()
        units = self.driver.units_of_label(label)
        return _Blame(message, (units,), units) if units else self._blame_everything(message)

    def _blame_everything(self, who: str) -> _Blame:
        everything = self.driver.all_units
        return _Blame(who, (everything,), everything)


def _redraw(blame: _Blame, strikes: Counter[int], numbers: np.random.Generator) -> int:
    """Choose the units to draw again."""
    choice = blame.choices[int(numbers.integers(len(blame.choices)))]
    strikes[choice] += 1
    return blame.wide if strikes[choice] % PATIENCE == 0 else choice


@dataclass(frozen=True, slots=True)
class _Ownership:
    """Units of objects that no other object shares, except those computed from it."""

    geometry: dict[int, int]  #: those that decide where it is, by ``id``
    everything: dict[int, int]
    shared: int  #: units that several objects depend on


def _ownership(driver: Driver) -> _Ownership:
    objects = list(driver.names)
    users: dict[int, list[Any]] = {}
    for item in objects:
        for unit in bits(driver.units_of(item)):
            users.setdefault(unit, []).append(item)
    everything: dict[int, int] = {}
    for item in objects:
        units = 0
        for unit in bits(driver.units_of(item)):
            others = (other for other in users[unit] if other is not item)
            if all(driver.depends_on(other, item) for other in others):
                units |= 1 << unit
        everything[id(item)] = units
    geometry = {id(item): everything[id(item)] & driver.geometry_units(item) for item in objects}
    shared = 0
    for unit, items in users.items():
        if len(items) > 1:
            shared |= 1 << unit
    return _Ownership(geometry, everything, shared)
