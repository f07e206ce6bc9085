"""Finds every random primitive of a compiled program, in a fixed order, and names it.

Scenic keeps the values that only requirements use in a set, whose order differs from process
to process; here they come in the order in which the program's requirements mention them.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import Any, Literal, TypeAlias

from scenic.core.distributions import (
    FunctionDistribution,
    MethodDistribution,
    MultiplexerDistribution,
    OperatorDistribution,
    Samplable,
    TupleDistribution,
    UniformDistribution,
    needsSampling,
    toDistribution,
)
from scenic.core.object_types import Constructible
from scenic.core.scenarios import Scenario
from scenic.core.vectors import Vector

from scenic_worlds.checking import names_in_worlds
from scenic_worlds.primitives.leaves import is_primitive


@dataclass(frozen=True, slots=True)
class Root:
    """A value of the program that scenes contain, or that a requirement uses."""

    name: str
    value: Samplable


@dataclass(frozen=True, slots=True)
class Found:
    """A random primitive."""

    name: str  #: object and property, for example "bed_3.position"
    value: Samplable
    is_choice: bool  #: picks one of a list of options
    options: tuple[Any, ...]  #: these
    words: tuple[str, ...]  #: what each of them is: Python's text of a plain value, or a name


#: what the program makes of a value: the property itself, it times ``deg``, a part of it
Within: TypeAlias = Literal["", "deg", "part"]


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A value on the way to its primitives."""

    name: str
    value: Samplable
    is_choice: bool
    options: tuple[Any, ...] = ()
    within: Within = ""


#: properties that Scenic computes from others; what they are made of is named after the others
DERIVED = frozenset(
    f".{name}"
    for name in ("pitch", "roll", "parentOrientation", "orientation", "heading", "baseOffset")
)
ANGLES = (".yaw", ".heading", ".roll", ".pitch")  # properties that are angles [rad]
MAX_LETTERS = 40  # of an option in words
DERIVED_DEPTH = 100  # counts as so many steps, so that other ways to a primitive come first
#: what Scenic's random primitives are made of
PRIMITIVE_PARTS = ("low", "high", "mean", "stddev", "region")


def roots_of(scenario: Scenario) -> tuple[Root, ...]:
    """List everything that has to be sampled, in the order of the program.

    Objects come first, then points that only specifiers use, global parameters, what
    requirements use, and values that behaviours refer to.
    """
    names = names_in_worlds(scenario.objects)
    objects = [Root(name, item) for item, name in names.items()]
    others = [item for item in scenario._instances if item not in names]
    roots = objects + [Root(f"point_{i + 1}", item) for i, item in enumerate(others)]
    for name, value in scenario.params.items():
        if isinstance(value, Samplable):
            if name == "stack_params":
                roots.extend(_stack_params(value))
            roots.append(Root("tasks" if name == "tasks" else f"param {name}", value))
    for name, value in _requirement_values(scenario):
        roots.append(Root(name, value))
    for module, namespace in scenario.behaviorNamespaces.items():
        for name, value in namespace.items():
            if isinstance(value, Samplable):
                roots.append(Root(f"{module}.{name}", value))
    unique: dict[int, Root] = {}
    for root in roots:
        if needsSampling(root.value):
            unique.setdefault(id(root.value), root)
    return tuple(unique.values())


def find_primitives(roots: tuple[Root, ...]) -> tuple[Found, ...]:
    """Find the random primitives that the roots are made of, sorted by root.

    A primitive that several roots share belongs to the one that mentions it most directly, and
    to the first of those.
    """
    seen: set[int] = set()
    queue = [(0, i, i, _Place(root.name, root.value, False)) for i, root in enumerate(roots)]
    order = count(len(roots))
    found: list[tuple[int, int, Found]] = []
    while queue:
        depth, _, root, place = heappop(queue)
        name, value = place.name, place.value
        if id(value) in seen:
            continue
        seen.add(id(value))
        proxy = value._conditioned
        if is_primitive(proxy):
            words = _words(place)
            one = Found(name, value, place.is_choice, place.options, words)
            found.append((root, len(found), one))
        chooses = isinstance(proxy, (MultiplexerDistribution, UniformDistribution))
        for suffix, part in _parts(proxy):
            if needsSampling(part):
                deeper = depth + (DERIVED_DEPTH if suffix in DERIVED else 1)
                is_index = chooses and suffix == ""
                is_listed = is_index and isinstance(proxy, MultiplexerDistribution)
                options = tuple(proxy.options) if is_listed else ()
                within = _within(proxy, place.within)
                part_place = _Place(name + suffix, part, is_index, options, within)
                heappush(queue, (deeper, next(order), root, part_place))
    found.sort(key=lambda entry: entry[:2])
    return _with_unique_names([entry[2] for entry in found])


def _within(value: Any, outer: Within) -> Within:
    """Say what the program makes of the parts of a value."""
    if not isinstance(value, OperatorDistribution) or value.operator == "__getitem__":
        return outer
    factors = [value.object, *value.operands]
    is_degrees = value.operator in ("__mul__", "__rmul__") and any(
        isinstance(factor, float) and math.isclose(factor, math.radians(1.0)) for factor in factors
    )
    return "deg" if is_degrees and not outer else "part"


