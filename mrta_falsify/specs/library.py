"""The specifications that every run is scored with, by name.

All are folds over frames; robustness is in the unit named in each docstring, larger is
safer, below zero is a violation.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from mrta_falsify.core import codec, registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, FormatError
from mrta_falsify.core.parsing import parse_yaml
from mrta_falsify.core.protocols import Specification
from mrta_falsify.core.spec_profile import profile_of


def default_specifications() -> tuple[str, ...]:
    """List the specifications that score a run unless the user says otherwise."""
    return (
        "no_robot_robot_contact",
        "no_robot_human_contact",
        "no_robot_static_contact",
        "human_clearance",
        "exclusive_use",
        "kinematic_limits",
        "honest_events",
        "all_tasks_done",
        "deadlines",
        "no_deadlock",
        "no_livelock",
        "no_starvation",
        "progress",
        "stack_runs",
        "repeatable",
    )


def specification_choice(text: str, *, where: str = "--spec") -> Choice:
    """Read ``--spec TEXT``: a registered name, ``module:Class`` or ``stl:FORMULA``.

    Options follow a name in braces, as in ``costly_way{factor: 2}``.

    Raises:
        ConfigError: what stands in the braces is not YAML.
    """
    if text.startswith("stl:"):
        return Choice("stl", {"formula": text.removeprefix("stl:").strip()})
    name, brace, options = text.partition("{")
    if not brace:
        if not set(" ()<>").isdisjoint(text):
            raise ConfigError(f"{where} {codec.named(text)}: a formula is given as 'stl:FORMULA'")
        return Choice(text)
    place = f"{where} {codec.named(text)}"
    try:
        data = parse_yaml(brace + options, place)
    except FormatError as error:
        raise ConfigError(f"{error}; options must read NAME{{option: value, ...}}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{place}: options must read NAME{{option: value, ...}}")
    return Choice(name.strip(), data)


def spec_names(specs: str | Sequence[str]) -> tuple[str, ...]:
    """List the names of specifications that a user gives: one as text, or several."""
    return (specs,) if isinstance(specs, str) else tuple(specs)


def vote_specifications(names: Sequence[str]) -> tuple[str, ...]:
    """Name the specifications that judge copies of a failing world; the user's options stay."""
    return tuple(map(_of_vote, names))


def _of_vote(text: str) -> str:
    choice = specification_choice(text)
    added = profile_of(choice.name).in_votes
    return choice.name + json.dumps({**added, **choice.options}) if added else text


def build_specifications(
    names: Sequence[str] = (), *, where: str = "--spec"
) -> tuple[Specification, ...]:
    """Build specifications by name; without names, the default ones.

    Raises:
        InputError: unknown name, or a formula that cannot be read.
    """
    chosen = names or default_specifications()
    return tuple(
        registry.build("specification", specification_choice(name, where=where), where=where)
        for name in chosen
    )
