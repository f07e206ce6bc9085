"""Whether a sampled scene is valid: Scenic's own verdict, reached faster, and by whom.

:class:`FastChecker` takes the place of Scenic's sample checkers
(``scenario.setSampleChecker``). It accepts and rejects exactly what
``scenic.core.sample_checking.BasicChecker`` does, and in addition says who is to blame.

Where the speed comes from: furniture has a flat box footprint. Such objects are tested for
containment with one vectorised call per container, and for collisions through one spatial
index, by the predicates that Scenic applies one pair at a time. All other shapes and regions
go to Scenic's own methods, collisions only where bounding spheres come near each other. What
is known of an object is kept while samples hold the same object, as they mostly do in local
resampling.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from scenic.core.distributions import RejectionException
from scenic.core.regions import PolygonalFootprintRegion, PolygonalRegion
from scenic.core.requirements import (
    BlanketCollisionRequirement,
    ContainmentRequirement,
    IntersectionRequirement,
    NonVisibilityRequirement,
    SamplingRequirement,
    VisibilityRequirement,
)
from scenic.core.sample_checking import SampleChecker

from scenic_worlds.requirements import is_falsified, requirement_place, requirement_text

NEAR = 1e-3  # m, margin of bounding spheres; mesh libraries compare with about 1e-6

Kind: TypeAlias = Literal["containment", "collision", "visibility", "requirement"]
Sample: TypeAlias = Mapping[Any, Any]  # object or region of the program -> sampled one


@dataclass(frozen=True, slots=True, eq=False)
class Rejection:
    """Why a sample was rejected."""

    kind: Kind
    objects: tuple[Any, ...]  #: objects of the program (not of the sample) that are to blame
    names: tuple[str, ...]  #: of ``objects``, as worlds and reports call them
    source: SamplingRequirement  #: Scenic's requirement
    requirement: str  #: name of a user's requirement, empty for built-in ones
    where: str  #: ``file:line`` of a user's requirement, empty for built-in ones
    message: str

    @property
    def who(self) -> str:
        """Stable text that tells rejecters apart, for counting; regions may differ."""
        if self.kind == "containment":
            return f"{self.names[0]} is not inside its region"
        return self.message


class FastChecker(SampleChecker):  # type: ignore[misc] # Scenic has no types
    """Scenic's accept or reject, vectorised.

    Attributes:
        last: why the last sample was rejected; None if it was accepted.
        counts: how often each rejecter rejected, by :attr:`Rejection.who`.
    """

    def __init__(self) -> None:
        super().__init__()
        self.last: Rejection | None = None
        self.counts: Counter[str] = Counter()

    def setRequirements(self, requirements: Iterable[SamplingRequirement]) -> None:  # noqa: N802
        """Take over the requirements of a scenario; called by Scenic."""
        super().setRequirements(requirements)
        pairs = [r for r in self.requirements if type(r) is IntersectionRequirement]
        inside = [r for r in self.requirements if type(r) is ContainmentRequirement]
        handled = (IntersectionRequirement, ContainmentRequirement, BlanketCollisionRequirement)
        self._others = tuple(
            r for r in self.requirements if type(r) not in handled and not r.optional
        )
        self._names = names_in_worlds(_objects_of(self.requirements))
        self._containment = _Containment(inside)
        self._collisions = _Collisions(pairs)

    def checkRequirementsInner(self, sample: Sample) -> str | None:  # noqa: N802
        """Say what is violated first, None if nothing is; called by Scenic.

        Raises:
            FormatError: a requirement of the user's cannot be evaluated.
        """
        self.last = self._first_violation(sample)
        if self.last is None:
            return None
        self.counts[self.last.who] += 1
        return self.last.message

    def all_outside(self, sample: Sample) -> dict[Any, Any]:
        """Find every object of the program that is outside its region, with that region.

        Args:
            sample: a complete sample, valid or not.
        """
        return {r.obj: sample[r.container] for r in self._containment.all_outside(sample)}

    def _first_violation(self, sample: Sample) -> Rejection | None:
        outside = self._containment.first_outside(sample)
        if outside is not None:
            return self._rejection(
                "containment", outside, (outside.obj,), sample[outside.container]
            )
        pair = self._collisions.first_hit(sample)
        if pair is not None:
            return self._rejection("collision", pair, (pair.objA, pair.objB))
        for requirement in self._others:
            if requirement.active and is_falsified(requirement, sample):
                return self._blame(requirement)
        return None

    def _blame(self, requirement: SamplingRequirement) -> Rejection:
        if isinstance(requirement, VisibilityRequirement):
            pair = (requirement.source, requirement.target)
            return self._rejection("visibility", requirement, pair)
        objects = tuple(
            item for item in self._names if item in _dependencies_by_identity(requirement)
        )
        return self._rejection("requirement", requirement, objects)

    def _rejection(
        self,
        kind: Kind,
        source: SamplingRequirement,
        objects: Sequence[Any],
        container: Any = None,
    ) -> Rejection:
        names = tuple(self._names.get(item, _class_name(item)) for item in objects)
        where, requirement = "", ""
        if kind == "containment":
            message = f"{names[0]} is not inside {region_name(container)}"
        elif kind == "collision":
            message = f"{names[0]} collides with {names[1]}"
        elif kind == "visibility":
            hidden = isinstance(source, NonVisibilityRequirement)
            message = f"{names[1]} is {'' if hidden else 'not '}visible from {names[0]}"
        else:
            where, requirement = requirement_place(source), str(source.name or "")
            message = f"{where}: {requirement_text(source)} does not hold"
        return Rejection(
            kind=kind,
            objects=tuple(objects),
            names=names,
            source=source,
            requirement=requirement,
            where=where,
            message=message,
        )


# --- containment -----------------------------------------------------------------------------


class _Containment:
    """Objects against the regions that must contain them."""

    def __init__(self, requirements: Sequence[ContainmentRequirement]) -> None:
        self._requirements = tuple(requirements)
        self._known: list[tuple[Any, Any]] = [(None, None)] * len(self._requirements)

    def first_outside(self, sample: Sample) -> ContainmentRequirement | None:
        """Find the first requirement that fails."""
        return next(iter(self.all_outside(sample)), None)

    def all_outside(self, sample: Sample) -> list[ContainmentRequirement]:
        """Find all requirements that fail, in Scenic's order.

        What passed before with the same object and the same region is not asked again.
        """
        batches: dict[int, list[int]] = {}
        for i, requirement in enumerate(self._requirements):
            thing, container = sample[requirement.obj], sample[requirement.container]
            known = self._known[i]
            if known[0] is thing and known[1] is container:
                continue
            batches.setdefault(id(container), []).append(i)
        failed: list[int] = []
        for batch in batches.values():
            failed += self._outside(sample, batch)
        return [self._requirements[i] for i in sorted(failed)]

    def _outside(self, sample: Sample, batch: Sequence[int]) -> list[int]:
        """Test a batch with one container: those that fail; the others are remembered."""
        container = sample[self._requirements[batch[0]].container]
        things = [sample[self._requirements[i].obj] for i in batch]
        footprint = _footprint_of(container)
        inside = np.zeros(len(batch), dtype=bool)
        quick = np.array([footprint is not None and thing._isConvex for thing in things])
        if quick.any():
            outlines = [
                thing._boundingPolygon for thing, fast in zip(things, quick, strict=True) if fast
            ]
            inside[quick] = shapely.contains(footprint, outlines)
        for j in np.flatnonzero(~quick):
            inside[j] = _contains(container, things[j])
        for i, thing, holds in zip(batch, things, inside, strict=True):
            if holds:
                self._known[i] = (thing, container)
        return [i for i, holds in zip(batch, inside, strict=True) if not holds]


def _contains(container: Any, thing: Any) -> bool:
    try:
        return bool(container.containsObject(thing))
    except RejectionException:
        return False


def _footprint_of(container: Any) -> Any:
    """Find the outline whose ``contains`` is the container's own test of convex objects."""
    if type(container) is PolygonalFootprintRegion:
        return container.polygons
    method = getattr(type(container), "containsObject", None)
    if method is PolygonalRegion.containsObject:
        return container.footprint.polygons
    return None


