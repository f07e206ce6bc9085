"""Names that Scenic takes and nothing reads: properties, global parameters, no model line."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scenic.core.distributions import needsSampling, supportInterval
from scenic.core.object_types import Constructible
from scenic.core.scenarios import Scenario

from mrta_falsify.core.spelling import did_you_mean, nearest_name
from mrta_falsify.core.world import RobotSpec
from scenic_worlds.lint.program_lines import Lint, ProgramText
from scenic_worlds.lint.random_values import drawn_values, required_values
from scenic_worlds.lint.scenic_habits import SAMPLER_PARAMS
from scenic_worlds.shipped import MODEL

#: global parameters that make the world of a scene, or say what is searched
WORLD_PARAMS = (
    "layout",
    "tasks",
    "horizon",
    "ray_noise",
    "noise_seed",
    "late_people",
    "restrict",
    "clear_of_doors",
    "stack_params",
)
#: global parameters that `scenic -S` reads, to run a scene
RUN_PARAMS = ("stack", "settings", "engine", "specs", "seed", "output")

SCENIC_READS = frozenset({"name"})  # a property that Scenic reads and no class declares
#: properties that Scenic fills in while a program runs, and what gives a robot the like
DYNAMIC = {
    "speed": "max_speed",
    "velocity": "max_speed",
    "angularSpeed": "max_turn_rate",
    "angularVelocity": "max_turn_rate",
}
SURE = 0.8  # similarity from which a new property of a user's class is taken for a misspelt one


# --- properties --------------------------------------------------------------------------------


def unknown_properties(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find properties that only `with` gives, and new ones of classes that look misspelt."""
    for item in scenario._instances:
        kind = type(item)
        for name in sorted({*item.properties} - {*kind._defaults} - SCENIC_READS):
            yield from _given_property(item, name, text)
    for kind in {kind for item in scenario._instances for kind in type(item).__mro__}:
        if issubclass(kind, Constructible) and not _is_scenics(kind) and not _is_librarys(kind):
            yield from _declared_properties(kind, text)


def given_dynamic_properties(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find properties such as `speed` that a program gives where only Scenic writes them."""
    given = [name for name in DYNAMIC if text.find(rf"\bwith\s+{name}\b|^\s+{name}\s*:")]
    for item in scenario._instances if given else ():
        kind = type(item)
        for name in given:
            if not any(map(_is_librarys, kind.__mro__)) or _is_declared_by_library(kind, name):
                continue
            value = getattr(item, name)
            if not needsSampling(value) and np.array_equal(value, 0.0 * value):
                continue
            hint = f"; did you mean {DYNAMIC[name]!r}?" if hasattr(item, DYNAMIC[name]) else ""
            yield Lint(
                where=text.specifier(item, name),
                code="dynamic-property",
                name=f"{kind.__name__}.{name}",
                message=f"Scenic fills in {name!r} of a {kind.__name__} while a program runs, so "
                f"giving it changes nothing{hint}",
            )


def undriven_speeds(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find speed limits of robots that are above the speed at which they are driven."""
    if not text.find(r"\bmax_speed\b"):
        return
    default = inspect.signature(RobotSpec).parameters["max_speed"].default
    for item in scenario._instances:
        if getattr(item, "kind", "") != "robot" or not hasattr(item, "cruise_speed"):
            continue
        limit, cruise = item.max_speed, item.cruise_speed
        least, most = supportInterval(limit)[0], supportInterval(cruise)[1]
        if least is None or most is None or least < most or _is_number(limit, default):
            continue
        yield Lint(
            where=text.specifier(item, "max_speed"),
            code="undriven-speed",
            name=f"{type(item).__name__}.max_speed",
            message=f"max_speed is at least {least:g} m/s, but the robot cruises at {most:g} m/s "
            "at most, so it changes nothing; give cruise_speed too",
        )


def _is_number(value: Any, number: float) -> bool:
    return not needsSampling(value) and bool(value == number)


def _is_declared_by_library(kind: type, name: str) -> bool:
    """Whether a class of the library gives a property a meaning, as `Human` does for `speed`."""
    return any(
        _is_librarys(base) and name in base.__dict__.get("_scenic_properties", {})
        for base in kind.__mro__
    )


def _given_property(item: Any, name: str, text: ProgramText) -> Iterator[Lint]:
    """Report `with NAME VALUE` that neither the class has nor the program reads."""
    kind = type(item)
    hint = did_you_mean(name, _public(kind))
    is_ours = any(map(_is_librarys, kind.__mro__))
    if text.reads_property(name) or not (hint or is_ours):
        return
    yield Lint(
        where=text.specifier(item, name),
        code="unknown-property",
        name=f"{kind.__name__}.{name}",
        message=f"{kind.__name__} has no property {name!r} and the program does not read it, so "
        f"it changes nothing{hint}",
    )


def _declared_properties(kind: Any, text: ProgramText) -> Iterator[Lint]:
    """Report new properties of a user's class that were probably inherited ones."""
    own = kind.__dict__.get("_scenic_properties", {})
    for base in kind.__bases__:
        inherited = _public(base) if issubclass(base, Constructible) else []
        for name in own:
            meant = nearest_name(name, inherited, cutoff=SURE)
            if not meant or name in inherited or text.reads_property(name):
                continue
            yield Lint(
                where=text.place(rf"^\s+{re.escape(name)}\s*(?:\[[^\]]*\])?\s*:"),
                code="unknown-property",
                name=f"{kind.__name__}.{name}",
                message=f"class {kind.__name__} defines {name!r}, which the program does not read; "
                f"{base.__name__} has {meant!r}; did you mean that?",
            )


def _public(kind: Any) -> list[str]:
    """List the properties that a program may give to objects of a class."""
    names = {*kind._defaults} - {*kind._finalProperties}
    return [name for name in (*names, *SCENIC_READS) if not name.startswith("_")]


def _is_scenics(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "scenic"


def _is_librarys(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == MODEL.partition(".")[0]


# --- global parameters -------------------------------------------------------------------------


def unknown_params(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Find global parameters of a program over the library that nothing reads."""
    if "_places" not in scenario.params:
        return
    known = (*WORLD_PARAMS, *RUN_PARAMS)
    for name in scenario.params:
        if name.startswith("_") or name in known or name in SAMPLER_PARAMS:
            continue
        if text.reads_param(name) or _is_kept_for_others(name, scenario):
            continue
        hint = did_you_mean(name, known) or f"; the program reads one by globalParameters.{name}"
        yield Lint(
            where=text.param(name),
            code="unknown-param",
            name=f"param {name}",
            message=f"nothing reads param {name}, neither the library nor the program{hint}",
        )


def _is_kept_for_others(name: str, scenario: Scenario) -> bool:
    """Whether a parameter holds a random value that an object or requirement uses, too."""
    others = [value for other, value in scenario.params.items() if other != name]
    used = drawn_values([*scenario._instances, *others, *required_values(scenario)])
    return not drawn_values([scenario.params[name]]).keys().isdisjoint(used)


# --- the model line ------------------------------------------------------------------------------


def missing_model_line(scenario: Scenario, text: ProgramText) -> Iterator[Lint]:
    """Report a program that imports the library and does not name its world model."""
    if "_places" not in scenario.params or text.find(r"^\s*model\s+[.\w]"):
        return
    yield Lint(
        where=text.place(rf"^\s*(?:from|import)\s+{MODEL.partition('.')[0]}\b"),
        code="no-model-line",
        name="model",
        message=f"the library is imported, so its params overwrite those given before; write "
        f"`model {MODEL}` instead",
    )