def _words(place: _Place) -> tuple[str, ...]:
    """Put the options of a choice in words that a person can cite."""
    is_angle = place.within == "deg" or place.name.endswith(ANGLES)
    told = []
    for number, option in enumerate(place.options, start=1):
        is_number = isinstance(option, (int, float)) and not isinstance(option, bool)
        if place.within == "part":
            told.append(f"option {_word(option, number)}")
        elif is_number and is_angle:
            degrees = option if place.within == "deg" else math.degrees(option)
            told.append(f"{round(degrees, 6):g} deg")
        else:
            told.append(_word(option, number))
    return tuple(told)


def _word(option: Any, number: int) -> str:
    name = getattr(option, "name", None)
    if isinstance(name, str):
        return name
    if needsSampling(option):
        return f"option {number}, which is random itself"
    if isinstance(option, (list, tuple)):
        text = "[" + ", ".join(_word(part, k) for k, part in enumerate(option, start=1)) + "]"
        return text if len(text) <= MAX_LETTERS else f"option {number}, a list of {len(option)}"
    text = repr(option)
    is_short = len(text) <= MAX_LETTERS and " at 0x" not in text
    return text if is_short else f"option {number}, a {type(option).__name__}"


def _with_unique_names(found: list[Found]) -> tuple[Found, ...]:
    counts: dict[str, int] = {}
    unique = []
    for entry in found:
        counts[entry.name] = times = counts.get(entry.name, 0) + 1
        name = entry.name if times == 1 else f"{entry.name}#{times}"
        unique.append(dataclasses.replace(entry, name=name))
    return tuple(unique)


def _stack_params(value: Samplable) -> Iterator[Root]:
    """Give the random ones among pairs ``(name, number)`` under the names that the stack knows."""
    for pair in value.coordinates if isinstance(value, TupleDistribution) else ():
        if isinstance(pair, TupleDistribution) and len(pair.coordinates) == 2:
            name, number = pair.coordinates
            if isinstance(name, str) and isinstance(number, Samplable):
                yield Root(f"stack {name}", number)


# --- what values are made of -----------------------------------------------------------------


def _parts(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield suffix and value of each part; the same part may come twice."""
    yield from _named_parts(value)
    for part in value._dependencies:
        yield "", part


def _named_parts(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Constructible):
        for name in value.properties:
            yield f".{name}", getattr(value, name)
    elif isinstance(value, TupleDistribution):
        yield from _numbered(value.coordinates)
    elif isinstance(value, Vector):
        yield from zip((".x", ".y", ".z"), value.coordinates, strict=True)
    elif isinstance(value, MultiplexerDistribution):
        yield "", value.index
        yield from _numbered(value.options)
    elif isinstance(value, UniformDistribution):
        yield "", value.selector
    elif isinstance(value, (FunctionDistribution, MethodDistribution)):
        yield from _argument_parts(value)
    elif is_primitive(value):
        own = vars(value)
        yield from ((f".{name}", own[name]) for name in PRIMITIVE_PARTS if name in own)


def _numbered(parts: Iterable[Any]) -> Iterator[tuple[str, Any]]:
    return ((f"[{i}]", part) for i, part in enumerate(parts))


def _argument_parts(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a call's arguments; a single random one given by position has no name."""
    for name, part in value.kwargs.items():
        yield f".{name}", part
    lazy = [part for part in value.arguments if needsSampling(part)]
    names: list[str] = []
    if len(lazy) > 1 and isinstance(value, FunctionDistribution):
        names = _parameter_names(value.function)
    for i, part in enumerate(value.arguments):
        yield (f".{names[i]}" if i < len(names) else ""), part


def _parameter_names(function: Any) -> list[str]:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return []
    by_position = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return [parameter.name for parameter in parameters if parameter.kind in by_position]


# --- what requirements use -------------------------------------------------------------------


def _requirement_values(scenario: Scenario) -> list[tuple[str, Samplable]]:
    """List random values of requirements, monitors and records, by name."""
    dynamic = scenario.dynamicScenario
    groups = (
        scenario.requirements,
        scenario.monitors,
        scenario.terminationConditions,
        scenario.terminateSimulationConditions,
        scenario.recordedExprs,
        scenario.recordedInitialExprs,
        scenario.recordedFinalExprs,
    )
    values: dict[int, tuple[str, Samplable]] = {}
    for requirement in (entry for group in groups for entry in group):
        for name, value in _bindings(requirement.closure):
            if isinstance(value, Samplable) and needsSampling(value):
                values.setdefault(id(value), (name, value))
    left = [v for v in getattr(dynamic, "_requirementDeps", ()) if id(v) not in values]
    for value in sorted(left, key=_description):
        values[id(value)] = (f"require {type(value).__name__}", value)
    return list(values.values())


def _bindings(closure: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and values a requirement was compiled with, in the order of its code."""
    free = closure.__code__.co_freevars
    held = {
        name: cell.cell_contents for name, cell in zip(free, closure.__closure__ or (), strict=True)
    }
    for name, value in held.get("globalBindings", {}).items():
        yield name, toDistribution(value)
    for _, value in held.get("cells", ()):
        yield "local", value
    if held.get("ego") is not None:
        yield "ego", held["ego"]


def _description(value: Any) -> str:
    """Describe a value without its address in memory."""
    return f"{type(value).__name__} {re.sub(r' at 0x[0-9a-f]+', '', repr(value))}"
