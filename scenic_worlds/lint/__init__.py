"""What compiles, but will not do what its author expects of a falsification campaign.

Each lint has a code:

``unknown-property``
    `with NAME VALUE` gives an object a property that its class does not have and the program
    does not read. Scenic accepts any name, so a misspelt one leaves the default in force.
``dynamic-property``
    `with speed VALUE` and the like: properties that Scenic fills in while a program runs. To give
    one to a robot or a piece of furniture changes nothing.
``undriven-speed``
    A `max_speed` above the `cruise_speed` of the robot: it is never driven.
``unknown-param``
    A global parameter that neither the library nor the program reads.
``no-model-line``
    The library is imported. Its parameters then overwrite those given before the import.
``random-only-in-require``
    A random value that only requirements refer to. Scenic keeps such values in a set without
    an order, so its own seeds and scene files mix them up.
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

No lint is an error; the program runs.
"""

from __future__ import annotations

from pathlib import Path

from scenic.core.scenarios import Scenario

from mrta_falsify.core.candidate import SearchSpace
from scenic_worlds.lint.misspelt import (
    given_dynamic_properties,
    missing_model_line,
    undriven_speeds,
    unknown_params,
    unknown_properties,
)
from scenic_worlds.lint.program_lines import Lint, ProgramText
from scenic_worlds.lint.random_values import (
    only_in_requirements,
    opaque_dimensions,
    random_in_dicts,
    undriven_mutations,
)
from scenic_worlds.lint.scenic_habits import (
    ignored_samplers,
    requirements_while_running,
    temporal_requirements,
)

__all__ = ["Lint", "lint_program"]


def lint_program(scenario: Scenario, path: Path, space: SearchSpace) -> tuple[Lint, ...]:
    """Lint a compiled program; the result is sorted by place.

    Args:
        scenario: compiled; driven or not.
        path: its file.
        space: what the driver found in it.
    """
    text = ProgramText(path)
    found = {
        *unknown_properties(scenario, text),
        *given_dynamic_properties(scenario, text),
        *undriven_speeds(scenario, text),
        *unknown_params(scenario, text),
        *missing_model_line(scenario, text),
        *only_in_requirements(scenario, text),
        *random_in_dicts(scenario, text),
        *undriven_mutations(scenario, text),
        *opaque_dimensions(scenario, space, text),
        *temporal_requirements(scenario),
        *requirements_while_running(text),
        *ignored_samplers(scenario, text),
    }
    return tuple(sorted(found, key=_place))


def _place(lint: Lint) -> tuple[str, int, Lint]:
    file, _, line = lint.where.rpartition(":")
    return (file, int(line), lint) if line.isdigit() else (lint.where, 0, lint)
