"""Random values that a campaign cannot keep, cannot sample, or cannot move smoothly."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from scenic.core.distributions import Samplable, TupleDistribution, needsSampling
from scenic.core.object_types import Constructible, OrientationMutator, PositionMutator
from scenic.core.requirements import CompiledRequirement
from scenic.core.scenarios import Scenario

from mrta_falsify.core.candidate import SearchSpace
from scenic_worlds.checking import names_in_worlds
from scenic_worlds.lint.program_lines import Lint, ProgramText
from scenic_worlds.primitives.leaves import DrivenLeaf, DrivenMutator, is_primitive
from scenic_worlds.requirements import requirement_file

# --- randomness that only requirements reach -------------------------------------------------


def only_in_requirements(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find random values that only requirements refer to."""
    reached = _nodes([*scenario._instances, *scenario.params.values()])
    for requirement in _all_requirements(scenario):
        for name, value in _names_in(requirement):
            lonely = [node for i, node in _nodes([value]).items() if i not in reached]
            if not any(_is_drawn(node) for node in lonely):
                continue
            place = f"{requirement_file(requirement)}:{requirement.line}"
            yield Lint(
                where=text.assignment(name) if name else place,
                code="random-only-in-require",
                name=name or "a value",
                message=f"{name or 'a random value'} is used by the requirement at {place} only; "
                "make it a param or a property of an object, so that scenes keep it",
            )


def _all_requirements(scenario: Scenario) -> tuple[CompiledRequirement, ...]:
    return (
        *scenario.requirements,
        *scenario.monitors,
        *scenario.terminationConditions,
        *scenario.terminateSimulationConditions,
        *scenario.recordedExprs,
        *scenario.recordedInitialExprs,
        *scenario.recordedFinalExprs,
    )


def _names_in(requirement: CompiledRequirement) -> Iterator[tuple[str, Any]]:
    """Yield a requirement's names and random values; those of functions have no name."""
    free = requirement.closure.__code__.co_freevars
    cells = requirement.closure.__closure__ or ()
    held = {name: cell.cell_contents for name, cell in zip(free, cells, strict=True)}
    named: set[int] = set()
    for name, value in held.get("globalBindings", {}).items():
        named.add(id(value))
        if needsSampling(value):
            yield name, value
    for _, value in held.get("cells", ()):
        if id(value) not in named and needsSampling(value):
            yield "", value


def _nodes(values: Iterable[Any]) -> dict[int, Samplable]:
    """Collect everything random that ``values`` are made of, by ``id``."""
    found: dict[int, Samplable] = {}
    waiting = [value for value in values if needsSampling(value)]
    while waiting:
        value = waiting.pop()
        if id(value) in found:
            continue
        found[id(value)] = value
        waiting += [part for part in value._conditioned._dependencies if needsSampling(part)]
    return found


def drawn_values(values: Iterable[Any]) -> dict[int, Samplable]:
    """Collect the random primitives that ``values`` are made of, by ``id``."""
    return {number: node for number, node in _nodes(values).items() if _is_drawn(node)}


def required_values(scenario: Scenario) -> list[Any]:
    """List random values that requirements, monitors and records refer to."""
    return [v for requirement in _all_requirements(scenario) for _, v in _names_in(requirement)]


def _is_drawn(value: Any) -> bool:
    return is_primitive(value) or isinstance(value._conditioned, DrivenLeaf)


# --- distributions that stay distributions -----------------------------------------------------


def random_in_dicts(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find distributions inside dicts and sets, which Scenic does not sample."""
    for name, value in scenario.params.items():
        for kind in sorted(_unsampled(value)):
            yield Lint(
                where=text.param(name),
                code="random-in-dict",
                name=f"param {name}",
                message=f"param {name} has a random value inside a {kind}, which Scenic does not "
                "sample; use a list or tuple, or a param of its own",
            )
    for item, label in names_in_worlds(scenario.objects).items():
        for name in sorted(item.properties):
            for kind in sorted(_unsampled(getattr(item, name))):
                yield Lint(
                    where=text.object(item, label),
                    code="random-in-dict",
                    name=f"{label}.{name}",
                    message=f"{label}.{name} has a random value inside a {kind}, which Scenic does "
                    "not sample; use a list or tuple",
                )


def _unsampled(value: Any) -> set[str]:
    """Name the kinds of container in ``value`` whose random values are not sampled."""
    if isinstance(value, dict):
        return {"dict"} if any(map(_holds_random, (*value, *value.values()))) else set()
    if isinstance(value, (set, frozenset)):
        return {"set"} if any(map(_holds_random, value)) else set()
    if isinstance(value, TupleDistribution):
        value = value.coordinates
    if isinstance(value, (list, tuple)):
        return {kind for part in value for kind in _unsampled(part)}
    return set()


def _holds_random(value: Any) -> bool:
    if needsSampling(value):
        return True
    if isinstance(value, dict):
        return any(map(_holds_random, (*value, *value.values())))
    if isinstance(value, (list, tuple, set, frozenset)):
        return any(map(_holds_random, value))
    return False


# --- what the driver cannot move smoothly ------------------------------------------------------


def undriven_mutations(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find objects that mutate by noise without an inverse map."""
    for item, name in names_in_worlds(scenario.objects).items():
        thing = item._conditioned
        if not isinstance(thing, Constructible) or not _mutates(thing):
            continue
        for mutator in thing.mutator:
            own = mutator._mutator if isinstance(mutator, DrivenMutator) else mutator
            if own is None or type(own) in (PositionMutator, OrientationMutator):
                continue
            yield Lint(
                where=text.place(r"^\s*mutate\b"),
                code="undriven-mutation",
                name=name,
                message=f"mutate moves {name} by {type(own).__name__}, which has no inverse map; "
                "use Normal offsets in its specifiers",
            )


def _mutates(thing: Any) -> bool:
    return bool(needsSampling(thing.mutationScale) or thing.mutationScale != 0)


def opaque_dimensions(scenario: Scenario, space: SearchSpace, text: ProgramText) -> Iterator[Lint]:
    """Find dimensions whose values have no inverse map."""
    things = {name: item for item, name in names_in_worlds(scenario.objects).items()}
    for dimension in space.dimensions:
        if dimension.kind != "opaque" or ".mutation" in dimension.name:
            continue
        owner, _, _ = dimension.name.partition(".")
        yield Lint(
            where=text.object(things.get(owner), owner),
            code="opaque-dimension",
            name=dimension.name,
            message=f"{dimension.name} has no inverse map: a small step of its coordinate changes "
            "its value completely",
        )