# --- collisions ------------------------------------------------------------------------------


class _Collisions:
    """Objects against each other."""

    def __init__(self, requirements: Sequence[IntersectionRequirement]) -> None:
        objects: dict[Any, None] = {}
        for requirement in requirements:
            objects[requirement.objA] = None
            objects[requirement.objB] = None
        self._objects = tuple(objects)
        number = {item: i for i, item in enumerate(self._objects)}
        # Which pairs are asked for is Scenic's business; all others may overlap.
        self._pairs = {(number[r.objA], number[r.objB]): r for r in requirements}
        count = len(self._objects)
        self._seen: list[Any] = [None] * count
        self._outlines: NDArray[np.object_] = np.full(count, None, dtype=object)
        self._is_flat = np.zeros(count, dtype=bool)
        self._collides = np.zeros(count, dtype=bool)
        self._middle = np.zeros(count)  #: z of flat boxes [m]
        self._height = np.zeros(count)  #: of flat boxes [m]
        self._low = np.zeros(count)
        self._high = np.zeros(count)
        self._clear: dict[tuple[int, int], tuple[Any, Any]] = {}

    def first_hit(self, sample: Sample) -> IntersectionRequirement | None:
        """Find the first pair, in Scenic's order, that collides by Scenic's own test."""
        for i, item in enumerate(self._objects):
            thing = sample[item]
            if self._seen[i] is not thing:
                self._fill_row(i, thing)
        for a, b in self._near_pairs():
            pair = (a, b) if (a, b) in self._pairs else (b, a)
            if pair in self._pairs and self._hit(*pair):
                return self._pairs[pair]
        return None

    def _fill_row(self, i: int, thing: Any) -> None:
        self._seen[i] = thing
        self._collides[i] = not thing.allowCollisions
        self._is_flat[i] = thing._isPlanarBox
        if thing._isPlanarBox:
            self._outlines[i] = thing._boundingPolygon
            self._middle[i], self._height[i] = thing.position.z, thing.height
            reach = thing.height / 2.0 + NEAR
            self._low[i], self._high[i] = thing.position.z - reach, thing.position.z + reach
            return
        space = thing.occupiedSpace
        x, y, z = (float(value) for value in space.position)
        reach = float(space._circumradius) + NEAR
        self._outlines[i] = shapely.box(x - reach, y - reach, x + reach, y + reach)
        self._low[i], self._high[i] = z - reach, z + reach

    def _near_pairs(self) -> list[tuple[int, int]]:
        """List the pairs that may collide, sorted; flat boxes among them overlap in plan."""
        rows = np.flatnonzero(self._collides)
        if len(rows) < 2:
            return []
        outlines = self._outlines[rows]
        first, second = shapely.STRtree(outlines).query(outlines)
        once = first < second
        a, b = rows[first[once]], rows[second[once]]
        flat = self._is_flat[a] & self._is_flat[b]
        # As Scenic's Object.intersects computes it, to the last bit.
        apart = np.abs(self._middle[a] - self._middle[b]) > (self._height[a] + self._height[b]) / 2
        far = (self._low[a] > self._high[b]) | (self._low[b] > self._high[a])
        keep = ~np.where(flat, apart, far)
        keep[keep & flat] = shapely.intersects(
            self._outlines[a[keep & flat]], self._outlines[b[keep & flat]]
        )
        return sorted(zip(a[keep].tolist(), b[keep].tolist(), strict=True))

    def _hit(self, a: int, b: int) -> bool:
        if self._is_flat[a] and self._is_flat[b]:
            return True
        things = (self._seen[a], self._seen[b])
        known = self._clear.get((a, b))
        if known is not None and known[0] is things[0] and known[1] is things[1]:
            return False
        try:
            if things[0].intersects(things[1]):
                return True
        except RejectionException:
            return True
        self._clear[a, b] = things
        return False


