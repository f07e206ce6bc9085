"""What compiles, but will not do what its author expects of a falsification campaign.

Each finding has a code:

``random-only-in-require``
    A random value that nothing but requirements refer to. Scenic keeps such values in a set
    without an order: its own seeds and scene files give them back mixed up.
``random-in-dict``
    A distribution inside a dict or set. Scenic samples into tuples and lists only; worlds
    would get the distribution instead of a value.
``undriven-mutation``
    ``mutate`` with noise that is not Scenic's own normal noise: one coordinate stands for all
    of it, and a small step changes everything.
``opaque-dimension``
    A random value without an inverse map: as above.
``property-as-requirement``
    A temporal ``require``, or a ``require`` inside a monitor or behaviour. Scenic throws away
    the runs that violate it, which are the ones that a search is for.
``sampler-ignored``
    Parameters of VerifAI's samplers; the sampler of a campaign is an option of the campaign.

Nothing here is an error; the program runs.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenic.core.distributions import Samplable, TupleDistribution, needsSampling
from scenic.core.object_types import Constructible, OrientationMutator, PositionMutator
from scenic.core.requirements import CompiledRequirement
from scenic.core.scenarios import Scenario

from mrta_falsify.core.candidate import SearchSpace
from scenic_worlds.checking import names_in_worlds
from scenic_worlds.primitives.leaves import DrivenLeaf, DrivenMutator, is_primitive
from scenic_worlds.requirements import requirement_file

SAMPLER_PARAMS = (
    "externalSampler",
    "externalSamplerRejectionFeedback",
    "verifaiSamplerParams",
    "verifaiSamplerType",
)


@dataclass(frozen=True, slots=True, order=True)
class Lint:
    """One finding."""

    where: str  #: ``file:line``, or the file where no line is known
    code: str
    name: str  #: of the value, parameter, object or requirement
    message: str


def lint_program(scenario: Scenario, path: Path, space: SearchSpace) -> tuple[Lint, ...]:
    """Findings on a compiled program, sorted by place.

    Args:
        scenario: compiled; driven or not.
        path: its file.
        space: what the driver found in it.
    """
    source = _Source(path)
    found = {
        *_only_in_requirements(scenario, source),
        *_random_in_dicts(scenario, source),
        *_mutations(scenario, source),
        *_opaque(space, source),
        *_temporal_requirements(scenario),
        *_requirements_while_running(source),
        *_ignored_samplers(scenario, source),
    }
    return tuple(sorted(found, key=_place))


def _place(lint: Lint) -> tuple[str, int, Lint]:
    file, _, line = lint.where.rpartition(":")
    return (file, int(line), lint) if line.isdigit() else (lint.where, 0, lint)


class _Source:
    """Lines of the program's file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.lines = path.read_text(encoding="utf-8", errors="replace").splitlines()

    def place(self, pattern: str) -> str:
        """``file:line`` of the first line that matches, the file alone if none does."""
        for number, line in enumerate(self.lines, start=1):
            if re.search(pattern, line.partition("#")[0]):
                return self.at(number)
        return str(self._path)

    def at(self, line: int) -> str:
        return f"{self._path}:{line}"

    def param(self, name: str) -> str:
        """Where a global parameter is given."""
        return self.place(rf"^\s*param\b.*\b{re.escape(name)}\s*=")

    def assignment(self, name: str) -> str:
        """Where a variable gets its value."""
        return self.place(rf"^\s*(?:\w+\s*,\s*)*{re.escape(name)}\s*(?:,\s*\w+\s*)*=[^=]")

    def object(self, name: str) -> str:
        """Where an object of that name is made; unknown if the name is put together."""
        return self.place(rf"\bname\s+['\"]{re.escape(name)}['\"]")


# --- randomness that only requirements reach -------------------------------------------------