# --- names -----------------------------------------------------------------------------------


def names_in_worlds(objects: Iterable[Any]) -> dict[Any, str]:
    """Name a program's objects as its worlds do.

    Args:
        objects: of the program, in its order.

    Returns:
        Given names; otherwise the kind (or class) and a number that counts that kind.
    """
    names: dict[Any, str] = {}
    counts: Counter[str] = Counter()
    for item in objects:
        kind = getattr(item, "kind", None)
        kind = kind if isinstance(kind, str) else _class_name(item)
        counts[kind] += 1
        given = getattr(item, "name", None)
        names[item] = given if isinstance(given, str) and given else f"{kind}_{counts[kind]}"
    return names


def _class_name(item: Any) -> str:
    return type(item).__name__.lower()


def region_name(region: Any) -> str:
    """Name the region of an object in a sentence."""
    name = getattr(region, "name", None)
    return f"its region {name!r}" if isinstance(name, str) and name else "its region"


def _objects_of(requirements: Iterable[SamplingRequirement]) -> tuple[Any, ...]:
    """List a scenario's objects in its order; Scenic's blanket requirement has them all."""
    found: dict[Any, None] = {}
    for requirement in requirements:
        if isinstance(requirement, BlanketCollisionRequirement):
            found.update(dict.fromkeys(requirement.objects))
        elif isinstance(requirement, IntersectionRequirement):
            found.update(dict.fromkeys((requirement.objA, requirement.objB)))
        elif isinstance(requirement, ContainmentRequirement):
            found[requirement.obj] = None
        elif isinstance(requirement, VisibilityRequirement):
            found.update(dict.fromkeys((requirement.source, requirement.target)))
    return tuple(found)


def _dependencies_by_identity(requirement: SamplingRequirement) -> frozenset[Any]:
    return frozenset(getattr(requirement, "dependencies", ()))