def _only_in_requirements(scenario: Scenario, source: _Source) -> Iterator[Lint]:
    reached = _nodes([*scenario._instances, *scenario.params.values()])
    for requirement in _all_requirements(scenario):
        for name, value in _names_in(requirement):
            lonely = [node for i, node in _nodes([value]).items() if i not in reached]
            if not any(_is_drawn(node) for node in lonely):
                continue
            place = _requirement_place(requirement)
            yield Lint(
                where=source.assignment(name) if name else place,
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
    """Names and random values that a requirement was compiled with; no name: of a function."""
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
    """Everything random that ``values`` are made of, by ``id``."""
    found: dict[int, Samplable] = {}
    waiting = [value for value in values if needsSampling(value)]
    while waiting:
        value = waiting.pop()
        if id(value) in found:
            continue
        found[id(value)] = value
        waiting += [part for part in value._conditioned._dependencies if needsSampling(part)]
    return found


def _is_drawn(value: Any) -> bool:
    return is_primitive(value) or isinstance(value._conditioned, DrivenLeaf)


# --- distributions that stay distributions -----------------------------------------------------


def _random_in_dicts(scenario: Scenario, source: _Source) -> Iterator[Lint]:
    for name, value in scenario.params.items():
        for kind in sorted(_unsampled(value)):
            yield Lint(
                where=source.param(name),
                code="random-in-dict",
                name=f"param {name}",
                message=f"param {name} has a random value inside a {kind}, which Scenic does not "
                "sample; use a list or tuple, or a param of its own",
            )
    for item, label in names_in_worlds(scenario.objects).items():
        for name in sorted(item.properties):
            for kind in sorted(_unsampled(getattr(item, name))):
                yield Lint(
                    where=source.object(label),
                    code="random-in-dict",
                    name=f"{label}.{name}",
                    message=f"{label}.{name} has a random value inside a {kind}, which Scenic does "
                    "not sample; use a list or tuple",
                )


def _unsampled(value: Any) -> set[str]:
    """Kinds of container in ``value`` that hold a random value which will not be sampled."""
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


def _mutations(scenario: Scenario, source: _Source) -> Iterator[Lint]:
    for item, name in names_in_worlds(scenario.objects).items():
        thing = item._conditioned
        if not isinstance(thing, Constructible) or not _mutates(thing):
            continue
        for mutator in thing.mutator:
            own = mutator._mutator if isinstance(mutator, DrivenMutator) else mutator
            if own is None or type(own) in (PositionMutator, OrientationMutator):
                continue
            yield Lint(
                where=source.place(r"^\s*mutate\b"),
                code="undriven-mutation",
                name=name,
                message=f"mutate moves {name} by {type(own).__name__}, which has no inverse map; "
                "use Normal offsets in its specifiers",
            )


def _mutates(thing: Any) -> bool:
    return bool(needsSampling(thing.mutationScale) or thing.mutationScale != 0)


def _opaque(space: SearchSpace, source: _Source) -> Iterator[Lint]:
    for dimension in space.dimensions:
        if dimension.kind != "opaque" or ".mutation" in dimension.name:
            continue
        owner, _, _ = dimension.name.partition(".")
        yield Lint(
            where=source.object(owner),
            code="opaque-dimension",
            name=dimension.name,
            message=f"{dimension.name} has no inverse map: a small step of its coordinate changes "
            "its value completely",
        )


# --- properties under test ---------------------------------------------------------------------


def _temporal_requirements(scenario: Scenario) -> Iterator[Lint]:
    for requirement in scenario.requirements:
        if not requirement.proposition.has_temporal_operator:
            continue
        place = _requirement_place(requirement)
        given = str(requirement.name or "")
        name = "" if given == f"requirement on line {requirement.line}" else given
        yield Lint(
            where=place,
            code="property-as-requirement",
            name=name or "require",
            message="a temporal require throws away every run that violates it; to find such "
            "runs, leave it out and name a specification, as --spec stl:FORMULA",
        )


def _requirements_while_running(source: _Source) -> Iterator[Lint]:
    """``require`` inside the blocks that run during a simulation."""
    block, depth = "", 0
    for number, line in enumerate(source.lines, start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        indent = len(line) - len(line.lstrip())
        if block and indent <= depth:
            block = ""
        header = re.match(r"(monitor|behavior)\s+(\w+)", text)
        if header and text.endswith(":"):
            block, depth = f"{header[1]} {header[2]}", indent
        elif block and re.match(r"require\b", text):
            yield Lint(
                where=source.at(number),
                code="property-as-requirement",
                name=block,
                message=f"require inside {block} throws away every run that violates it; to find "
                "such runs, leave it out and name a specification, as --spec stl:FORMULA",
            )


def _requirement_place(requirement: CompiledRequirement) -> str:
    return f"{requirement_file(requirement)}:{requirement.line}"


# --- samplers ------------------------------------------------------------------------------------


def _ignored_samplers(scenario: Scenario, source: _Source) -> Iterator[Lint]:
    for name in SAMPLER_PARAMS:
        if name in scenario.params:
            yield Lint(
                where=source.param(name),
                code="sampler-ignored",
                name=f"param {name}",
                message=f"param {name} has no effect here; choose a sampler with "
                "`mrta-falsify campaign --sampler NAME`",
            )
